"""A search takes one path whatever the last digits of its start: another processor changes no more than these."""

from dataclasses import replace

import numpy as np
import pytest
import scipy.signal

import sysid
from sysid.estimation.problem import ChainProblem
from sysid.solver.iterate import Options, iterate
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
