"""Where the run of a fit begins for an input alone: filters at rest, what integrates where the fit's record began."""

import re
from dataclasses import replace

import numpy as np
import pytest
from cases import BLOCKS, MOVING
from exported import agrees, excitation, made, python_run
from scipy.signal import lfilter

import sysid
from sysid.base.errors import InputError
from sysid.estimation.initial_state import estimate_initial
from sysid.excitations import Sweep
from sysid.model.chain import Chain
from sysid.structures import actuated_joint

CASES = {**BLOCKS, **MOVING}
STANDS = [name for name, (block, _) in CASES.items() if any(slot.holds for slot in block.slots())]
JOINT = {
    **{"motor.gain": 0.002, "motor.lag": 0.6, "motor.rise": 1.9, "motor.fall": 2.6, "motor.upper": 1.0},
    **{"map.low": -0.9, "map.high": 0.4, "play.width": 0.012},
}


@pytest.mark.parametrize("name", STANDS)
def test_what_integrates_begins_where_the_fit_has_it_and_stands(name):
    block, theta = CASES[name]
    fit, u = made(Chain((block,)), theta), excitation()
    moves = [s.initial and s.name in ("v0", "i0", "x1", "x2") for s in block.slots()]  # a speed, an integral, a lag
    still = np.where(moves, 0.0, theta)
    assert np.any(still[fit.model.initial])
    np.testing.assert_array_equal(fit.simulate(u), fit.model.simulate(still, u))
    record = sysid.IOData(u, fit.model.simulate(theta, u), fit.Ts)
    np.testing.assert_array_equal(fit.simulate(record, n_init=0), fit.simulate(u))  # no output to begin from


@pytest.mark.parametrize("name", ["friction_lag", "transfer_function"])
def test_filters_begin_at_rest_whatever_the_record_left_in_them(name):
    block, theta = CASES[name]
    chain = Chain((BLOCKS["limited_integrator"][0], replace(block, role="filter")))
    fit, u = made(chain, np.concatenate([BLOCKS["limited_integrator"][1], theta])), excitation()
    rest = np.where(chain.initial & (np.arange(len(fit.theta)) >= 4), 0.0, fit.theta)
    assert np.any(rest != fit.theta)
    np.testing.assert_array_equal(fit.simulate(u), chain.simulate(rest, u))


def test_a_joint_begins_where_the_first_of_several_experiments_did():
    chain = actuated_joint(knots=2)
    records = []
    for seed, begin in enumerate((0.7, 0.2)):
        theta = np.array([{**JOINT, "motor.x0": begin}.get(name, 0.0) for name in chain.names])
        u = Sweep(12.0, 10.0, jitter=0.5, shrink=0.6).generate(500, 0.1, np.random.default_rng(seed))
        records.append(sysid.IOData(u, chain.simulate(theta, u), 0.1))
    fit = sysid.fit(chain, sysid.IOData.merge(*records), search="lm", start=theta)
    for record in records:
        run = fit.simulate(record.u)
        assert run[0] == pytest.approx(records[0].y[0, 0], abs=0.02)
        agrees(python_run(fit, record.u[:, 0]), run)  # the exported file begins there too
    assert records[1].y[0, 0] < run[0] - 0.5


def wild():
    """A fit that was stopped early, whose run diverges from the state that the first outputs make likely."""
    rng = np.random.default_rng(3)
    u = rng.standard_normal(300)
    y = np.abs(lfilter([0.0, 1.0], [1.0, -0.9], u)) + 0.1 * rng.standard_normal(300)
    data = sysid.IOData(u + 17.5, y - 400.0, Ts=0.1)
    few = sysid.Options(max_iterations=8)
    return sysid.fit(sysid.structures.state_space(2, 2, degree=3), data, options=few, starts=2), data


def test_a_run_that_diverges_from_the_likely_state_begins_at_another_and_the_fit_says_so():
    fit, data = wild()
    likely = estimate_initial(fit.model, fit.theta, data.select(0, fit.n_init), data.u, fit.criteria.mse)
    with np.errstate(all="ignore"):
        assert not np.all(np.isfinite(fit.model.simulate(likely, data.u)))
    run = fit.simulate(data)
    assert np.all(np.isfinite(run))
    assert fit.fit_percent(data) > 30.0
    assert np.all(np.isfinite(fit.predict(data)))
    said = r"the free run diverges at sample \d+, so it begins at another state; search further \(fit.refine\(\)\)"
    assert re.search(said, " ".join(fit.warnings))
    assert re.search(said, fit.divergence(data))
    assert re.search(said, " ".join(str(fit).split()))


def test_a_run_that_diverges_from_every_state_is_infinite_and_told_as_a_run():
    fit, data = wild()
    other = sysid.IOData(50.0 * (data.u - 17.5) + 17.5, data.y, Ts=0.1)  # far beyond what the fit has seen
    with np.errstate(all="ignore"):
        run = fit.simulate(other)
    assert not np.isnan(run).any()
    end = int(np.argmax(np.isinf(run)))
    assert end > 0
    assert np.all(np.isinf(run[end:]))
    assert fit.fit_percent(other) == -np.inf
    said = rf"the free run diverges: it is not finite from sample {end} on"
    assert re.search(said, fit.divergence(other))
    with pytest.raises(InputError, match=rf"no residuals to test: {said}"):
        fit.residual_tests(other)
    with pytest.raises(InputError, match=said):
        fit.noise_model(other)


@pytest.mark.parametrize("name", ["motor_profile", "coupled_drives"])
def test_an_exported_model_is_the_run_of_the_fit_on_an_input_alone(name):
    """Their motors begin a record with a speed, which belongs to that record."""
    chain, rng = getattr(sysid.structures, name)(), np.random.default_rng(0)
    u = np.repeat(rng.uniform(-1.0, 1.0, 40), 10)
    data = sysid.IOData(u, lfilter([0.0, 0.5], [1.0, -0.8], u) + 0.01 * rng.standard_normal(400), 0.1)
    fit = sysid.fit(chain, data, starts=1, options=sysid.Options(max_iterations=3))
    speeds = [k for k, n in enumerate(fit.model.names) if n.endswith(".v0")]
    begun = replace(fit, theta=np.where(np.isin(np.arange(len(fit.theta)), speeds), 0.05, fit.theta))
    assert speeds
    assert not np.array_equal(begun.model.simulate(begun.theta, u), begun.simulate(u))
    agrees(python_run(begun, u), begun.simulate(u))
