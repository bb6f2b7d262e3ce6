"""Maps with many break points and a prior that the record chooses: against known curves, closed forms and truth."""

import numpy as np
import pytest
from often import often
from scipy.signal import lfilter

import sysid
from sysid import IOData, Objective
from sysid.blocks import PiecewiseLinear, TransferFunction
from sysid.estimation.finer_maps import _Maps
from sysid.estimation.problem import ChainProblem
from sysid.model.chain import Chain
from sysid.report.verdict import band_in_words
from sysid.solver.covariance import effective_count
from sysid.solver.linearisation import Linearisation
from sysid.structures import Hammerstein, hammerstein, hammerstein_wiener, wiener
from sysid.uncertainty import bands
from sysid.uncertainty.information import information
from sysid.workflow.evaluation import evaluate
from sysid.workflow.setting import Setting

PLAIN = Objective(knots=0)
BREAK_POINTS = Objective(shapes=False)  # what this file is about; shapes are those of test_named_maps


def through(u):
    """A resonant filter of gain 1."""
    return lfilter([0.0, 0.36], [1.0, -1.2, 0.56], u)


def record(curve, N, deviation, seed, last=None):
    """The record of a Wiener plant with this curve behind its filter, from rest, and y (N,) without noise."""
    rng = np.random.default_rng([N, seed])
    u = np.repeat(rng.uniform(-2.0, 2.0, N), 6)[:N] if last is None else last(rng, N)
    y = curve(through(u))
    return IOData(u, y + deviation * rng.standard_normal(N), 1.0), y


def noise(rng, N):
    """Another kind of input over the same range."""
    return np.clip(1.5 * lfilter([0.5], [1.0, -0.86], rng.standard_normal(N)), -2.0, 2.0)


def departure(fit, curve, deviation, seed=77, within=None):
    """Mean square of the free run's distance from the noise-free output, by the noise variance, on another input.

    `within` a record: only where the curve's input stays in the range that this record has.
    """
    data, y = record(curve, 3000, 0.0, seed, last=noise)
    x, known = through(data.u[:, 0]), (-np.inf, np.inf)
    if within is not None:
        known = np.quantile(through(within.u[:, 0]), (0.0, 1.0))
    counts = (x >= known[0]) & (x <= known[1]) & (np.arange(len(y)) >= 100)
    return float(np.mean((fit.simulate(data) - y)[counts] ** 2)) / deviation**2


def test_changes_of_slope_are_those_of_the_curve():
    block = PiecewiseLinear(free_knots=False, at=(-1.0, 0.0, 0.5, 2.0, 5.0))
    theta = np.array([2.0, 1.0, 1.0, 4.0, 1.0])
    np.testing.assert_allclose(block.slope_changes() @ theta, [1.0, 2.0, -3.0], atol=1e-14)
    assert PiecewiseLinear(at=block.at).slope_changes().shape == (0, 10)
    assert PiecewiseLinear(5, free_knots=False, at=block.at).slope_changes().shape == (0, 5)


def test_a_finer_map_is_the_same_curve_with_break_points_over_the_whole_signal():
    rng = np.random.default_rng(2)
    block = PiecewiseLinear(at=tuple(range(6)))
    theta = np.concatenate([np.linspace(-1.0, 2.0, 6), rng.normal(size=6)])
    x = np.linspace(-1.6, 3.1, 500)
    finer, values = block.finer(theta, x, 40)
    assert finer.n == 40
    assert finer.at[0] == x.min()
    assert finer.at[-1] == x.max()
    assert np.diff(finer.at).max() < 4.7 / 20
    np.testing.assert_allclose(finer.output(values, x), block.output(theta, x), atol=1e-12)
    assert finer.asked() == PiecewiseLinear()
    assert finer.finer(values, 10.0 * x, 80) is None  # places that are given stay, and so does a number
    assert PiecewiseLinear(6).finer(theta, x, 40) is None


def test_the_effective_number_of_parameters_is_the_trace_of_the_hat_matrix():
    rng = np.random.default_rng(3)
    J, W = rng.normal(size=(200, 6)), 5.0 * rng.normal(size=(4, 6))
    full = Linearisation.of(np.zeros(204), np.vstack([J, W]))
    expected = np.trace(J @ np.linalg.inv(J.T @ J + W.T @ W) @ J.T)
    assert effective_count(Linearisation.of(np.zeros(200), J), full) == pytest.approx(expected, rel=1e-10)


@pytest.mark.parametrize("seed", often(12, 1))
def test_a_smooth_curve_is_followed_where_ten_break_points_cannot(seed):
    """60 dB: ten lines miss a cubic curve by 700 times the variance of the noise, fifty by 2 to 5 (eight seeds)."""
    deviation = 1e-3
    data, _ = record(_cubic, 1500, deviation, seed)
    coarse, fine = (sysid.fit(wiener(1, 2, 1), data, objective=o) for o in (PLAIN, None))
    missed, left = (departure(fit, _cubic, deviation, within=data) for fit in (coarse, fine))
    assert left < min(10.0, 0.02 * missed)
    np.testing.assert_allclose(np.sort(fine.poles), np.sort(np.roots([1.0, -1.2, 0.56])), atol=2e-3)


@pytest.mark.parametrize("seed", often(12, 1))
def test_a_corner_stays_a_corner(seed):
    """A saturation at 30 dB: what fifty break points cost beside two known ones is a small part of the noise."""
    deviation = 0.03
    data, _ = record(_saturation, 1500, deviation, seed)
    fine = sysid.fit(wiener(1, 2, 1), data, objective=BREAK_POINTS)
    assert departure(fine, _saturation, deviation) < 0.05
    block = fine.model.blocks[-1]
    slope = np.diff(np.eye(len(block.at)), axis=0) / np.diff(block.at)[:, None]
    slope = slope @ np.eye(len(fine.theta))[fine.model.index(block)]
    info = information(fine, data)
    for row in slope[[0, -1]]:  # the ends are flat, as far as the record can tell
        assert abs(row @ fine.theta) < 3.0 * np.sqrt(row @ info.cov[np.ix_(info.own, info.own)] @ row)


def test_without_a_curve_hardly_any_parameter_is_spent_on_one():
    """A linear plant, noise as large as its output: the effective number is near that of the filter and a line."""
    data, _ = record(lambda x: x, 600, 1.0, 5)
    fine = sysid.fit(hammerstein_wiener(1, 2, 1), data)
    line = sysid.fit(sysid.structures.output_error(1, 2, 1), data)
    assert fine.criteria.d < line.criteria.d + 8
    assert departure(fine, lambda x: x, 1.0) < 0.05


def test_a_record_in_other_units_gives_the_same_fit():
    data, _ = record(_cubic, 800, 0.02, 4)
    other = IOData(1024.0 * data.u, data.y / 1024.0, data.Ts)
    one, two = (sysid.fit(hammerstein_wiener(1, 2, 1), d) for d in (data, other))
    np.testing.assert_allclose(1024.0 * two.simulate(other), one.simulate(data), atol=1e-9)
    assert one.criteria.d == two.criteria.d
    np.testing.assert_allclose(two.pole_std, one.pole_std, rtol=1e-6)


def test_experiments_and_gaps_and_a_file_again(tmp_path):
    parts = [record(_cubic, N, 0.02, 8)[0] for N in (500, 400)]
    lost = np.random.default_rng(1).uniform(size=500) < 0.2
    parts[0] = IOData(parts[0].u, np.where(lost, 1e3, parts[0].y[:, 0]), 1.0, missing=lost)
    fit = sysid.fit(wiener(1, 2, 1), IOData.merge(*parts))
    assert departure(fit, _cubic, 0.02) < 0.3
    again = sysid.load(fit.save(tmp_path / "fit.json"))
    np.testing.assert_array_equal(again.simulate(parts[1]), fit.simulate(parts[1]))


def test_what_is_held_or_given_stays():
    data, _ = record(_cubic, 500, 0.02, 9)
    given = hammerstein(1, 2, 1, input=PiecewiseLinear.evenly_spaced(data.u, 7, role="input"))
    assert sysid.fit(given, data).model.blocks[0].knots == 7
    model = wiener(1, 2, 1, fixed={"output.x5": 0.1})
    assert sysid.fit(model, data).model.blocks == model.blocks
    assert sysid.fit(wiener(1, 2, 1, PiecewiseLinear(4)), data).model.blocks[-1].knots == 4
    for objective in (PLAIN, Objective(ridge=1e-6)):
        assert sysid.fit(wiener(1, 2, 1), data, objective=objective).model.blocks == wiener(1, 2, 1).blocks


@pytest.mark.nightly
def test_a_fit_that_goes_on_keeps_the_prior():
    """On its own record it stays; on another of the same plant it comes as near to the truth as a new fit."""
    deviation, model, departures = 0.02, hammerstein_wiener(1, 2, 1), []
    for seed in often(12, 2):
        (data, _), (other, _) = (record(_cubic, 800, deviation, k) for k in (seed, 100 + seed))
        fit = sysid.fit(model, data, objective=BREAK_POINTS)
        again = sysid.fit(model, data, start=fit, objective=BREAK_POINTS)
        assert again.model == fit.model
        change = again.simulate(data) - fit.simulate(data)
        assert np.mean(change**2) < 0.05 * fit.criteria.d / data.N * deviation**2  # most of 30 seeds: 0.008
        on = sysid.fit(model, other, start=fit, objective=BREAK_POINTS)
        departures.append(
            [departure(each, _cubic, deviation) for each in (on, sysid.fit(model, other, objective=BREAK_POINTS))]
        )
    on, new = np.mean(departures, axis=0)
    assert on < new + 0.05  # of 24 seeds: 0.192 and 0.195


def test_fewer_break_points_than_the_search_has_are_refused():
    with pytest.raises(sysid.InputError, match="at least 12"):
        Objective(knots=5)


def _cubic(x):
    return x + 0.3 * x**3


def _saturation(x):
    return np.clip(x, -1.1, 0.8)


@pytest.mark.parametrize("seed", often(12, 1))
def test_intervals_are_those_of_the_posterior(seed):
    """The covariance of the search, from its own rows, gives the filter the same deviations."""
    data, _ = record(_cubic, 800, 0.05, seed)
    fit = sysid.fit(hammerstein_wiener(2, 2, 1), data)
    info = information(fit, data, lags=None)
    f = [fit.model.names.index(name) for name in ("linear.f1", "linear.f2")]
    np.testing.assert_allclose(np.sqrt(np.diag(info.cov)[info.own][f]), fit.covariance.std()[f], rtol=0.1)
    assert not info.unexcited.shape[1]
    # The count is a whole number, at the noise of the search; the report's is at the noise of the residuals.
    assert abs(data.N - info.dof - fit.criteria.d) < 0.5 + 0.05 * fit.criteria.d


def test_the_band_of_a_free_run_holds_new_measurements_inside_and_beyond_the_range_of_the_record():
    """Drawn inputs of twice the range; beyond it the band is wide, since no record says what the map does there."""
    deviation, held, widths = 0.05, [], []
    for seed in often(60, 6):
        data, _ = record(_saturation, 600, deviation, seed)
        rng = np.random.default_rng(900 + seed)
        u = np.clip(rng.uniform(0.5, 2.0) * noise(rng, 1500), -4.0, 4.0)
        x = through(u)
        y = _saturation(x) + deviation * rng.standard_normal(len(u))
        fit = sysid.fit(wiener(1, 2, 1), data)
        info = information(fit, data, lags=None)
        seen = through(data.u[:, 0])
        beyond = (x < seen.min()) | (x > seen.max())
        for level in (0.5, 0.95):
            run = bands.linear(info, IOData(u, y, 1.0), level=level, noise=True)
            inside = (run.lower <= y) & (y <= run.upper)
            held.append((np.mean(inside), np.mean(inside[~beyond])))
        widths.append((np.max(run.std[beyond], initial=0.0), np.max(run.std[~beyond])))
    shares = np.array(held).reshape(-1, 2, 2).mean(axis=0)  # (levels, all and inside)
    np.testing.assert_allclose(shares[0], 0.5, atol=0.06)
    np.testing.assert_allclose(shares[1], 0.95, atol=0.02)
    assert max(w for w, _ in widths) > 5.0 * max(w for _, w in widths)


@pytest.mark.parametrize(
    ("span", "words"), [(1.0, "most of its width is noise"), (1.6, "not noise"), (6.0, "wider than the output itself")]
)
def test_a_report_says_what_the_band_of_the_validation_run_is_made_of(span, words):
    """A straight part of a map tells nothing of what comes beyond it, and the band says so."""
    rng = np.random.default_rng(11)
    u = np.repeat(rng.uniform(-1.0, 1.0, 200), 8)[:, None]
    y = through(np.tanh(np.concatenate([u, span * u])[:, 0])) + 0.03 * rng.standard_normal(2 * len(u))
    parts = (IOData(u, y[: len(u)], 1.0), IOData(span * u, y[len(u) :], 1.0))
    evaluation = evaluate(Setting(Hammerstein(1, 2, 1)), *parts)
    (sentence,) = band_in_words(evaluation)
    assert words in sentence
    assert evaluation.held == pytest.approx(0.95, abs=0.03 if span == 1.0 else 0.06)


@pytest.mark.parametrize("seed", range(3))
def test_the_prior_does_not_depend_on_the_scale_between_a_map_and_the_filter_behind_it(seed):
    """Its changes of slope count by the deviation of the map's output, against differences; a scale changes nothing.

    Where a smaller scale was a smoother map, it shrank until one value beyond the signal's range held it: one of 120
    fits ran to 43 times the output.
    """
    rng = np.random.default_rng(seed)
    block = PiecewiseLinear(role="input", free_knots=False, at=tuple(np.sort(rng.uniform(-1.0, 1.0, 8))))
    linear = TransferFunction(2, 1, 1, role="linear")
    chain = Chain((block, linear))
    theta = np.concatenate([rng.normal(size=8), [1.0, 0.5, -0.7], np.zeros(2)])
    u = rng.uniform(-1.2, 1.2, 300)
    rows = np.zeros((6, len(theta)))
    rows[:, :8] = block.slope_changes()
    experiments = tuple(IOData(part, np.ones(len(part)), 1.0) for part in (np.sort(u)[:200], np.sort(u)[200:]))
    problem = ChainProblem(chain, np.tile(theta, (2, 1)), experiments, chain.free)
    prior = _Maps(rows, (slice(0, 6),), (0,)).prior(problem, problem.theta0)

    def relative(theta):
        return -rows @ theta / np.std(chain.signals(theta, u)[1])

    unit = np.std(chain.signals(theta, u)[1])
    np.testing.assert_allclose(prior.errors(theta), unit * relative(theta), atol=1e-12)
    for i in range(len(theta)):
        h = 1e-6 * np.eye(len(theta))[i]
        difference = unit * (relative(theta + h) - relative(theta - h)) / 2e-6
        np.testing.assert_allclose(-prior.rows[:, i], difference, atol=1e-6)
    scaled = theta.copy()
    scaled[:8] *= 0.01
    np.testing.assert_allclose(prior.rows @ (theta - scaled), 0.0, atol=1e-12)


@pytest.mark.parametrize("seed", often(12, 2))
def test_maps_do_not_follow_noise_that_remembers(seed):
    """Noise that remembers five samples has slow waves, which 50 places could follow: d was 32 to 42."""
    rng = np.random.default_rng(seed)
    u, unseen = (np.repeat(rng.uniform(-size, size, 200), 5) for size in (1.5, 1.4))
    y, truth = (lfilter([0.0, 0.3], [1.0, -0.7], np.tanh(1.3 * x)) for x in (u, unseen))
    deviation = 0.1 * y.std()
    noise = deviation * lfilter([0.6], [1.0, -0.8], rng.standard_normal(len(u)))
    fit = sysid.fit(hammerstein(1, 1, 1), IOData(u, y + noise, 1.0))
    error = (fit.simulate(IOData(unseen, truth, 1.0)) - truth)[100:]
    assert fit.criteria.d < 20
    assert np.sqrt(np.mean(error**2)) < 0.4 * deviation


def test_a_record_that_is_taken_in_pieces_has_the_same_maps(monkeypatch):
    data, _ = record(_cubic, 900, 0.05, 21)
    whole = sysid.fit(wiener(1, 2, 1), data)
    monkeypatch.setattr("sysid.estimation.problem.LONG", 500)
    pieces = sysid.fit(wiener(1, 2, 1), data)
    assert pieces.criteria.d == pytest.approx(whole.criteria.d, abs=1)
    gap = pieces.simulate(data) - whole.simulate(data)
    assert np.std(gap) < 0.001
