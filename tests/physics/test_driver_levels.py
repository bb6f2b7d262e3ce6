"""The levels that a quantiser makes of a command, against the voltages that the twin's bridge puts out."""

import numpy as np
import pytest
from rig import VOLTS, shown

from sysid.blocks import Quantiser
from twin import JOINTS, Parameters
from twin.hardware.actuator import drive
from twin.imperfections import of_group

# What else stands between a command and the motor, and what the motor could do to it in return.
ELSE = (*(name for name in of_group("bridge") if name != "pwm"), "friction", "end_stops")


def levels(u: np.ndarray, step: float) -> np.ndarray:
    return Quantiser(step).evaluate(np.empty(0), u, np.empty((len(u), 0)), 0)[0]


@pytest.mark.parametrize("joint", JOINTS)
def test_a_quantiser_with_the_drivers_step_gives_the_voltages_of_the_bridge(joint: str) -> None:
    step = drive(Parameters(), joint).step
    assert step is not None
    u = np.linspace(-11.9, 11.9, 1700)  # seven commands a level, none of them halfway between two
    assert np.abs(np.mod(u / step, 1.0) - 0.5).min() > 1e-6
    volts = shown(joint, u, ELSE, Ts=0.01)[:, VOLTS]
    np.testing.assert_allclose(levels(u, step), volts, rtol=0, atol=1e-12)
    assert len(np.unique(np.round(volts / step))) == 2 * int(11.9 / step + 0.5) + 1  # every level was there
    assert np.abs(u - volts).max() == pytest.approx(step / 2, rel=0.01)


def test_without_levels_there_is_no_step() -> None:
    assert drive(Parameters(), "shank", without=("pwm",)).step is None
    u = np.linspace(-3.0, 3.0, 50)
    np.testing.assert_allclose(shown("shank", u, ("pwm", *ELSE), Ts=0.01)[:, VOLTS], u, rtol=0, atol=1e-12)


def test_halfway_between_two_levels_counts_upwards() -> None:
    np.testing.assert_array_equal(levels(np.array([-1.5, -0.5, 0.5, 1.5]), 1.0), [-1.0, 0.0, 1.0, 2.0])
