"""Shapes that a fit names: how often the right one, with which numbers, and whether it names one where there is none.

Plants of the tests' own: a map, a filter of two poles, an offset of the output; noise of 1 to 3 % of the output.
"""

import numpy as np
import pytest
from often import FULL, often
from scipy.signal import lfilter

import sysid
from sysid.blocks import Offset, PiecewiseLinear, Saturation
from sysid.data.record import IOData
from sysid.estimation import named_maps
from sysid.estimation.map_shapes import Form, LocalMap
from sysid.estimation.objective import Objective
from sysid.estimation.problem import ChainProblem
from sysid.solver.linearisation import Linearisation
from sysid.uncertainty.bands import linear
from sysid.uncertainty.information import information

A, B, LEVEL = np.array([1.0, -1.5, 0.6]), np.array([0.0, 0.06, 0.04]), 5.0  # static gain 1


def _both(x):
    return np.where(
        x > 0.5, 0.8 * (np.minimum(x, 1.6) - 0.5), np.where(x < -0.4, 1.5 * (np.maximum(x, -1.4) + 0.4), 0.0)
    )


MAPS = {
    "DeadZone": lambda x: x - np.clip(x, -0.6, 0.4),
    "DeadZoneSaturation": _both,
    "Polynomial": lambda x: 0.2 * x**3 - 0.15 * x**2 + 0.5 * x,
    "Saturation": lambda x: np.clip(x, -0.7, 1.3),
}
CORNERS = {"DeadZone": [-0.6, 0.4], "DeadZoneSaturation": [-1.4, -0.4, 0.5, 1.6], "Saturation": [-0.7, 1.3]}
OTHERS = {
    "kinks": lambda x: np.interp(x, [-3.0, -1.0, 0.0, 1.0, 3.0], [-2.0, -1.5, 0.0, 0.4, 3.0]),
    "fold": lambda x: np.abs(x - 0.3),
    "step": lambda x: 0.4 * x + np.tanh(12.0 * x),
    "wave": lambda x: x + 0.6 * np.sin(3.0 * x),
}


def record(structure, curve, seed, scale=1.0, N=1500, noise=True):
    """Random levels with a spread of `scale` through the plant."""
    rng = np.random.default_rng([seed, 71])
    u = np.repeat(scale * rng.normal(size=N // 8 + 1), 8)[:N]
    y = lfilter(B, A, curve(u)) if structure == "hammerstein" else curve(lfilter(B, A, u))
    size = rng.uniform(0.01, 0.03) * np.std(y) * noise
    return IOData(u, y + LEVEL + size * rng.normal(size=N), 0.1)


def fit(structure, data, **options):
    return sysid.fit(sysid.structures.TABLE[structure](nb=2, nf=2, nk=1).model(), data, **options)


def names(result):
    return [type(block).__name__ for block in result.model.blocks]


@pytest.mark.parametrize("structure", ["hammerstein", "wiener"])
@pytest.mark.parametrize("shape", MAPS)
def test_the_shape_of_the_plant_is_named_with_its_numbers(structure, shape):
    """On every record; corners of an input map, in its unit, have intervals that hold them."""
    z = []
    for seed in often(6, 1):
        result = fit(structure, record(structure, MAPS[shape], seed))
        assert shape in names(result), (seed, names(result))
        if structure == "hammerstein" and shape in CORNERS:
            values = [p for p in result.parameters if p.name.startswith("input.") and "gain" not in p.name]
            z += [(p.value - true) / p.std for p, true in zip(values, CORNERS[shape], strict=True)]
    assert not z or (np.mean(np.abs(z) < 1.96) >= 0.8 and np.max(np.abs(z)) < 5.0)


@pytest.mark.parametrize("structure", ["hammerstein", "wiener"])
@pytest.mark.parametrize("other", OTHERS)
def test_no_shape_is_named_where_there_is_none(structure, other):
    for seed in often(4, 1):
        result = fit(structure, record(structure, OTHERS[other], seed))
        assert "PiecewiseLinear" in names(result), (seed, names(result))


@pytest.mark.parametrize("shape", ["Saturation", "Polynomial", "DeadZone"])
def test_a_named_shape_goes_on_beyond_the_record(shape):
    """Levels of twice the spread: the errors of the model are far below those of break points."""
    ratios = []
    for seed in often(4, 2):
        data, unseen = (
            record("hammerstein", MAPS[shape], seed),
            record("hammerstein", MAPS[shape], seed + 50, 2.0, noise=False),
        )
        errors = [
            np.std((unseen.y[:, 0] - fit("hammerstein", data, objective=Objective(shapes=s)).simulate(unseen))[200:])
            for s in (True, False)
        ]
        ratios.append(errors[0] / errors[1])
    assert np.median(ratios) < 0.3, ratios


def test_the_promise_is_the_change_of_bic(monkeypatch):
    """What the linearised fit tells of a shape is what the search with it ends with: half within 5, of 40 all in 20."""
    promises, bics, away = [], [], []
    promise, bic = named_maps.promise, named_maps._bic
    monkeypatch.setattr(named_maps, "promise", lambda *a: promises.append(promise(*a)) or promises[-1])
    monkeypatch.setattr(named_maps, "_bic", lambda *a: bics.append(bic(*a)) or bics[-1])
    for structure in ("hammerstein", "wiener"):
        for shape in MAPS if FULL else ("DeadZone", "Polynomial"):
            for seed in range(3):
                promises.clear()
                bics.clear()
                fit(structure, record(structure, MAPS[shape], seed))
                away.append(abs(bics[1] - bics[0] - min(promises)))
                assert min(promises) < -10.0
    assert np.median(away) < 5.0, away


def test_local_errors_are_those_of_the_best_other_parameters():
    """Brute force: every other parameter is free, the values of the map are given."""
    data = record("wiener", OTHERS["wave"], 3)
    result = fit("wiener", data, objective=Objective(shapes=False))
    chain, theta = result.model, result.theta
    part, block = chain.index(chain.blocks[1]), chain.blocks[1]
    problem = ChainProblem(chain, theta[None], data.experiments, chain.free)
    e, J = problem.linearise(problem.start)
    lin = Linearisation.of(e, J)
    local = LocalMap.of(problem, theta[None], lin, part, block.at)
    rng = np.random.default_rng(5)
    for _ in range(5):
        v = theta[part] + 0.01 * np.ptp(theta[part]) * rng.normal(size=part.stop - part.start)
        left = e - J[:, part] @ (v - theta[part])
        others = np.delete(J, np.arange(part.start, part.stop), axis=1)
        best = left - others @ np.linalg.lstsq(others, left, rcond=None)[0]
        got = (float(np.sum(local.errors(v / local.size) ** 2)) + local.rest) * lin.cost / lin.N
        assert got == pytest.approx(float(best @ best), rel=1e-6)


def test_a_fit_goes_on_with_its_shape_and_gives_it_up_where_another_record_has_another():
    first = fit("hammerstein", record("hammerstein", MAPS["Saturation"], 2))
    again = fit("hammerstein", record("hammerstein", MAPS["Saturation"], 2), start=first)
    assert names(again) == names(first) == ["Saturation", "TransferFunction", "Offset"]
    assert again.criteria.bic == pytest.approx(first.criteria.bic, abs=0.5)
    other = fit("hammerstein", record("hammerstein", OTHERS["wave"], 2), start=first)
    assert isinstance(other.model.blocks[0], PiecewiseLinear)
    fresh = fit("hammerstein", record("hammerstein", OTHERS["wave"], 2))
    assert other.criteria.mse < 1.1 * fresh.criteria.mse


def test_a_saved_fit_remembers_what_it_was_asked_for(tmp_path):
    result = fit("hammerstein", record("hammerstein", MAPS["DeadZone"], 4))
    result.save(tmp_path / "model.json")
    loaded = sysid.load(tmp_path / "model.json")
    assert loaded.model == result.model
    assert names(loaded) == ["DeadZone", "TransferFunction", "Offset"]
    assert [type(block).__name__ for block in loaded.model.asked] == ["PiecewiseLinear", "TransferFunction"]
    assert isinstance(loaded.model.blocks[-1], Offset)


def test_shapes_are_left_out_on_request():
    data = record("hammerstein", MAPS["Saturation"], 5)
    assert "PiecewiseLinear" in names(fit("hammerstein", data, objective=Objective(shapes=False)))


def test_a_curve_that_saturates_is_no_cubic():
    """tanh over a range in which it looks like one: four times the range is not missed by a power of it."""
    for seed in range(4):
        data = record("hammerstein", np.tanh, seed, 0.5)
        result = fit("hammerstein", data)
        unseen = record("hammerstein", np.tanh, seed + 50, 2.0, noise=False)
        assert "Polynomial" not in names(result)
        assert np.std(unseen.y[:, 0] - result.simulate(unseen)) < 4.0 * np.std(unseen.y)


def test_the_band_beyond_the_record_is_as_wide_as_that_of_break_points():
    """A saturation that is named: no record says that it goes on, and within the record the band is narrower."""
    data, unseen = record("hammerstein", MAPS["Saturation"], 1), record("hammerstein", MAPS["Saturation"], 51, 3.0)
    runs = []
    for shapes in (True, False):
        result = fit("hammerstein", data, objective=Objective(shapes=shapes))
        info = information(result, data, lags=None)
        runs.append([linear(info, each, level=0.95, noise=False).std[200:] for each in (data, unseen)])
    named, points = runs
    assert np.mean(named[0]) < 0.8 * np.mean(points[0])
    assert 0.5 < np.mean(named[1]) / np.mean(points[1]) < 2.0
    assert np.mean(named[1]) > 5.0 * np.mean(named[0])


@pytest.mark.parametrize("shape", MAPS)
def test_a_shape_with_tails_is_itself_within_the_record_and_open_beyond_it(shape):
    """Its Jacobian is that of finite differences; a tail is the way, and how far the shape bends from a line."""
    result = fit("hammerstein", record("hammerstein", MAPS[shape], 3))
    block = result.model.blocks[0]
    tailed, theta, mean_slope = block.wider(result.model.part(result.theta, block))
    x, steps = np.linspace(-6.0, 6.0, 83), 1e-6 * np.eye(len(theta))
    J = np.empty((len(x), len(theta)))
    tailed.evaluate(theta, x, J, 0)
    numeric = [(tailed.output(theta + h, x) - tailed.output(theta - h, x)) / 2e-6 for h in steps]
    np.testing.assert_allclose(J, np.array(numeric).T, atol=1e-6 * np.abs(J).max())
    low, high = block.found
    assert not np.any(J[(x > low) & (x < high)][:, [0, -1]])
    above = x > high
    y, h = block.output(theta[1:-1], np.array([high - 1e-6, high])), x[above] - high
    bend = np.abs(block.output(theta[1:-1], x[above]) - y[1] - (y[1] - y[0]) / 1e-6 * h)
    np.testing.assert_allclose(J[above, -1], h + bend / mean_slope, rtol=1e-3, atol=1e-6)


@pytest.mark.nightly
def test_corners_that_the_record_does_not_show_are_not_invented():
    """A rectifier, a single limit, and shapes whose second corner is far: a name that fits is not enough."""
    limit = lambda x: np.minimum(x, 1.0)  # noqa: E731
    cases = [(curve, 72, 4) for curve in (lambda x: np.maximum(x, 0.0), limit, OTHERS["fold"])]
    for curve, key, seeds in (*cases, (limit, 74, 8)):  # without its rivals the last is called something else on 4 of 8
        for seed in range(seeds):
            rng = np.random.default_rng([seed, key])
            u = 1.4 * rng.normal(size=400)
            y = lfilter(B, A, curve(u))
            data = IOData(u, y + 0.1 * np.std(y) * rng.normal(size=400), 1.0)
            assert "PiecewiseLinear" in names(fit("hammerstein", data)), seed


@pytest.mark.parametrize(("zero", "level"), [(10.0, 0.0), (1000.0, 1000.0), (-1e6, 3.0)])
def test_signals_far_from_zero(zero, level):
    for seed in often(4, 2):
        rng = np.random.default_rng([seed, 73])
        u = rng.normal(size=500)
        y = lfilter(B, A, np.clip(u, -0.8, 1.0)) + level
        data = IOData(u + zero, y + 0.03 * np.std(y) * rng.normal(size=500), 1.0)
        result = fit("hammerstein", data)
        assert names(result)[0] == "Saturation"
        lower = next(p for p in result.parameters if p.name == "input.lower")
        assert abs(lower.value - zero + 0.8) < max(5.0 * (lower.std or 0.0), 1e-3)


@pytest.mark.parametrize("pole", [0.9, 1.0])
def test_no_level_of_a_shape_is_taken_up_behind_a_filter_that_integrates(pole):
    chain = sysid.structures.hammerstein_wiener(1, 1, 1, "piecewise_linear", "piecewise_linear")
    chain = chain.scaled(np.array([[-1.0], [1.0]]), np.array([[-1.0], [1.0]]))
    theta = np.ones((1, len(chain.names)))
    theta[:, chain.dynamics[0][0]] = [0.5, -pole, 0.0]
    for level in (0.0, 0.3):
        form = Form(Saturation(), np.array([-1.0, 1.0]), 1.0, level, np.zeros(1), 2, True)
        assert (named_maps._replaced(chain, theta, 0, form) is None) == (pole == 1.0)
