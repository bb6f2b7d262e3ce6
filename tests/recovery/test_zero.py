"""The zero of an output is a parameter: drawn plants, identified from a file with the defaults."""

import numpy as np
import pytest
from often import often
from scipy.signal import cont2discrete, lfilter

import sysid
from sysid import IOData, structures
from sysid.estimation.starts.portfolio.candidates import starting_points
from sysid.structures import Hammerstein, OutputError, Wiener, hammerstein, hammerstein_wiener, output_error, wiener
from sysid.workflow.identification import identify_file
from sysid.workflow.setting import Setting

TS = 0.05
MAPS = {
    "saturation": lambda x, low, high: np.clip(x, low, high),
    "dead_zone": lambda x, low, high: np.where(x < low, x - low, np.where(x > high, x - high, 0.0)),
}


def plant(kind, rng):
    """u, y (N,) without noise and the settings of its structure: far from zero in input and output, or from rest."""
    N = int(rng.choice([400, 800, 2000]))
    u = np.repeat(rng.uniform(-1.0, 1.0, N // 4), int(rng.integers(4, 20)))[:N] * rng.uniform(1.0, 10.0)
    u += rng.uniform(-1.0, 1.0) * np.ptp(u) * (kind != "motor")
    pole, gain, name = rng.uniform(0.6, 0.95), rng.uniform(0.5, 3.0), str(rng.choice(sorted(MAPS)))
    orders = {"nb": 1, "nf": 1, "nk": 1}

    def filtered(w):
        return lfilter([0.0, gain * (1.0 - pole)], [1.0, -pole], w)

    def bent(x):
        return MAPS[name](x, *np.quantile(x, [0.2, 0.8]))

    if kind == "motor":  # volts to angle
        b, a, _ = cont2discrete(([rng.uniform(2.0, 12.0)], [rng.uniform(0.03, 0.3), 1.0, 0.0]), TS)
        return u, lfilter(b[0], a, u), OutputError(2, 2, 1)
    if kind == "far from rest":
        y = filtered(u)
        return u, y + rng.uniform(-3.0, 3.0) * np.ptp(y) * pole ** np.arange(N), OutputError(**orders)
    if kind == "hammerstein":
        return u, filtered(bent(u)), Hammerstein(**orders, input_map=name)
    return u, bent(filtered(u)), Wiener(**orders, output_map=name)


@pytest.mark.parametrize("kind", ["motor", "far from rest", "hammerstein", "wiener"])
@pytest.mark.parametrize("seed", often(60, 1))
def test_a_plant_comes_back_from_a_file_with_the_defaults(kind, seed, tmp_path):
    rng = np.random.default_rng([seed, 33])
    u, y, recipe = plant(kind, rng)
    noise = 0.01 * y.std() * rng.normal(size=len(y))
    y = y + noise + rng.uniform(-20.0, 20.0) * y.std()
    rows = np.column_stack([TS * np.arange(len(u)), u, y])
    np.savetxt(tmp_path / "log.csv", rows, delimiter=",", header="t,u,y", comments="", fmt="%.12g")
    e = identify_file(tmp_path / "log.csv", Setting(recipe), "u", "y").evaluation
    assert e.fit.criteria.mse < 1.1 * np.mean(noise[: e.estimation.N] ** 2)
    assert not e.estimation.y_offset.any()


@pytest.mark.parametrize(
    ("structure", "options", "held"),
    [
        (output_error, {}, False),
        (output_error, {"nu": 2, "ny": 2}, False),
        (hammerstein, {}, True),
        (hammerstein, {"ny": 2}, False),  # one map before two outputs
        (hammerstein, {"input": "saturation"}, False),
        (wiener, {}, True),
        (wiener, {"output": "dead_zone"}, False),
        (wiener, {"output": ["polynomial", "saturation"], "ny": 2}, False),
        (hammerstein_wiener, {"output": "saturation"}, True),  # limits that move pass the offset of the first map
        (hammerstein_wiener, {"output": "dead_zone"}, False),
        (hammerstein_wiener, {"input": "saturation", "output": "saturation"}, False),
    ],
)
def test_an_offset_is_added_where_no_map_holds_it(structure, options, held):
    """A constant is a combination of the sensitivities, here finite differences, exactly where a map holds it."""
    plain, free = (structure(1, 1, 1, offset=offset, **options) for offset in ("none", "free"))
    assert (plain.names == free.names) == held
    rng = np.random.default_rng(0)
    nu, ny = plain.channels
    u = np.repeat(rng.uniform(-3.0, 3.0, (120, nu)), 5, axis=0)
    x = lfilter([0.0, 1.0], [1.0, -0.7], u @ rng.uniform(0.5, 1.0, (nu, ny)), axis=0)
    y = x - np.clip(x, *np.quantile(x, [0.3, 0.7]))  # a dead zone, so that the signal is on both sides of one
    few, ten = sysid.Options(max_iterations=10), sysid.Objective(knots=0)
    fit = sysid.fit(plain, sysid.IOData(u, y, TS), starts=1, options=few, objective=ten)
    run, step = plain.outputs(fit.theta, u), 1e-6
    J = np.column_stack([(plain.outputs(fit.theta + step * e, u) - run).ravel() / step for e in np.eye(len(fit.theta))])
    constants = np.tile(np.eye(ny), (len(u), 1))
    residual = constants - J @ np.linalg.lstsq(J, constants, rcond=1e-9)[0]
    assert (np.abs(residual).max() < 1e-3) == held


@pytest.mark.parametrize("seed", often(60, 2))
def test_a_dead_zone_behind_a_filter_is_found_and_starts_with_the_gain_of_its_curve(seed):
    """Of 60 such records five ended at up to 2,000 times the variance of the noise."""
    rng = np.random.default_rng([seed, 5])
    gain, pole = rng.uniform(0.5, 3.0), rng.uniform(0.6, 0.95)
    u = np.repeat(rng.uniform(-10.0, 4.0, 20), 20)
    x = lfilter([0.0, gain], [1.0, -pole], u)
    noise = 0.01 * x.std() * rng.normal(size=400)
    y = MAPS["dead_zone"](x, *np.quantile(x, [0.2, 0.8])) - 30.0 + noise
    model, data = wiener(1, 1, 1, "dead_zone", offset="free"), sysid.IOData(u, y, TS)
    points = [p.theta for p in starting_points(model, data, 0, 0, 9, 0.0) if p.member != "identity"]
    losses = [np.mean((y - model.outputs(theta, u)[:, 0]) ** 2) for theta in points]
    assert min(losses) < 0.6 * y.var()  # mostly 0.9 without that gain
    assert sysid.fit(model, data).criteria.mse < 1.1 * np.mean(noise**2)


def _filtered(seed: int, offset: float) -> tuple[sysid.IOData, float]:
    """A first-order plant with an offset of that many standard deviations, and the variance of its white noise."""
    rng = np.random.default_rng(seed)
    u, p = np.repeat(rng.uniform(-1.0, 1.0, 80), 5), rng.uniform(0.3, 0.95)
    y = lfilter([0.0, 1.0 - p], [1.0, -p], u)
    noise = 0.1 * float(y.std())
    return sysid.IOData(u, y + offset * y.std() + noise * rng.standard_normal(len(u)), TS), noise**2


@pytest.mark.parametrize("offset", [0.1, 1.0, 20.0])
def test_a_structure_without_the_offset_that_the_record_has_is_told_and_the_advice_helps(offset):
    """A large offset drives a pole to 1, where the initial state stands for it: the score alone does not see it."""
    for seed in range(5):
        data, variance = _filtered(seed, offset)
        bare = sysid.fit(output_error(1, 1, 1), data, starts=1)
        assert 'offset="free"' in " ".join(bare.warnings)
        free = sysid.fit(output_error(1, 1, 1, offset="free"), data, starts=1)
        assert free.criteria.loss < 1.2 * variance < bare.criteria.loss
        assert not any("offset" in text for text in free.warnings)


def test_a_record_without_an_offset_is_not_said_to_have_one():
    for seed in often(20, 2):
        for model in (output_error(1, 1, 1), wiener(1, 1, 1, "saturation"), wiener(1, 1, 1)):
            fit = sysid.fit(model, _filtered(seed, 0.0)[0], starts=1)
            assert not any("offset" in text for text in fit.warnings)


def without_gain(seed: int) -> IOData:
    """A saturation before a filter that lets no constant through, an output that stands at 1, 2 % noise."""
    rng = np.random.default_rng([seed, 5])
    u = lfilter([1.0], [1.0, -0.5], rng.standard_normal(250))
    y = lfilter([0.0, 1.0, -1.0], [1.0, -0.5, 0.3], np.clip(u, -1.0, 1.0)) + 1.0
    return IOData(u, y + 0.02 * rng.standard_normal(250))


@pytest.mark.parametrize("seed", range(3))
def test_a_pole_in_the_place_of_an_offset_leads_to_one_that_the_structure_takes(seed):
    """offset="free" adds none where a map holds one."""
    record = without_gain(seed)
    told = " ".join(sysid.fit(structures.hammerstein(2, 2, 1), record).warnings)
    assert "takes the place of an offset" in told
    assert 'offset="each"' in told
    next_fit = sysid.fit(structures.hammerstein(2, 2, 1, offset="each"), record)
    assert next_fit.criteria.mse < 1.1 * 0.02**2
    assert "takes the place of an offset" not in " ".join(next_fit.warnings)


def test_no_offset_is_named_where_a_structure_takes_none():
    """Two filters around a map: some fits put a pole in the place of the offset, and say so."""
    model = structures.wiener_hammerstein(1, 1, 1, nb2=2, nf2=2)
    told = [" ".join(sysid.fit(model, without_gain(seed)).warnings) for seed in range(3)]
    assert any("takes the place of an offset" in text for text in told)
    assert not any("offset=" in text for text in told)


def test_a_model_of_as_many_parameters_as_samples_says_so():
    """60 samples for two maps and six poles and zeros: maps that go through every sample."""
    rng = np.random.default_rng(0)
    u = np.repeat(rng.standard_normal(12), 5)
    y = np.tanh(lfilter([0.0, 0.3], [1.0, -0.8], np.clip(u, -1.0, 1.0))) + 0.3 * rng.standard_normal(60)
    fit = sysid.fit(structures.hammerstein_wiener(3, 3, 1), IOData(u, y))
    assert fit.criteria.d > 30
    assert any("effective parameters and the record 60 samples: it follows the noise" in w for w in fit.warnings)
    few = sysid.fit(structures.output_error(1, 1, 1), IOData(u, y))
    assert not any("it follows the noise" in w for w in few.warnings)
