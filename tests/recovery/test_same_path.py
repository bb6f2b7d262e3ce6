"""A search takes one path whatever the last digits of its start: another processor changes no more than these."""

from dataclasses import replace

import numpy as np
import pytest
import scipy.signal

import sysid
import twin
from sysid.estimation.problem import ChainProblem
from sysid.joint import posterior
from sysid.joint.posterior import fit_joint
from sysid.joint.sampling import _rest_cuts
from sysid.joint.starting_points import _symmetric_root
from sysid.solver.iterate import Options, iterate
from sysid.solver.linearisation import order_of
from sysid.solver.searches import LevenbergMarquardt
from sysid.structures import TABLE

CASES, LEAST = 6, 5  # one in ten may lie at an edge between two multiples
FEW = sysid.Options(max_iterations=3)
PLAIN = sysid.Objective(knots=0, curvature_weight=0.0)


def record(rng: np.random.Generator) -> sysid.IOData:
    u = np.repeat(rng.uniform(-1.0, 1.0, 100), 6)
    y = np.tanh(2.0 * scipy.signal.lfilter([0.0, 0.3], [1.0, -1.2, 0.5], np.clip(1.5 * u, -0.8, 1.0)))
    return sysid.IOData(u, y + 0.05 * rng.standard_normal(len(u)), 0.1)


@pytest.mark.parametrize("search", ["lm", "auto"])
def test_fits_whose_starts_differ_in_the_last_digits_end_at_the_same_digits(search):
    """Twenty free break points and no smoothing: kinks decide where a search ends.

    Without rounding the ends differ by 1e-9 to 1e-3 in all of twenty cases.
    """
    same = 0
    model = TABLE["hammerstein_wiener"](nb=2, nf=2, nk=1).model()
    for seed in range(CASES):
        rng = np.random.default_rng(seed)
        data = record(rng)
        first = sysid.fit(model, data, starts=2, search=search, objective=sysid.Objective(knots=0), options=FEW)
        near = first.theta * (1.0 + 1e-11 * rng.standard_normal(len(first.theta)))
        ends = [sysid.fit(model, data, start=p, search=search, objective=PLAIN).theta for p in (first.theta, near)]
        same += np.allclose(*ends, rtol=0.0, atol=1e-12)
    assert same >= LEAST


def test_estimates_that_differ_in_lost_digits_begin_a_search_at_the_same_point():
    """A tenth of a standard deviation is far more than the 1e-9 that the condition of their equations loses."""
    model = TABLE["output_error"](nb=2, nf=2, nk=1).model()
    for seed in range(CASES):
        rng = np.random.default_rng(seed)
        data = record(rng)
        theta = sysid.fit(model, data, starts=1).theta
        size = np.abs(theta) + 1e-3
        ends, errors = [], []
        for near in (0.0, 1e-9):
            problem = ChainProblem.least_squares(
                model, theta + near * size * rng.uniform(-1, 1, len(theta)), data.u, data.y
            )
            rounded = replace(Options.from_estimate(0), tolerance=0.0)
            out = iterate(problem, problem.start, LevenbergMarquardt(), rounded)
            ends.append(problem.thetas(out.p)[0])
            errors.append(out.cost)
        np.testing.assert_allclose(*ends, rtol=0.0, atol=1e-14)
        assert not np.array_equal(ends[0], theta)
        assert errors[0] < 1.01 * len(data.y) * sysid.fit(model, data, start=theta).criteria.loss


def test_costs_that_differ_in_their_last_digits_keep_their_order():
    costs = np.array([2.0, 1.0, 3.0, np.inf, 1.0])
    for seed in range(CASES):
        near = costs * (1.0 + 1e-13 * np.random.default_rng(seed).standard_normal(5))
        assert order_of(near).tolist() == [1, 4, 0, 2, 3]
    assert order_of([1.0, 1.0 - 1e-6]).tolist() == [1, 0]


def test_a_record_of_a_converter_is_cut_at_the_same_rests_in_any_unit():
    """Sums of whole steps are exact, sums of tenths are not; many places move alike."""
    steps = np.cumsum(np.random.default_rng(0).choice([0.0, 0.0, 0.0, 1.0, -1.0], 4000))
    cuts = _rest_cuts(steps, 300)
    assert len(cuts) > 10
    for unit in (0.1, 1.0 / 3.0, 0.0046):
        assert _rest_cuts(steps * unit, 300) == cuts


def test_places_around_an_optimum_do_not_depend_on_the_axes_of_a_factor():
    """The signs and axes of singular vectors are another processor's."""
    rng = np.random.default_rng(0)
    factor = rng.standard_normal((6, 4)) * 10.0 ** rng.uniform(-4, 4, (6, 1))
    root, scale = _symmetric_root(factor), np.linalg.norm(factor, axis=1)
    np.testing.assert_allclose(
        root @ root.T / np.outer(scale, scale), factor @ factor.T / np.outer(scale, scale), atol=1e-7
    )
    axes = np.linalg.qr(rng.standard_normal((4, 4)))[0]
    np.testing.assert_allclose(_symmetric_root(factor @ axes) / scale[:, None], root / scale[:, None], atol=1e-7)


def test_a_value_that_a_step_brings_to_zero_is_zero():
    """What is left of two numbers that cancel would have a sign, and the friction of a joint at rest with it."""
    model = TABLE["output_error"](nb=1, nf=1, nk=0).model()
    data = record(np.random.default_rng(0))
    theta = np.where(model.free, 458.66666666666663, 0.0)
    problem = ChainProblem.least_squares(model, theta, data.u, data.y)
    p = np.full_like(problem.start, -458.66666666666663 - 2e-13)
    assert np.all(problem.thetas(p) == 0.0)
    assert np.allclose(problem.thetas(p + 1e-9)[0][model.free], 1e-9, rtol=1e-3)


@pytest.mark.nightly  # a joint's search has hundreds of points, each of which could take another path
def test_a_joint_whose_points_differ_in_the_last_digits_ends_at_the_same_digits(monkeypatch):
    log = twin.Experiment("shoulder", "sweep", 60.0, 0.1, 0).run()
    first, rng, best = fit_joint(log.io()).fit, np.random.default_rng(1), posterior.best_points
    monkeypatch.setattr(posterior, "best_points", lambda chain, points, *rest: best(chain, nearby(points, rng), *rest))
    np.testing.assert_allclose(fit_joint(log.io()).fit.theta, first.theta, rtol=1e-9, atol=1e-12)


def nearby(points: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    points = np.array(points)
    return points * (1.0 + 1e-13 * rng.standard_normal(points.shape))
