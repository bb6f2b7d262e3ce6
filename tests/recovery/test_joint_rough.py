"""What a joint is searched on: a record in stretches or with fewer samples; and a joint at another sampling time."""

from dataclasses import replace

import numpy as np
import pytest

from sysid.blocks import Compliance, Motor
from sysid.data.record import IOData
from sysid.excitations import Sweep
from sysid.joint.sampling import ENOUGH_SAMPLES, chain_at_rate, cut_at_rests, theta_at_rate, thin, thinning_factor
from sysid.model.chain import Chain
from sysid.structures import actuated_joint

TS, K = 0.02, 4
JAMS = actuated_joint(motor=Motor(load=1, jams=True), knots=None, play=False)
VALUES = {"gain": 0.004, "lag": 3.1, "rise": 1.9, "fall": 2.6, "jam": 400.0, "delay": 2.7, "upper": 1.0, "x0": 0.4}


def theta_of(chain: Chain, more: dict[str, float] | None = None) -> np.ndarray:
    values = VALUES | (more or {})
    return np.array([values.get(name.split(".")[-1], 0.0) for name in chain.names])


def drive(N: int, hold: int, seed: int = 0) -> np.ndarray:
    """A sweep (N,) whose input is held for `hold` samples."""
    u = Sweep(12.0, 4.0, jitter=0.5, shrink=0.5).generate(N // hold, hold * TS, np.random.default_rng(seed))
    return np.repeat(u, hold)


@pytest.fixture(scope="module")
def fast() -> IOData:
    u = drive(12_000, K)
    return IOData(u, JAMS.simulate(theta_of(JAMS), u), TS)


def test_a_joint_with_fewer_samples_is_the_same_joint(fast: IOData) -> None:
    """Between switches a motor under a held input is solved exactly: its samples lie on one curve at either rate."""
    assert np.ptp(fast.y) == pytest.approx(1.0)  # it meets both stops, and jams there
    slow = thin(fast, K)
    assert (slow.N, slow.Ts) == (fast.N // K, K * TS)
    theta = theta_at_rate(JAMS, theta_of(JAMS), 1.0 / K)
    np.testing.assert_allclose(JAMS.simulate(theta, slow.u), slow.y[:, 0], atol=1e-9)
    np.testing.assert_allclose(theta_at_rate(JAMS, theta, K), theta_of(JAMS), rtol=1e-12)


def test_fewer_samples_leave_enough_of_the_record_and_of_every_way(fast: IOData) -> None:
    """A joint that crosses in about 120 samples may have fewer; one that crosses in thirty may not."""
    assert thinning_factor(fast, JAMS) == 1
    u = fast.u
    slow = IOData(u, JAMS.simulate(theta_of(JAMS, {"gain": 0.001}), u), TS)
    k = thinning_factor(slow, JAMS)
    assert k > 1
    assert slow.N / k >= ENOUGH_SAMPLES
    assert np.abs(np.diff(thin(slow, k).y[:, 0])).max() < 0.05  # twenty samples from end to end at the fastest
    assert thinning_factor(slow.select(0, 2 * ENOUGH_SAMPLES - 1), JAMS) == 1
    timed = actuated_joint(motor=Motor(load=1, jams=True), knots=None, play=False, fixed={"motor.delay": 2.7})
    assert thinning_factor(slow, timed) == 1  # a delay in samples would no longer be the one that was given


def test_stretches_are_the_record_cut_where_it_rests() -> None:
    """Ways of 40 samples and rests of 60 take turns; a stretch that begins in a way has a speed."""
    way, rest, turns = 40, 60, 48
    ramp = np.concatenate(
        [np.full(rest, 0.0), np.linspace(0.0, 1.0, way), np.full(rest, 1.0), np.linspace(1.0, 0.0, way)]
    )
    y = np.tile(ramp, turns // 2)
    u = np.sign(np.diff(y, append=y[-1]))
    data = IOData(u, y, TS)
    cut = cut_at_rests(data, JAMS)
    np.testing.assert_array_equal(cut.y, data.y)
    np.testing.assert_array_equal(cut.u, data.u)
    assert len(cut.lengths) > 3
    starts = np.cumsum(cut.lengths)[:-1]
    assert np.all(y[starts - 1] == y[starts])
    assert np.all(y[starts] == y[starts + 1])
    assert cut_at_rests(data.select(0, 700), JAMS).lengths == (700,)
    sprung = actuated_joint(motor=Motor(load=1), knots=None, play=False, compliance=Compliance())
    assert cut_at_rests(data, sprung) is data  # whose spring is bent where it rests


def test_bounds_of_speeds_go_with_the_sampling_time_and_those_of_voltages_stay() -> None:
    """A stick speed of 0.003 strokes a sample is 0.0006 in samples five times shorter, and still above its bound."""
    plain = actuated_joint(motor=Motor(load=1, stribeck=True), knots=3, play=False)
    chain = replace(plain, bounds={"motor.stick_speed": (0.002, np.inf), "motor.rise": (0.5, 3.0)})
    theta = np.array([{"motor.stick_speed": 0.003, "motor.rise": 1.0}.get(name, 0.0) for name in chain.names])
    fast = dict(zip(chain.names, theta_at_rate(chain, theta, 5.0), strict=True))
    assert fast["motor.stick_speed"] == pytest.approx(0.0006)
    assert fast["motor.rise"] == 1.0
    assert chain_at_rate(chain, 5.0).bounds["motor.stick_speed"] == (pytest.approx(0.0004), np.inf)
    assert chain_at_rate(chain, 5.0).bounds["motor.rise"] == (0.5, 3.0)
