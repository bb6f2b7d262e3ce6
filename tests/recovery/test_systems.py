"""Plants with known truth are recovered from automatic starts."""

from itertools import product

import numpy as np
import pytest
from often import by_day, often
from scipy.optimize import least_squares
from scipy.signal import lfilter
from scipy.stats import chi2

import sysid
from sysid.base.criteria import fit_percent
from sysid.base.poles import match
from sysid.estimation.problem import ChainProblem
from sysid.estimation.starts import starts
from sysid.solver.linearisation import Linearisation
from sysid.solver.searches import TABLE as SEARCHES
from sysid.solver.searches.trust_region import TrustRegion
from sysid.systems import TABLE, system


def pole_error(fit, plant):
    """Largest relative s-plane error over the true poles."""
    return max(m.s_error for m in match(fit.poles, plant.poles, plant.Ts))


@pytest.mark.parametrize(
    ("search", "name"),
    by_day(product(("auto", "lm"), sorted(TABLE)), ("auto", "textbook"), ("auto", "paper_shank"), ("lm", "textbook")),
)
def test_noise_free_poles_to_1e_6(name, search):
    plant = system(name)
    data = plant.record(4000, 0.0, np.random.default_rng(11))
    fit = sysid.fit(plant.chain, data, search=search)
    assert pole_error(fit, plant) < 1e-6
    assert fit.fit_percent(plant.record(2000, 0.0, np.random.default_rng(12))) > 99.99


@pytest.mark.slow
@pytest.mark.parametrize("name", sorted(TABLE))
def test_fit_within_a_tenth_of_the_oracle(name):
    """1 % noise, N 4000, five starts: validation within 0.1 point of the true model's on at least 99 % of seeds."""
    plant = system(name)
    gaps = []
    for seed in often(100, 1):
        rng = np.random.default_rng(seed)
        estimation, validation = plant.record(4000, 0.01, rng), plant.record(4000, 0.01, rng)
        fit = sysid.fit(plant.chain, estimation, search="lm", seed=seed)
        n = fit.n_init
        oracle = fit_percent(validation.y[n:, 0], plant.truth(validation.u[:, 0])[n:])
        gaps.append(oracle - fit.fit_percent(validation))
    assert np.mean(np.array(gaps) < 0.1) >= 0.99, f"gaps {np.sort(gaps)[-3:]}"


@pytest.mark.slow
def test_pole_deviations_are_those_of_the_errors(seeds):
    """|error|^2 / std^2 of the textbook plant's complex pole has mean one over n records, five for each seed.

    Real and imaginary part are Gaussian: n times the mean is a weighted sum of 2 n squares whose weights add up to n,
    with tails no heavier than those of chi-square with n degrees of freedom (all weight on one of the two). One in
    100,000 on each side.
    """
    plant = system("textbook")
    squares = []
    for seed in range(5 * len(seeds)):
        data = plant.record(2000, 0.05, np.random.default_rng(1000 + seed))
        fit = sysid.fit(plant.chain, data, search="lm", starts=1, start=plant.theta)
        k = int(np.argmax(fit.poles.imag))
        true = plant.poles[np.argmax(plant.poles.imag)]
        squares.append(abs(fit.poles[k] - true) ** 2 / fit.pole_std[k] ** 2)
    n = len(squares)
    low, high = chi2.ppf([1e-5, 1 - 1e-5], n) / n
    assert (
        low < np.mean(squares) < high
    )  # 0.40 and 1.98 for 60 records; intervals of twice the width have a mean of 0.25


@pytest.mark.parametrize("search", by_day(sorted(SEARCHES), "auto", "gradient", "lm"))  # the rest: the next test
def test_every_search_reaches_the_same_optimum(search):
    plant = system("textbook")
    data = plant.record(1500, 0.01, np.random.default_rng(21))
    best = sysid.fit(plant.chain, data, search="lm", options=sysid.Options(tolerance=1e-8))
    fit = sysid.fit(plant.chain, data, search=search)
    assert SEARCHES[search].name == search
    assert fit.stop.converged
    assert fit.criteria.loss == pytest.approx(best.criteria.loss, rel=2e-4)  # the tolerance is 0.01 % of the loss


@pytest.mark.parametrize("search", sorted(SEARCHES))
def test_every_search_reaches_the_optimum_of_a_well_conditioned_problem(search):
    """One pole, white input, from a start that is far off; steepest descent too."""
    rng = np.random.default_rng(23)
    u = rng.normal(size=1000)
    y = lfilter([0, 0.5], [1, -0.6], u) + 0.1 * rng.normal(size=1000)
    model, data = sysid.structures.output_error(1, 1, 1), sysid.IOData(u, y, 1.0)
    best = sysid.fit(model, data, search="lm", options=sysid.Options(tolerance=1e-10))
    fit = sysid.fit(model, data, search=search, start=np.array([3.0, 0.5, 0.0]))
    assert fit.stop.converged
    assert fit.criteria.loss == pytest.approx(best.criteria.loss, rel=2e-4)  # the tolerance is 0.01 % of the loss


@pytest.mark.parametrize("name", ["textbook", "paper_shank"])
def test_scipy_finds_no_better_optimum(name):
    """scipy.optimize.least_squares on the same residuals and Jacobian, from the same start and from our own end."""
    plant = system(name)
    data = plant.record(1500, 0.01, np.random.default_rng(22))
    plain = sysid.Objective(curvature_weight=0.0)
    fit = sysid.fit(plant.chain, data, search="trust_region", objective=plain, options=sysid.Options(tolerance=1e-8))
    start = starts(plant.chain, data, 1, 0)[0]
    problem = ChainProblem.least_squares(plant.chain, start, data.u[:, 0], data.y[:, 0])

    def residual(p):
        e = problem.residual(p)
        return np.full(data.N, 1e3) if e is None else e

    own = np.linalg.solve(plant.chain.basis, fit.theta - start)
    for p0 in (problem.start, own):
        found = least_squares(residual, p0, lambda p: -problem.linearise(p)[1], x_scale="jac", max_nfev=300)
        assert 2 * found.cost / data.N > fit.criteria.loss * (1 - 1e-6)
    assert 2 * found.cost / data.N == pytest.approx(fit.criteria.loss, rel=1e-6)


def test_gradient_says_when_it_ran_out_of_iterations():
    plant = system("paper_thigh")
    fit = sysid.fit(
        plant.chain, plant.record(500, 0.01, np.random.default_rng(1)), search="gradient", options=sysid.Options(3)
    )
    assert not fit.stop.converged
    assert "limit of 3 iterations" in fit.stop.reason
    assert any("did not converge" in w for w in fit.warnings)


def test_equal_seeds_give_equal_numbers_at_any_thread_count(monkeypatch):
    plant = system("paper_shoulder")
    data = plant.record(500, 0.02, np.random.default_rng(3))
    chain = sysid.structures.hammerstein_wiener(3, 3, 1)
    first = sysid.fit(chain, data, seed=4)
    monkeypatch.setattr("sysid.estimation.search.available_cores", lambda: 1)
    second = sysid.fit(chain, data, seed=4)
    np.testing.assert_array_equal(first.theta, second.theta)
    # Another seed draws other candidates.
    assert not np.array_equal(sysid.fit(chain, data, seed=5).theta, first.theta)


@pytest.mark.parametrize(("share", "factor"), [(0.1, 0.25), (0.5, None), (0.9, 2.5)])
def test_the_trust_region_follows_how_much_of_the_predicted_decrease_a_step_reaches(share, factor):
    """Nocedal and Wright, Numerical Optimization (2nd ed. 2006), algorithm 4.1; a step inside the region keeps it."""
    rng = np.random.default_rng(3)
    lin, memory = Linearisation.of(rng.normal(size=40), rng.normal(size=(40, 4))), {"radius": 0.05}

    def attempt(step):
        return lin.cost - share * lin.predicted(step), step

    delta = TrustRegion().step(lin, attempt, memory, sysid.Options()).delta
    length = np.linalg.norm(lin.scaled(delta))
    assert length == pytest.approx(0.05, rel=1e-4)
    assert memory["radius"] == pytest.approx(0.05 if factor is None else factor * length)
