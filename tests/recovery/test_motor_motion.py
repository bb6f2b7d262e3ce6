"""A motor's own steps against an adaptive integration of its equation of motion with events."""

from dataclasses import replace

import numpy as np
import pytest
from motion import Reference

from sysid.base.errors import InputError
from sysid.blocks import Motor
from sysid.model.chain import Chain

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


SPRING = (Motor(load=2, stops=False, delayed=False, at=0.0), lambda x: 1.5 * x, {"load1": 1.5})
PARABOLA = (
    Motor(load=3, delayed=False),
    lambda x: 2.0 * (x - 0.5) - 3.0 * (x - 0.5) ** 2,
    {"load1": 2.0, "load2": -3.0},
)
PENDULUM = (
    Motor(load=0, periodic=2, period=360.0, stops=False, delayed=False),
    lambda x: 1.4 * np.sin(np.radians(x)) - 0.2 * np.cos(np.radians(x)) + 0.3 * np.sin(2.0 * np.radians(x)),
    {"sine1": 1.4, "cosine1": -0.2, "sine2": 0.3},
)


@pytest.mark.parametrize("lag", [0.3, 3.0])
@pytest.mark.parametrize("case", [SPRING, PARABOLA, PENDULUM], ids=["spring", "parabola", "pendulum"])
def test_a_load_over_position_is_followed_to_second_order(case, lag):
    motor, load, own = case
    turns = 40.0 if motor.periodic else 1.0
    values = PLAIN | {"gain": 0.04 * (1.0 + lag) * turns, "lag": lag, "x0": 0.2 * turns}
    ends = {"lower": -np.inf, "upper": np.inf} if not motor.stops else {}
    u = levels(int(10 * lag), largest=4.0)
    expected = Reference(load, **values | ends).run(u)
    errors = []
    for substeps in (1, 4, 16):
        e = run(replace(motor, substeps=substeps), u, **values, **own) - expected
        errors.append(np.sqrt(np.mean(e**2)) / np.std(expected))
    # A quarter of the step gives a sixteenth of the error; a little more where a step sees a start or a reversal.
    assert errors[0] < 0.02
    assert errors[1] < errors[0] / 8.0
    assert errors[2] < errors[1] / 8.0


@pytest.mark.parametrize("stiffness", [0.1, 1.0, 3.0, 9.0])
def test_a_spring_without_friction_keeps_its_energy(stiffness):
    """v' = -stiffness x from rest at 1, over 20,000 samples, some of them longer than a third of a period."""
    lag = 1e5  # its drag takes the half of 1 / lag a sample from the amplitude
    x = run(SPRING[0], np.zeros(20_000), gain=lag, lag=lag, load1=stiffness, x0=1.0)
    first, last = np.abs(x[:500]).max(), np.abs(x[-500:]).max()
    assert first == pytest.approx(1.0, abs=0.01)
    assert 0.97 * np.exp(-0.5 * 20_000 / lag) < last <= 1.0  # a long step sees less of the drag, never more energy


@pytest.mark.parametrize("stiffness", [1.0, 50.0, 1e4])
def test_a_stiff_spring_draws_a_light_motor_home(stiffness):
    """A time constant of 1 / stiffness samples: it goes home, as the explicit rule does up to 2 only."""
    x = run(SPRING[0], np.zeros(400_000 if stiffness > 100.0 else 400), gain=1.0, lag=1e-3, load1=stiffness, x0=1.0)
    assert np.all(np.abs(x) <= 1.0 + 1e-12)
    assert np.abs(x[-1]) < 1e-6


@pytest.mark.parametrize("stops", ["lower", "upper"])
def test_one_stop_ends_one_side_only(stops):
    u = levels(4)
    values = PLAIN | {"jam": 3.0}
    held = values | ({"upper": np.inf} if stops == "lower" else {"lower": -np.inf})
    x = run(Motor(load=0, delayed=False, jams=True, stops=stops), u, **values)
    np.testing.assert_allclose(x, Reference(**held).run(u), rtol=0, atol=1e-7)
    assert (x.min() < -0.1) == (stops == "upper")
    assert (x.max() > 1.1) == (stops == "lower")


def test_true_and_false_are_both_stops_and_none():
    assert Motor(stops="both") == Motor(stops=True)
    assert Motor(stops="none") == Motor(stops=False)
    with pytest.raises(InputError, match="both"):
        Motor(stops="left")


def test_a_load_that_drives_the_motor_away_is_told():
    """-2 V a unit against a friction of 0.3 V: without input nothing holds it beyond 0.15."""
    motor = Motor(load=2, stops=False, delayed=False, at=0.0, role="motor")
    values = {"gain": 0.05, "lag": 2.0, "rise": 0.3, "fall": 0.4, "load1": -2.0}

    def told(x0, largest):
        theta = np.array([{**values, "x0": x0}.get(s.name, 0.0) for s in motor.slots()])
        u = np.where(np.arange(200) == 190, largest, 0.0)
        return Chain((motor,)).remarks(theta, u)

    assert "beyond 0.15" in told(0.16, 0.0)[0]
    assert "beyond -0.7 " in told(-0.21, 1.0)[0]
    assert not told(0.14, 0.0)
    assert not told(-0.19, 1.0)
    u = np.zeros(200)
    held = replace(motor, stops=True)
    assert not Chain((held,)).remarks(np.array([{**values, "upper": 1.0}.get(s.name, 0.0) for s in held.slots()]), u)
