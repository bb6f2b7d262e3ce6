"""Whether a joint has parts at all: the odds against an integral of our own, and plants with and without parts."""

from dataclasses import replace

import numpy as np
import pytest
from often import often

from sysid.blocks import Motor
from sysid.data.record import IOData
from sysid.estimation.fit import fit_chain
from sysid.joint.clock import TimeIsUp
from sysid.joint.full import colour_level, full_joint
from sysid.joint.holdout import refit_with_cost
from sysid.joint.occam import _log_det, _spreads, log_odds_of_parts
from sysid.joint.posterior import _Search, fit_joint
from sysid.joint.prior import joint_objective, units_of, usual_values
from sysid.structures import actuated_joint

PLAIN = actuated_joint(play=False, motor=Motor(load=0, stops=False), knots=None)
LAG, GAIN, FRICTION, TS = 0.12, 0.5, 0.6, 0.02


def drive(seed, width=0.0, noise=0.002):
    """A motor behind dry friction in steps of 1 ms, and a link in a play of `width`; levels held for 0.5 s."""
    rng, fine = np.random.default_rng(seed), 20
    u = np.repeat(rng.uniform(-3.0, 3.0, 24), 25)
    y, x, v, link = np.zeros(len(u)), 0.0, 0.0, 0.0
    for k in range(len(u)):
        y[k] = link
        for _ in range(fine):
            way = np.sign(v) if v else np.sign(u[k])
            pull = GAIN * (u[k] - way * FRICTION) if v or abs(u[k]) > FRICTION else 0.0
            after = v + TS / fine / LAG * (pull - v)
            v = 0.0 if v * after < 0.0 else after
            x += TS / fine * v
            link = np.clip(link, x - 0.5 * width, x + 0.5 * width)
    return IOData(u, y + noise * rng.standard_normal(len(u)), TS)


def best(chain, theta, data, objective):
    """The fit from there, and from initial states that suit it."""
    points = np.array([theta, refit_with_cost(chain, theta, data, objective.prior)[0]])
    return fit_chain(chain, data, start=points, objective=objective)


@pytest.mark.parametrize("width", [0.0, 0.01])
def test_the_odds_are_those_of_an_integral_over_the_part(width):
    """Of one part: the height of the posterior at many widths, each with the other parameters searched."""
    data = drive(1, width, 0.01)
    chain = replace(PLAIN.scaled(data.u, data.y), fixed={})
    start = fit_chain(chain, data, search="lm", starts=2)
    units, full = units_of(chain, start.theta, data), full_joint(chain, data, ("plays",))
    level = colour_level(start, data)
    plain = best(chain, start.theta, data, joint_objective(chain, units, level))
    point = np.array([dict(zip(chain.names, plain.theta, strict=True)).get(name, 0.005) for name in full.names])
    fit = best(full, point, data, joint_objective(full, units, level))
    found = log_odds_of_parts(fit, plain, data, level)

    _, spread = usual_values(full, units)["play.width"]
    widths = np.linspace(0.0, 0.05, 101)
    costs = []
    for w in widths:
        held = replace(full, fixed={**full.fixed, "play.width": w})
        theta = np.where(np.array(full.names) == "play.width", w, fit.theta)
        costs.append(refit_with_cost(held, theta, data, fit.prior)[1])
    least = refit_with_cost(chain, plain.theta, data, plain.prior)[1]
    # The cost has the prior of the width; what is left of it is its norm, over widths of 0 or more.
    heights = np.exp(-(np.array(costs) - least) / (2.0 * level**2)) * np.sqrt(2.0 / np.pi) / spread
    assert found == pytest.approx(np.log(np.trapezoid(heights, widths)), abs=1.0)
    assert (found > 0.0) == (width > 0.0)


def test_the_likelier_joint_is_taken_and_no_worse_on_levels_that_it_has_not_seen(monkeypatch):
    """Parts that a record leaves open are each a little off, and on other levels they add up."""
    fits = []
    likelier = _Search.likelier
    monkeypatch.setattr(_Search, "likelier", lambda search, full: fits.append(full) or likelier(search, full))
    gains, plain = [], 0
    for seed in often(20, 5):
        whole = drive(seed, noise=0.005)
        joint, unseen = fit_joint(whole.select(0, 300), PLAIN), whole.select(300, 600)
        assert ("play.width" in joint.fit.model.names) == (joint.log_odds >= 0.0)
        assert ("likelier" in joint.sentence()) == (joint.log_odds < 0.0)
        assert joint.shown == ()
        plain += joint.log_odds < 0.0
        gains.append(joint.fit.fit_percent(unseen) - fits[-1].fit_percent(unseen))
    assert plain
    assert np.mean(gains) > 0.0
    assert min(gains) > -1.0


def test_volumes_are_those_of_precisions_of_any_size():
    """A joint that runs away has derivatives of 1e19 beside some of 1; by hand the determinant is 18 times theirs."""
    sizes = np.array([1e19, 1.0, 1e-12])
    precision = np.array([[4.0, 1.0, 0.0], [1.0, 3.0, 1.0], [0.0, 1.0, 2.0]]) * np.outer(sizes, sizes)
    assert _log_det(precision) == pytest.approx(np.log(18.0) + 2.0 * 7.0 * np.log(10.0), rel=1e-12)
    np.testing.assert_allclose(_spreads(precision), np.sqrt(np.array([5.0, 8.0, 11.0]) / 18.0) / sizes, rtol=1e-12)


def test_a_drive_with_a_play_keeps_its_parts():
    joint = fit_joint(drive(1, 0.05, 0.001), PLAIN)
    assert joint.log_odds > np.log(20.0)
    assert joint.shown == ("play.width",)


def test_time_that_ends_while_the_plain_joint_is_tried_leaves_the_one_with_parts(monkeypatch):
    def late(search, full):
        raise TimeIsUp

    monkeypatch.setattr(_Search, "likelier", late)
    joint = fit_joint(drive(1), PLAIN, seconds=1000.0)
    assert "play.width" in joint.fit.model.names
    assert "before a joint without parts was tried" in joint.stopped
