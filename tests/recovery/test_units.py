"""Units, offsets and odd records: what a fit must not depend on, and what it is never worse than."""

from dataclasses import replace

import numpy as np
import pytest
from often import FULL, by_day, often

import sysid
from sysid.base.criteria import fit_percent
from sysid.block.symmetry import direction
from sysid.blocks import STATIC, CubicSpline, Custom, PiecewiseLinear, WaveletNetwork
from sysid.estimation import guard, search
from sysid.estimation.normal import Normal
from sysid.estimation.starts import starts
from sysid.model.transforms import rescale

S = sysid.structures


def record(N=300, seed=0):
    rng = np.random.default_rng(seed)
    u = rng.normal(size=N)
    return u, np.convolve(u, [0, 0.5, 0.3])[:N] + 0.01 * rng.normal(size=N)


@pytest.mark.parametrize("model", [S.output_error(2, 2, 1), S.nlarx(2, 2, 1, units=0)], ids=["chain", "network"])
@pytest.mark.parametrize("factor", [1e160, 1e-165])
def test_numbers_that_no_plant_has_are_refused_with_what_to_do(model, factor):
    u, y = record()
    for data, name in ((sysid.IOData(factor * u, y), "input"), (sysid.IOData(u, factor * y), "output")):
        with pytest.raises(sysid.InputError, match=rf"the {name} .*rescale the signal"):
            sysid.fit(model, data)


def nonlinear(N=200):
    """A dead zone, a filter and a bend: what starts and searches find here depends on many shares and limits."""
    rng = np.random.default_rng(11)
    u = np.repeat(rng.normal(0.3, 1.0, N // 4), 4)
    x, y = np.where(np.abs(u) > 0.3, u, 0.0), np.zeros(N)
    for t in range(2, N):
        y[t] = 1.3 * y[t - 1] - 0.42 * y[t - 2] + 0.12 * x[t - 1]
    y = y + 0.2 * y**2
    return u, y + 0.01 * np.std(y) * rng.normal(size=N)


UNITS = [(2.0**10, 1.0), (1.0, 2.0**-20), (2.0**-7, 2.0**9)]
LAWS = {
    "output_error": S.output_error(2, 2, 1),
    "dead_zone": S.hammerstein(2, 2, 1, input="dead_zone"),
    "dead_zone_saturation": S.hammerstein(2, 2, 1, input="dead_zone_saturation"),
    "polynomial": S.hammerstein_wiener(2, 2, 1, input="polynomial", output="saturation"),
    "saturation": S.hammerstein_wiener(2, 2, 1, input="saturation", output="sigmoid_network"),
    "piecewise_linear": S.wiener(2, 2, 1),
    "monotone": S.hammerstein(1, 1, 1, input=CubicSpline(4, monotone=True)),
    "wavelet_network": S.wiener(1, 1, 1, output=WaveletNetwork(1, 1)),
    "between": S.wiener_hammerstein(1, 1, 0, 1, 1, 1, middle="polynomial"),
    "state_space": S.state_space(1, 1),
    "prediction": S.nlarx(2, 2, 1, units=2),
    "simulation": S.nlarx(1, 1, 1, units=1, focus="simulation"),
}


@pytest.mark.parametrize("name", LAWS)
def test_a_fit_in_other_units_is_the_same_to_the_bit(name):
    u, y = nonlinear()
    options = sysid.Options(max_iterations=8)
    plain = sysid.fit(LAWS[name], sysid.IOData(u, y), starts=1, options=options)
    for a, b in UNITS:
        fit = sysid.fit(LAWS[name], sysid.IOData(a * u, b * y), starts=1, options=options)
        np.testing.assert_array_equal(run(fit, a * u, b * y) / b, run(plain, u, y))
        assert fit.criteria.mse == plain.criteria.mse * b**2
        assert [row["loss"] for row in fit.history] == [row["loss"] * b**2 for row in plain.history]
        assert fit.losses == tuple(loss * b**2 for loss in plain.losses)
        np.testing.assert_allclose(deviations(fit), deviations(plain), rtol=1e-6)


SIGNS = [(-1.0, 1.0), (1.0, -1.0), (-1.0, -1.0), (-(2.0**10), 2.0**-3)]
STRUCTURES = (
    LAWS
    | {f"hammerstein {name}": S.hammerstein(1, 1, 1, input=name) for name in STATIC}
    | {f"wiener {name}": S.wiener(1, 1, 1, output=name) for name in STATIC}
    | {
        "both": S.hammerstein_wiener(1, 1, 1, input="sigmoid_network", output="wavelet_network"),
        "before and behind": S.hammerstein_wiener(1, 2, 1, input="cubic_spline", output="cubic_spline"),
        "monotone behind": S.wiener(1, 1, 1, output=CubicSpline(4, monotone=True)),
        "fixed knots": S.wiener(1, 1, 1, output=PiecewiseLinear(4, free_knots=False, at=(-1.0, 0.0, 0.5, 2.0))),
        "several states": S.state_space(2, 2),
        "polynomial states": S.state_space(1, 0, degree=2),
        "chosen size": S.nlarx(1, 1, 1),
    }
)


# By day every kind of map somewhere; by night each before a filter and behind one.
MIRRORED = (*LAWS, "before and behind", "fixed knots", "polynomial states")


@pytest.mark.parametrize("name", by_day(STRUCTURES, *MIRRORED))
def test_a_fit_of_the_mirror_image_of_a_record_is_the_mirror_image_of_the_fit(name):
    """Searches take the same steps to the bit. A map that is turned round rounds the other way when it is run.

    So do its values at the places of a finer map, with which the last search begins.
    """
    u, y = nonlinear()
    model, options = STRUCTURES[name], sysid.Options(max_iterations=4)
    plain = sysid.fit(model, sysid.IOData(u, y), starts=1, options=options)
    for a, b in SIGNS if FULL else SIGNS[1::2]:
        turned = with_knots(model, b) if name == "fixed knots" else model  # these are values of the output
        fit = sysid.fit(turned, sysid.IOData(a * u, b * y), starts=1, options=options)
        losses, expected = ([row["loss"] / size for row in each.history] for each, size in ((fit, b**2), (plain, 1.0)))
        if fit.model != turned:  # finer maps
            np.testing.assert_allclose(losses, expected, rtol=1e-9)
        else:
            assert losses == expected
        assert fit.losses == tuple(loss * b**2 for loss in plain.losses)
        assert fit.stop == plain.stop
        np.testing.assert_allclose(run(fit, a * u, b * y) / b, run(plain, u, y), rtol=0.0, atol=1e-9 * np.std(y))
        assert fit.criteria.mse == pytest.approx(plain.criteria.mse * b**2, rel=1e-9)
        assert fit.covariance.unidentifiable.sum() == plain.covariance.unidentifiable.sum()
        assert fit.warnings == plain.warnings


def with_knots(model, b):
    """The map behind the filter with its break points at b times those of the model."""
    behind = model.blocks[-1]
    places = tuple(sorted(b * x for x in behind.at))
    return replace(model, blocks=(*model.blocks[:-1], replace(behind, at=places)))


@pytest.mark.parametrize("name", ["piecewise_linear", "dead_zone", "dead_zone_saturation", "monotone", "polynomial"])
def test_parameters_and_covariances_move_with_a_sign_also_with_gaps_in_the_record(name):
    u, y = nonlinear()
    model, options = LAWS[name], sysid.Options(max_iterations=4)
    missing = np.arange(len(y)) % 17 == 5
    plain = sysid.fit(model, sysid.IOData(u, y, missing=missing), starts=1, options=options)
    for a, b in SIGNS[:2]:
        fit = sysid.fit(model, sysid.IOData(a * u, b * y, missing=missing), starts=1, options=options)
        M = rescale(fit.model, np.array([a]), np.array([b])).M
        np.testing.assert_allclose(fit.theta, M @ plain.theta, rtol=1e-9, atol=1e-12)
        np.testing.assert_allclose(fit.covariance.cov, M @ plain.covariance.cov @ M.T, rtol=1e-6, atol=1e-12)
        np.testing.assert_array_equal(fit.covariance.unidentifiable, np.abs(M) @ plain.covariance.unidentifiable > 0.0)


@pytest.mark.parametrize("name", ["state_space", "prediction", "simulation"])
def test_standard_deviations_of_states_and_networks_follow_a_sign(name):
    u, y = nonlinear()
    fits = [
        sysid.fit(LAWS[name], sysid.IOData(a * u, b * y), starts=1, options=sysid.Options(max_iterations=4))
        for a, b in ((1.0, 1.0), (-1.0, 1.0), (1.0, -1.0))
    ]
    for other in fits[1:]:
        np.testing.assert_array_equal(np.abs(other.theta), np.abs(fits[0].theta))
        np.testing.assert_allclose(other.covariance.std(), fits[0].covariance.std(), rtol=1e-9)


def test_a_record_of_several_channels_is_one_with_its_mirror_images():
    rng = np.random.default_rng(4)
    u = rng.normal(0.2, 1.0, (200, 2))
    y = np.column_stack([np.convolve(u[:, 0] + 0.2 * u[:, 0] ** 2, [0, 0.5, 0.3])[:200], np.roll(u[:, 1], 1)])
    y = y + 0.01 * rng.normal(size=y.shape)
    for model in (S.hammerstein(1, 1, 1, input="polynomial", nu=2, ny=2), S.state_space(2, 1, nu=2, ny=2)):
        plain = sysid.fit(model, sysid.IOData(u, y), starts=1, options=sysid.Options(max_iterations=4))
        for a, b in (([-1, 1], [1, 1]), ([1, -1], [-1, 1]), ([-1, -1], [-1, -1])):
            fit = sysid.fit(model, sysid.IOData(a * u, b * y), starts=1, options=sysid.Options(max_iterations=4))
            assert [row["loss"] for row in fit.history] == [row["loss"] for row in plain.history]
            np.testing.assert_allclose(
                fit.model.outputs(fit.theta, a * u) * b, plain.model.outputs(plain.theta, u), rtol=0.0, atol=1e-9
            )


@pytest.mark.parametrize("factor", [2.0**-7, 3600.0, *([1e3, 0.1] if FULL else [])])
def test_the_sampling_time_changes_no_discrete_model(factor):
    u, y = nonlinear()
    for name in ("output_error", "dead_zone", "piecewise_linear", "state_space", "simulation"):
        fits = [
            sysid.fit(LAWS[name], sysid.IOData(u, y, Ts), starts=1, options=sysid.Options(max_iterations=4))
            for Ts in (1.0, factor)
        ]
        np.testing.assert_array_equal(fits[0].theta, fits[1].theta)
        np.testing.assert_array_equal(fits[0].covariance.cov, fits[1].covariance.cov)
        other = sysid.IOData(u[50:], y[50:])
        np.testing.assert_array_equal(fits[0].simulate(other), fits[1].simulate(replace(other, Ts=factor)))


@pytest.mark.parametrize("factor", [1.0, 2.0**-100, 1e3, 1e55])
def test_a_direction_turns_with_the_signal_and_with_nothing_else(factor):
    rng = np.random.default_rng(3)
    t = np.arange(400.0)
    signals = {
        "skewed": rng.exponential(size=400),
        "two levels": np.sign(np.sin(0.31 * t)),
        "ramp": t,
        "whole periods": np.cos(2 * np.pi * t / 40),
        "there and back": np.minimum(t, 399.0 - t),
    }
    for x in signals.values():
        plain = direction(x)
        assert plain in (1.0, -1.0)
        assert direction(factor * x) == plain
        assert direction(-factor * x) == -plain
        assert direction(factor * (x + 10.0)) == plain
    assert direction(np.full(5, 3.0)) == 1.0


def test_a_structure_takes_the_signs_that_its_maps_have_laws_for():
    """A function of the user's own stands on the input: nothing is promised for -u, but -y is the same fit."""
    own = Custom(lambda x, p: p[0] * np.arctan(x) + x**2, names=("height",), initial=(1.0,))
    u, y = nonlinear()
    fits = [
        sysid.fit(
            S.hammerstein(1, 1, 1, input=own), sysid.IOData(u, b * y), starts=1, options=sysid.Options(max_iterations=4)
        )
        for b in (1.0, -1.0)
    ]
    np.testing.assert_array_equal(run(fits[0], u, y), -run(fits[1], u, -y))


def deviations(fit):
    """Standard deviations as shares of the values."""
    return [np.nan if p.std is None else p.std / max(abs(p.value), 1e-300) for p in fit.parameters]


def run(fit, u, y):
    return fit.predict(sysid.IOData(u, y)) if isinstance(fit, sysid.NlarxFit) else fit.model.simulate(fit.theta, u)


def test_the_span_of_a_spline_is_in_the_units_of_the_record():
    u, y = nonlinear()
    fits = [
        sysid.fit(
            S.hammerstein(2, 2, 1, input=CubicSpline(4, span=(-3.0 * a, 3.0 * a))), sysid.IOData(a * u, y), starts=1
        )
        for a in (1.0, 2.0**10)
    ]
    np.testing.assert_array_equal(run(fits[1], 2.0**10 * u, y), run(fits[0], u, y))


def test_held_values_and_limits_keep_their_meaning_in_other_units():
    u, y = nonlinear()
    held = {"fixed": {"input.lower": -0.3}, "bounds": {"input.upper": (0.1, 0.2), "linear.b0": (0.0, 0.05)}}
    model = S.hammerstein(2, 2, 1, input="dead_zone", **held)
    fit = sysid.fit(model, sysid.IOData(u, y), starts=1)
    assert dict(zip(fit.model.names, fit.theta, strict=True))["input.lower"] == -0.3
    tiny = {"fixed": {"input.lower": -0.3 / 1024}, "bounds": {"input.upper": (0.1 / 1024, 0.2 / 1024)}}
    tiny["bounds"]["linear.b0"] = (0.0, 0.05 * 1024)
    model = S.hammerstein(2, 2, 1, input="dead_zone", **tiny)
    other = sysid.fit(model, sysid.IOData(u / 1024, y), starts=1)
    np.testing.assert_array_equal(run(other, u / 1024, y), run(fit, u, y))
    turned = {"fixed": {"input.upper": 0.3}, "bounds": {"input.lower": (-0.2, -0.1), "linear.b0": (-0.05, 0.0)}}
    there = rescale(S.hammerstein(2, 2, 1, input="dead_zone", **held), np.array([-1.0]), np.ones(1)).chain
    assert (there.fixed, there.bounds) == (turned["fixed"], turned["bounds"])
    model = S.hammerstein(2, 2, 1, input="dead_zone", **turned)
    other = sysid.fit(model, sysid.IOData(-u, y), starts=1)
    assert other.model.fixed == turned["fixed"]
    np.testing.assert_array_equal(run(other, -u, y), run(fit, u, y))
    np.testing.assert_allclose(np.sort(other.covariance.std()), np.sort(fit.covariance.std()))


def test_a_map_of_the_users_own_keeps_its_units():
    """Nobody knows the law of a function: only the output behind the filter is fitted in normal units."""
    own = Custom(lambda x, p: p[0] * np.arctan(x), names=("height",), initial=(1.0,))
    u, y = nonlinear()
    fits = [sysid.fit(S.hammerstein(2, 2, 1, input=own), sysid.IOData(u, b * y), starts=1) for b in (1.0, 2.0**30)]
    np.testing.assert_array_equal(*(run(fit, u, y) / b for fit, b in zip(fits, (1.0, 2.0**30), strict=True)))


def test_a_ridge_is_in_the_units_of_the_record():
    u, y = record()
    stiff = sysid.Objective(ridge=1.0, nominal={"linear.b0": 0.5})
    small = sysid.fit(S.output_error(1, 1, 1), sysid.IOData(u, y), objective=stiff)
    large = sysid.fit(S.output_error(1, 1, 1), sysid.IOData(u, 1e3 * y), objective=stiff)
    assert abs(large.theta[1]) > abs(small.theta[1]), "beside larger errors the same ridge weighs less"


@pytest.mark.parametrize("factor", [1e-165, 1e-300, 1e300])
def test_the_fit_of_a_tiny_output_is_that_of_the_same_output_in_other_units(factor):
    _, y = record()
    assert fit_percent(factor * y, factor * 0.5 * y) == pytest.approx(50.0, abs=0.5)
    assert fit_percent(factor * np.ones(9), factor * np.ones(9)) == 100.0


@pytest.mark.parametrize("chain", [S.wiener(2, 2, 1, output="polynomial"), S.output_error(2, 2, 1)])
def test_a_portfolio_that_ends_above_the_linear_start_goes_on_from_there(chain):
    u, y = record()
    data = sysid.IOData(u, y)
    run = search.SearchContext(chain, data, sysid.Objective(), "lm", sysid.Options(), None)
    poor = np.zeros(len(chain.names))
    problem = run.problem(poor[None])
    found = search.SearchResult(
        problem, run.iterate(problem, problem.start, sysid.Options(max_iterations=0)), (1.0,), ("drawn",)
    )
    first = guard.linear_reference(run, found, 0)
    better = guard.continue_from_reference(run, found, first)
    assert better.outcome.cost < 0.01 * found.outcome.cost
    assert better.members == ("drawn", "linear")
    assert guard.continue_from_reference(run, better, first) is better, "a result that is good enough stays what it is"


def test_smoothing_puts_no_fit_above_its_linear_start(monkeypatch):
    """Short records that are half noise: the linear start has a curve with kinks, which the fit is to smooth."""
    chain = S.hammerstein_wiener(1, 2, 0, input="unit_gain", output="piecewise_linear")
    weights = []

    def seen(context, result, reference):
        eased = guard.ease_curvature(context, result, reference)
        weights.append((result.problem.curvature_weight, eased.problem.curvature_weight))
        return eased

    monkeypatch.setattr("sysid.estimation.fit.ease_curvature", seen)
    for seed in often(20, 8):
        rng = np.random.default_rng([seed, 9])
        u, y = rng.normal(size=100), np.zeros(100)
        for t in range(1, 100):
            y[t] = 0.8 * y[t - 1] + 0.2 * np.tanh(2.0 * u[t - 1])
        data = sysid.IOData(u, y + 0.5 * np.std(y) * rng.normal(size=100))
        there = Normal.choose(chain.scaled(data.u, data.y), data, sysid.Objective(knots=0))
        theta = starts(there.chain, there.data, 1, 0)[0]
        errors = there.size * (there.data.y - there.chain.outputs(theta, there.data.u))
        fit = sysid.fit(
            chain, data, starts=1, options=sysid.Options(max_iterations=20), objective=sysid.Objective(knots=0)
        )
        assert fit.criteria.mse <= np.mean(errors**2), seed
    eased = [after / before for before, after in weights if after < before]
    assert eased
    assert np.count_nonzero(eased) >= len(eased) / 2, "smoothing is made weaker, and seldom left out"
    assert {round(share, 9) for share in eased} <= {0.0, 0.1, 0.01, 0.001}, "up to three times, each time to a tenth"


def test_a_fit_further_away_than_the_mean_is_told():
    u, y = record()
    told = sysid.fit(S.output_error(1, 0, 1, fixed={"linear.b0": -3.0}), sysid.IOData(u, y)).warnings
    assert any("further from the output than the output's own mean" in text for text in told)
    assert not sysid.fit(S.output_error(2, 2, 1), sysid.IOData(u, y)).warnings


def test_a_network_is_not_worse_than_the_linear_model_of_its_orders(monkeypatch):
    """Where every start of a network ends badly, here at a theta of zero, the linear model is the result."""
    u, y = record()
    data = sysid.IOData(u, y)

    def poor(runs, pieces, lag):
        return replace(runs[0], outcome=replace(runs[0].outcome, p=0.0 * runs[0].outcome.p))

    for focus in ("prediction", "simulation"):
        linear = sysid.fit_nlarx(S.nlarx(2, 2, 1, units=0, focus=focus), data)
        with monkeypatch.context() as patch:
            patch.setattr("sysid.nlarx.fit._best", poor)
            network = sysid.fit_nlarx(S.nlarx(2, 2, 1, units=3, focus=focus), data, starts=1)
        assert network.criteria.mse <= linear.criteria.mse * (1 + 1e-6)
