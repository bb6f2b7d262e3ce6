"""Motors with known friction are found again from their records, also where several records share one motor."""

import numpy as np
import pytest

import sysid
from sysid import IOData
from sysid.base.errors import InputError
from sysid.blocks import FrictionLag, Motor, ProfiledMotor
from sysid.data.gain_variants import gain_variants
from sysid.model.chain import Chain
from sysid.structures import actuated_joint

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
