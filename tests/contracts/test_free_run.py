"""Where the run of a fit begins for an input alone: filters at rest, what integrates where the fit's record began."""

from dataclasses import replace

import numpy as np
import pytest
from cases import BLOCKS, MOVING
from exported import agrees, excitation, made, python_run

import sysid
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
    still = np.where([s.name in ("v0", "i0") for s in block.slots()], 0.0, theta)  # a speed, an integral
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
