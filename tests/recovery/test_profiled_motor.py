"""Motors with known friction are found again from their records, also where several records share one motor."""

import numpy as np
import pytest
from motion import Reference

import sysid
from sysid import IOData
from sysid.base.errors import InputError
from sysid.blocks import FrictionLag, Motor, ProfiledMotor
from sysid.data.preprocess import gain_variants
from sysid.model.chain import Chain
from sysid.structures import actuated_joint, motor_profile

RISE, FALL = np.array([0.5, 0.8, 0.4]), np.array([0.6, 0.3, 0.5])


def volts(seed, N=3000):
    """Levels of up to 3 V for 20 to 80 samples each."""
    rng = np.random.default_rng(seed)
    return np.repeat(rng.uniform(-3.0, 3.0, N), rng.integers(20, 80, N))[:N]


def profiled(noise, seeds=(1, 2)):
    model = Chain((ProfiledMotor(knots=3, low=-20.0, high=20.0, role="motor"),))
    records = []
    for seed in seeds:
        theta = np.concatenate([[60.0, 4.0, 6.0], RISE, FALL, [float(seed), 0.05 * seed]])
        u = volts(seed)
        y = model.simulate(theta, u) + noise * np.random.default_rng(seed).normal(size=len(u))
        records.append(IOData(u, y))
    return model, IOData.merge(*records)


def test_profile_drag_and_inertia_from_two_records_with_states_of_their_own():
    model, data = profiled(noise=0.02)
    fit = sysid.fit(model, data, starts=1)
    value = {p.name: p.value for p in fit.parameters}
    assert value["motor.inertia"] == pytest.approx(60.0, rel=0.01)
    assert value["motor.drag_up"] == pytest.approx(4.0, rel=0.01)
    assert value["motor.drag_down"] == pytest.approx(6.0, rel=0.01)
    np.testing.assert_allclose([value[f"motor.rise{i}"] for i in range(3)], RISE, atol=0.02)
    np.testing.assert_allclose([value[f"motor.fall{i}"] for i in range(3)], FALL, atol=0.02)
    assert np.sqrt(fit.criteria.loss) == pytest.approx(0.02, rel=0.05)


def test_profile_of_one_knot_is_the_plain_motor():
    """inertia = lag / gain and drag = 1 / gain (v' lag + v = gain (u - friction)), at any number of substeps."""
    gain, lag, rise, fall, x0, v0 = 0.2, 12.0, 0.3, 0.5, 0.4, 0.1
    plain = Motor(load=0, delayed=False, stops=False, role="motor")
    u = volts(5, 400)
    expected = Chain((plain,)).simulate(np.array([gain, lag, rise, fall, x0, v0]), u)
    theta = np.array([lag / gain, 1.0 / gain, 1.0 / gain, rise, fall, x0, v0])
    for substeps in (1, 3):
        block = ProfiledMotor(knots=1, substeps=substeps, role="motor")
        np.testing.assert_allclose(Chain((block,)).simulate(theta, u), expected, atol=1e-9)


def test_motor_in_two_records_with_states_of_their_own():
    model = actuated_joint(motor=Motor(stops=False, delayed=False, load=1), knots=None, play=False)
    truth = {"motor.gain": 0.2, "motor.lag": 12.0, "motor.rise": 0.4, "motor.fall": 0.3, "motor.load0": 0.1}
    records = []
    for seed in (1, 2):
        theta = np.array([*truth.values(), 5.0 * seed, 0.0])
        u = volts(seed)
        y = model.simulate(theta, u) + 0.02 * np.random.default_rng(seed).normal(size=len(u))
        records.append(IOData(u, y))
    fit = sysid.fit(model, IOData.merge(*records))
    assert np.sqrt(fit.criteria.loss) == pytest.approx(0.02, rel=0.05)
    value = {p.name: p.value for p in fit.parameters}
    assert value["motor.gain"] == pytest.approx(0.2, rel=0.01)
    assert value["motor.lag"] == pytest.approx(12.0, rel=0.01)
    # A constant load is friction of one sign: only what stands against motion up and down can be told.
    assert value["motor.rise"] + value["motor.load0"] == pytest.approx(0.5, rel=0.02)
    assert value["motor.fall"] - value["motor.load0"] == pytest.approx(0.2, rel=0.02)
    assert max(fit.losses) < 2.0 * min(fit.losses)  # every start got there


def test_held_states_stay_held_in_every_experiment():
    model, data = profiled(noise=0.02, seeds=(1,))
    held = Chain(model.blocks, fixed={"motor.x0": 1.0, "motor.v0": 0.05})
    fit = sysid.fit(held, gain_variants(data, 0.02), starts=1)
    assert fit.theta[-2:].tolist() == [1.0, 0.05]
    assert fit.criteria.N == 3 * data.N


def test_gains_must_be_a_share():
    _, data = profiled(noise=0.0, seeds=(1,))
    with pytest.raises(InputError, match="share is 1"):
        gain_variants(data, 1.5)


def test_friction_lag_without_friction_is_an_exponential():
    block, n = FrictionLag(substeps=8, role="drive"), np.arange(60)
    theta = np.array([0.3, 0.1, 0.0, 1.0, 0.0])
    y = block.propagate(theta, np.ones(60), np.empty((60, 0)), 0)
    # The midpoint rule's error over one time constant is (drag h)^2 / 6 of the step, h = 1/8 sample.
    np.testing.assert_allclose(y, 3.0 * (1.0 - np.exp(-0.1 * n)), atol=3.0 * (0.1 / 8) ** 2 / 6 * 1.1)


def test_friction_lag_slow_where_it_turns_fast():
    """Far beyond the onset only drag brakes, around zero drag + friction / onset: two time constants of one drive."""
    block = FrictionLag(substeps=8, role="drive")
    theta = np.array([1.0, 0.02, 0.1, 0.5, 1e-4])
    y = block.propagate(theta, np.zeros(20), np.empty((20, 0)), 0)
    assert -np.log(y[-1] / y[0]) / 19 == pytest.approx(0.02 + 0.1 / 0.5, rel=1e-3)
    theta[-1] = 100.0
    y = block.propagate(theta, np.zeros(20), np.empty((20, 0)), 0)
    assert (y[0] - y[1]) == pytest.approx(0.02 * 100.0 + 0.1, rel=0.02)


PLACES, LOADS = np.linspace(-2.0, 2.0, 5), np.array([0.9, -0.2, 0.4, -0.6, 0.9])


def by_hand(periodic, delay=0.0, **more):
    """The motor by an adaptive integration: a load that is straight between the knots, and even friction of 0.5 V."""

    def load(x):
        return np.interp(x, PLACES, LOADS, period=4.0 if periodic else None)

    return Reference(load, gain=0.25, lag=1.5, rise=0.5, fall=0.5, x0=0.3, delay=delay, **more)


def known(periodic, **options):
    """The same motor as a block, and its theta: drag 4, inertia 6."""
    knots = 4 if periodic else 5
    block = ProfiledMotor(knots, -2.0, 2.0, period=4.0 if periodic else 0.0, midway=True, role="motor", **options)
    load = LOADS[:knots]
    late = [2.4] if block.delayed else []
    return block, np.concatenate([[6.0, 4.0, 4.0], 0.5 + load, 0.5 - load, late, [0.3, 0.0]])


@pytest.mark.parametrize("periodic", [False, True])
@pytest.mark.parametrize("delayed", [False, True])
def test_a_profile_is_followed_to_second_order_within_and_beyond_its_knots(periodic, delayed):
    u = volts(7, 200)
    expected = by_hand(periodic, 2.4 if delayed else 0.0).run(u)
    assert np.ptp(expected) > (8.0 if periodic else 4.5)
    errors = []
    for substeps in (1, 4, 16):
        block, theta = known(periodic, substeps=substeps, delayed=delayed)
        errors.append(np.sqrt(np.mean((Chain((block,)).simulate(theta, u) - expected) ** 2)))
    assert errors[2] < 2e-3 * np.std(expected)
    assert errors[2] < errors[0] / 30.0  # 256 where no knot, start or reversal falls into a step


def test_the_derivative_by_a_whole_delay_is_that_of_a_longer_one():
    block, theta = known(True, delayed=True)
    theta[-3] = 2.0
    u, names = volts(8, 200), [s.name for s in block.slots()]
    J = np.zeros((len(u), len(theta)))
    y = block.propagate(theta, u, J, 0)

    def slope(h):
        late = theta + h * (np.array(names) == "delay")
        return (block.output(late, u) - y) / h

    right = 2.0 * slope(5e-7) - slope(1e-6)
    np.testing.assert_allclose(J[:, names.index("delay")], right, rtol=0, atol=1e-6 * np.abs(right).max())


def test_a_stiff_profile_does_not_run_away():
    """A spring of 50 V a unit on a light motor: 12 times a sample's speed, which the profile of a start overshoots."""
    block = ProfiledMotor(2, -1.0, 1.0, midway=True, role="motor")
    x = block.output(np.array([0.01, 4.0, 4.0, -50.0, 50.0, 50.0, -50.0, 0.8, 0.0]), np.zeros(3000))
    assert np.all(np.abs(x) <= 0.8)
    assert np.abs(x[-1]) < 1e-3


def test_a_run_outside_the_profile_is_told():
    block, theta = known(False)
    u = np.full(100, 4.0)
    y = block.output(theta, u)
    share = np.mean(y > 2.0)
    assert 0.5 < share < 1.0
    assert block.outside(y) == share
    assert f"{100 * share:.1f} %" in Chain((block,)).remarks(theta, u)[0]
    turns, theta = known(True)
    assert not Chain((turns,)).remarks(theta, u)


def test_a_delayed_profile_is_found_from_its_record():
    block, theta = known(True, delayed=True)
    theta[:3] = 150.0, 30.0, 36.0  # slow beside its samples: up to half a turn in twenty-five
    theta[11] = 7.6
    rng = np.random.default_rng(3)
    u = np.repeat(rng.uniform(-3.0, 3.0, 1500), rng.integers(2, 8, 1500))[:1500]  # holds shorter than the delay
    y = Chain((block,)).simulate(theta, u) + 0.01 * np.random.default_rng(3).normal(size=len(u))
    fit = sysid.fit(motor_profile(4, -2.0, 2.0, delayed=True, period=4.0), IOData(u, y), starts=1)
    assert np.sqrt(fit.criteria.loss) == pytest.approx(0.01, rel=0.05)  # 0.0111 from a start without a delay
    assert fit.theta[11] == pytest.approx(7.6, abs=0.05)


def test_without_low_and_high_a_profile_has_the_range_of_its_record():
    u, y = volts(3, 300), 3.0 * np.sin(np.arange(300) / 20.0)
    for period, ends in ((None, (y.min(), y.max())), (4.0, (y.min(), y.min() + 4.0)), (7.0, (y.min(), y.max()))):
        model = motor_profile(knots=4, period=period)
        fit = sysid.fit(model, IOData(u, y), starts=1, options=sysid.Options(max_iterations=1))
        assert fit.model.blocks[0].ends == ends
        assert fit.model.blocks[0].periodic == (period == 4.0)
    with pytest.raises(InputError, match="no range yet"):
        model.simulate(np.zeros(len(model.names)), u)
