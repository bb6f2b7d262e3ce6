"""The servo with a pendulum against closed forms and an independent integration of its equation of motion."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from sysid.base.errors import InputError
from twin.pendulum import Pendulum, respond

FREE = {"coulomb": 0.0, "load_friction": 0.0, "supply_resistance": 0.0}
G = 9.81


def held(pendulum, volts, start=0.0, seconds=4.0, Ts=0.01):
    """The reading under a constant voltage."""
    return respond([pendulum], np.full(round(seconds / Ts), volts), Ts, [start])[0]


def test_rest_under_a_voltage_balances_the_weight():
    p = Pendulum(0.49, 0.1, zero=0.03, **FREE)
    torque = p.stall_torque / p.rated_voltage * 2.0
    assert held(p, 2.0)[-1] == pytest.approx(0.03 + np.arcsin(torque / (0.49 * G * 0.1)), abs=1e-5)


def test_free_motion_is_that_of_the_equation():
    """J q'' = K (u - q' U / v0) - m g l sin q, integrated by scipy; MuJoCo's step of 1 ms is first order."""
    p = Pendulum(0.3, 0.15, stall_torque=0.25, rotor_inertia=0.002, viscous=0.01, **FREE)
    inertia, per_volt = 0.3 * 0.15**2 + 0.002, 0.25 / 5.0
    k = np.arange(300)
    u = 2.0 * np.sign(np.sin(2 * np.pi * k / 100))
    u[0] = 2.0

    def motion(t, x):
        volts = u[min(int(t / 0.01 + 1e-9), 299)]
        push = per_volt * (volts - x[1] * 5.0 / p.no_load_speed)
        return [x[1], (push - 0.01 * x[1] - 0.3 * G * 0.15 * np.sin(x[0])) / inertia]

    want = solve_ivp(motion, (0, 2.99), [0.4, 0.0], t_eval=k * 0.01, max_step=0.002, rtol=1e-8).y[0]
    (got,) = respond([p], u, 0.01, [0.4])
    assert np.ptp(want) > 0.5
    assert np.abs(got - want).max() < 0.01 * np.ptp(want)


def test_load_friction_holds_what_is_within_its_share():
    """Released at rest, the pendulum stays where friction, a share of the torque at the horn, exceeds what moves it."""
    stuck = Pendulum(0.49, 0.1, **FREE | {"load_friction": 1.2, "coulomb": 0.005})
    slides = stuck.replace(load_friction=0.5)
    assert held(stuck, 0.0, start=0.8)[-1] == pytest.approx(0.8, abs=0.01)
    assert abs(held(slides, 0.0, start=0.8)[-1]) < 0.1


def test_supply_resistance_lowers_the_stall_torque():
    """With duty d the motor has V0 d / (1 + d^2 R / Ra), Ra = K U / stall torque with K = U / v0 (geared)."""
    p = Pendulum(0.49, 0.1, **FREE | {"supply_resistance": 1.5})
    duty = 2.0 / p.supply_voltage
    constant = p.rated_voltage / p.no_load_speed / 288.4
    winding = constant * p.rated_voltage * 288.4 / p.stall_torque
    volts = 2.0 / (1.0 + duty**2 * 1.5 / winding)
    want = np.arcsin(p.stall_torque / p.rated_voltage * volts / (0.49 * G * 0.1))
    assert held(p, 2.0)[-1] == pytest.approx(want, abs=1e-5)


def test_rows_and_delay():
    p = Pendulum(0.49, 0.1)
    u = np.repeat([1.0, -1.0, 0.5], 40)
    rows = respond([p, p.replace(delay=0.02), p.replace(mass=0.3)], u, 0.01, [0.0] * 3)
    np.testing.assert_allclose(rows[1][2:], rows[0][:-2], rtol=0, atol=1e-12)
    assert np.abs(rows[2] - rows[0]).max() > 0.02
    np.testing.assert_array_equal(respond([p], u, 0.01, [0.0])[0], rows[0])


@pytest.mark.parametrize(
    ("values", "said"),
    [
        ({"mass": 0.0}, "positive mass"),
        ({"coulomb": -1.0}, "coulomb of the pendulum is -1"),
        ({"stall_torque": float("nan")}, "stall_torque"),
        ({"no_load_speed": 400.0}, "no_load_speed is 400"),
    ],
)
def test_what_no_pendulum_can_be_is_said(values, said):
    with pytest.raises(InputError, match=said):
        held(Pendulum(**{"mass": 0.49, "length": 0.1} | values), 0.0)


def test_too_high_a_voltage_is_said():
    with pytest.raises(InputError, match="raise supply_voltage"):
        respond([Pendulum(0.49, 0.1)], np.full(20, 11.0), 0.01, [0.0])
    with pytest.raises(InputError, match="value of a pendulum"):
        Pendulum(0.49, 0.1).replace(mas=1.0)
