"""The vote of the chunks: how often chance alone calls a joint harmful, and that a worse one is found out."""

import numpy as np
import pytest

from sysid.blocks import Motor
from sysid.data.record import IOData
from sysid.excitations import Aprbs
from sysid.joint.holdout import HoldoutErrors, harm, holdout_errors, holdout_folds, is_harmful
from sysid.model.chain import Chain
from sysid.structures import actuated_joint

CHUNKS = np.repeat(np.arange(24), 40)


def runs(errors: np.ndarray) -> HoldoutErrors:
    return HoldoutErrors(errors, CHUNKS, 1.0)


def test_chance_alone_is_called_harm_once_in_a_hundred() -> None:
    rng = np.random.default_rng(71)
    called = [is_harmful(runs(rng.normal(size=960)), runs(rng.normal(size=960)), 0.0) for _ in range(2000)]
    # One-sided t of 24 chunks beyond 2.5: 1.0 %; of 2000 draws the standard deviation is 0.2 %.
    assert np.mean(called) == pytest.approx(0.01, abs=0.007)


def test_an_error_that_grows_in_most_chunks_is_harm_and_one_wild_chunk_is_not() -> None:
    rng = np.random.default_rng(72)
    plain = rng.normal(size=960)
    worse = np.where(CHUNKS < 18, 1.3, 0.95) * plain
    wild = np.where(CHUNKS == 5, 50.0, 0.97) * plain
    assert is_harmful(runs(plain), runs(worse), 0.0)
    assert not is_harmful(runs(worse), runs(plain), 0.0)
    assert not is_harmful(runs(plain), runs(wild), 0.0)
    # ln of the squared error changes by 2 ln 1.3 in 18 chunks and by 2 ln 0.95 in 6: their t is known.
    changes = 2.0 * np.log(np.repeat([1.3, 0.95], [18, 6]))
    assert harm(runs(plain), runs(worse), 0.0) == pytest.approx(
        changes.mean() / (changes.std(ddof=1) / np.sqrt(24)), rel=1e-6
    )


def test_the_free_run_over_unseen_parts_of_a_true_joint_leaves_the_noise() -> None:
    rng, n, noise = np.random.default_rng(73), 1000, 0.01
    chain = actuated_joint(motor=Motor(load=0), play=False, knots=2)
    known = {"motor.gain": 0.006, "motor.lag": 2.0, "motor.rise": 1.2, "motor.fall": 1.5, "motor.upper": 1.0}
    known |= {"map.low": -0.5, "map.high": 0.9, "motor.x0": 0.5}
    theta = np.array([known.get(name, 0.0) for name in chain.names])
    u = Aprbs(10.0).generate(n, 0.05, rng)
    data = IOData(u, chain.simulate(theta, u) + noise * rng.normal(size=n), 0.05)
    seen = holdout_errors(chain, theta, holdout_folds(data))
    # Every sample outside the first of each block is judged once; the initial position costs a little.
    assert len(seen.errors) > 0.75 * n
    assert noise < seen.rms < 1.3 * noise
    held = actuated_joint(motor=Motor(load=0), play=False, knots=2, fixed={"motor.rise": 0.0, "motor.fall": 0.0})
    assert holdout_errors(held, theta * held.free + held_values(held), holdout_folds(data)).rms > 3.0 * noise


def held_values(chain: Chain) -> np.ndarray:
    return np.array([chain.fixed.get(name, 0.0) for name in chain.names])
