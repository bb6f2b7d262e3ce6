"""A motor's own steps against an adaptive integration of its equation of motion with events."""

import numpy as np
import pytest
from motion import Reference

from sysid.blocks import Motor

PLAIN = {"gain": 0.05, "lag": 1.3, "rise": 0.3, "fall": 0.4, "lower": 0.0, "upper": 1.0, "x0": 0.4}


def run(motor, u, **values):
    """Positions (N,) of the block itself."""
    theta = np.array([values.get(slot.name, 0.0) for slot in motor.slots()])
    assert motor.admissible(theta)
    return motor.propagate(theta, np.ascontiguousarray(u), np.empty((len(u), 0)), 0)


def levels(seed, N=150, largest=6.0):
    """Holds of 1 to 9 samples of up to so many volts."""
    rng = np.random.default_rng(seed)
    return np.repeat(rng.uniform(-largest, largest, N), rng.integers(1, 10, N))[:N]


@pytest.mark.parametrize("lag", [0.2, 1.3, 20.0])
@pytest.mark.parametrize("delay", [0.0, 0.37, 1.0, 2.8])
@pytest.mark.parametrize("jam", [0.0, 12.0])
def test_strikes_and_what_comes_after_them_in_one_sample(lag, delay, jam):
    """Without a load every switch is met exactly: reversals, starts, strikes on either stop, jams, and the rest."""
    gain = PLAIN["gain"] * (4.0 if lag > 10.0 else 1.0)
    values = PLAIN | {"lag": lag, "delay": delay, "gain": gain, "jam": jam}
    u = levels(int(10 * lag + 100 * delay))
    expected = Reference(**values).run(u)
    x = run(Motor(load=0, jams=jam > 0.0), u, **values)
    np.testing.assert_allclose(x, expected, rtol=0, atol=1e-7)
    struck = (x[1:] == 0.0) | (x[1:] == 1.0)
    assert np.sum(struck & (x[:-1] > 0.0) & (x[:-1] < 1.0)) >= 4


def test_an_inward_drive_moves_it_away_in_the_sample_of_the_strike():
    """Closed form: braked at -3 V from speed 0.4 it strikes the stop 0.05 away and leaves at once."""
    values = {"gain": 0.1, "lag": 2.0, "rise": 1.0, "fall": 0.5, "upper": 1.0, "x0": 0.95, "v0": 0.4}
    x = run(Motor(load=0, delayed=False), np.full(4, -3.0), **values)
    braked, back = 0.1 * (-3.0 - 1.0), 0.1 * (-3.0 + 0.5)
    t = np.linspace(0.0, 1.0, 2_000_001)
    way = braked * t + (0.4 - braked) * 2.0 * (1.0 - np.exp(-t / 2.0))
    strikes = float(np.interp(0.05, way[: way.argmax()], t[: way.argmax()]))
    since = np.arange(1, 4) - strikes
    expected = 1.0 + back * (since - 2.0 * (1.0 - np.exp(-since / 2.0)))
    np.testing.assert_allclose(x[1:], expected, rtol=0, atol=1e-9)


@pytest.mark.parametrize("delay", [0.0, 1.0, 3.0])
@pytest.mark.parametrize("options", [{"load": 0}, {"load": 3, "jams": True, "substeps": 2}])
def test_derivative_at_a_whole_delay_is_that_of_a_longer_one(delay, options):
    """Finite differences to the right, with an input that jumps at every sample."""
    motor = Motor(**options)
    values = PLAIN | {"delay": delay, "load1": 0.3, "load2": 0.2, "jam": 5.0}
    theta, names = np.array([values.get(s.name, 0.0) for s in motor.slots()]), [s.name for s in motor.slots()]
    u = np.random.default_rng(3).uniform(-4.0, 4.0, 200)
    J = np.zeros((len(u), len(theta)))
    motor.propagate(theta, u, J, 0)

    def slope(h):
        return (run(motor, u, **values | {"delay": delay + h}) - run(motor, u, **values)) / h

    own = J[:, names.index("delay")]
    right = 2.0 * slope(5e-7) - slope(1e-6)  # without the term of first order
    np.testing.assert_allclose(own, right, rtol=0, atol=1e-6 * np.abs(own).max())
