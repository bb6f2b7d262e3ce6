"""The band of a joint's free run: on another kind of input, where parameters change, at a bound, and at its start."""

import numpy as np
import pytest
from often import FULL, often

import sysid
import twin
from sysid.blocks import Motor
from sysid.data.record import IOData
from sysid.excitations import Sweep
from sysid.joint.posterior import fit_joint
from sysid.joint.transfer import joint_band, joint_information
from sysid.structures import actuated_joint
from sysid.uncertainty.bands import linear, monte_carlo
from sysid.uncertainty.information import information
from twin.bench.families import sweep as sweep_options
from twin.parameters import Parameters

TS, N = 0.1, 1200
MOTOR = actuated_joint(motor=Motor(load=2, stops=False), knots=None, play=False)
TRUE = {"motor.gain": 0.002, "motor.lag": 0.6, "motor.rise": 1.5, "motor.fall": 1.8, "motor.load1": 0.3}


def motor_record(seed, gains=(1.0, 1.0), friction=1.0):
    """A motor without stops under low and then high levels, with a gain for each."""
    rng = np.random.default_rng([seed, 81])
    parts = []
    for level, gain in zip((6.0, 12.0), gains, strict=True):
        u = Sweep(level, 6.0, jitter=0.5, shrink=0.4).generate(N // 2, TS, rng)
        values = TRUE | {"motor.gain": gain * TRUE["motor.gain"]}
        values |= {name: friction * TRUE[name] for name in ("motor.rise", "motor.fall")}
        values |= {"motor.x0": parts[-1].y[-1, 0] if parts else 0.5, "motor.upper": 1.0}
        y = MOTOR.simulate(np.array([values.get(name, 0.0) for name in MOTOR.names]), u)
        parts.append(IOData(u, y, TS))
    y = np.concatenate([part.y[:, 0] for part in parts])
    return IOData(np.concatenate([part.u[:, 0] for part in parts]), y + 0.002 * rng.standard_normal(N), TS)


@pytest.mark.parametrize("seed", often(3, 1))
def test_a_value_that_changes_with_the_level_is_as_uncertain_as_it_changes(seed):
    """A gain 6 % larger at high levels: two deviations hold both gains, those of noise do not; one is sharp."""
    k = MOTOR.names.index("motor.gain")
    for factor, most in ((1.0, 0.01), (1.06, 0.08)):
        data = motor_record(seed, (1.0, factor))
        fit = sysid.fit(MOTOR, data, starts=2)
        plain, wide = (i.cov[k, k] ** 0.5 for i in (information(fit, data, lags="auto"), joint_information(fit, data)))
        far = max(abs(fit.theta[k] - gain * TRUE["motor.gain"]) for gain in (1.0, factor))
        assert far < 2.0 * wide < 2.0 * most * fit.theta[k]
    assert far > 2.0 * plain


@pytest.mark.parametrize("seed", often(4, 1))
def test_the_band_holds_on_another_kind_of_input(seed):
    """Legs of the twin: fitted to a sweep, levels drawn over the whole supply are predicted; linear bands hold less."""
    held, starts = [], []
    for joint in ("shank", "thigh", "shoulder") if FULL else ("shank",):
        leg, options = Parameters(), sweep_options(joint, Parameters(), "voltage")
        sweep = twin.Experiment(joint, "sweep", 125.0, TS, 3 * seed, (), leg, options).run().io()
        levels = {"amplitude": leg["supply_voltage"]}
        other = twin.Experiment(joint, "aprbs", 125.0, TS, 3 * seed + 1, (), leg, levels).run().io()
        fit = fit_joint(sweep, seed=seed).fit
        band, n = joint_band(fit, sweep, other), fit.n_init
        narrow = linear(information(fit, sweep, lags="auto"), other, noise=True)
        held.append([np.mean(((b.lower <= other.y[:, 0]) & (other.y[:, 0] <= b.upper))[n:]) for b in (band, narrow)])
        starts.append(np.median((band.upper - band.lower)[:n]) / np.ptp(sweep.y))
    assert np.min(held, axis=0)[0] > 0.9
    assert np.mean(held, axis=0)[0] > np.mean(held, axis=0)[1]
    assert np.max(starts) < 0.1  # of the way: the first outputs say where a joint is


def test_draws_beyond_a_bound_lie_on_it():
    """Friction of nearly none: half of the draws would be below zero, and were left out."""
    data = motor_record(1, friction=0.001)
    fit = sysid.fit(MOTOR, data, starts=2)
    band = monte_carlo(joint_information(fit, data), data, noise=True, draws=100)
    assert band.dropped == 0
    assert np.all(np.isfinite(band.upper - band.lower))
