"""What the fuzzers found in saved models, cut down to what matters."""

import importlib.util
import json
import warnings
from pathlib import Path

import numpy as np
import pytest

import sysid
from sysid.base.errors import InputError
from sysid.estimation.noise_model import NoiseModel

SAVED = Path(__file__).resolve().parents[1] / "saved" / "v1"
NETWORK = "../../fuzz/nlarx"


def changed(name: str, change, folder: Path) -> Path:
    document = json.loads((SAVED / f"{name}.json").read_text())
    change(document)
    path = folder / "model.json"
    path.write_text(json.dumps(document))
    return path


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda d: d["criteria"].update(N=-1), "N = -1"),
        (lambda d: d["criteria"].update(N=10**30), "N = 10{30}.* no count above"),
        (lambda d: d["criteria"].update(d=10**30), "d = 10{30}.* no count above"),
        (lambda d: d["criteria"].update(mse=-0.5), "mse = -0.5"),
        (lambda d: d["model"]["blocks"][0].update(nk=10**6), "nk is 1000000"),
        (lambda d: d.update(u_span=[-1.0, -1e308]), "u_span is -1 to -1e.308, which is no range"),
        (lambda d: d.update(u_span=["nan", 1.0]), "u_span is nan to 1, which is no range"),
        (lambda d: d["theta"].update(dict.fromkeys(list(d["theta"])[:1], 1e308)), "above 1e"),
        (lambda d: d["covariance"]["unidentifiable"].__setitem__(0, 1e308), "unidentifiable"),
    ],
)
def test_numbers_that_no_fit_has_are_a_sentence(change, said, tmp_path):
    with pytest.raises(InputError, match=said):
        sysid.load(changed("output_error", change, tmp_path))


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda d: d.update(format=["sysid nlarx fit"]), "not a saved fit"),
        (lambda d: d.update(format={}), "not a saved fit"),
        (lambda d: d["covariance"]["unidentifiable"].pop(), "a row and a column for each of 11 parameters"),
        (lambda d: [row.pop() for row in d["covariance"]["cov"]], "a row and a column for each of 11 parameters"),
        (lambda d: d["network"]["mu"].__setitem__(0, 1e200), "a parameter is 1e.200"),
        (lambda d: d["network"].update(scaling=2 * 10**12), "does not name the network's 8000000000003 parameters"),
    ],
)
def test_entries_of_a_network_that_no_fit_has_are_a_sentence(change, said, tmp_path):
    with pytest.raises(InputError, match=said):
        sysid.load(changed(NETWORK, change, tmp_path))


def test_an_infinite_covariance_gives_unknown_deviations_and_no_warning(tmp_path):
    """As of a fit with fewer samples than parameters."""

    def change(document):
        document["covariance"]["cov"] = [["inf"] * len(row) for row in document["covariance"]["cov"]]

    fit = sysid.load(changed("output_error", change, tmp_path))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert not np.isfinite(fit.pole_std).any()
        assert all(not np.isfinite(mode.pole_std) for mode in sysid.linear.modes(fit))


@pytest.mark.parametrize("name", sorted(path.stem for path in SAVED.glob("*.json") if ".run" not in path.name))
def test_a_model_without_a_size_of_its_noise_still_runs_from_the_states_of_a_record(name, tmp_path):
    fit = sysid.load(changed(name, lambda d: d["criteria"].pop("mse", None), tmp_path))
    rng = np.random.default_rng(0)
    nu, ny = fit.model.channels
    data = sysid.IOData(rng.uniform(-1, 1, (60, nu)), rng.uniform(-1, 1, (60, ny)), fit.Ts)
    assert np.isfinite(fit.simulate(data)).all()
    bare = sysid.load(changed(name, lambda d: [d["criteria"].pop(each, None) for each in ("mse", "loss")], tmp_path))
    if bare.n_init > 1:
        with pytest.raises(InputError, match="neither mse nor loss, which give the initial state; fit it again"):
            bare.simulate(data)


@pytest.mark.parametrize(("nf", "nf2"), [(0, 0), (0, 2), (2, 0)])
def test_a_start_of_two_filters_of_which_one_has_no_pole(nf, nf2):
    from sysid.estimation.starts import starts

    rng = np.random.default_rng(0)
    u = rng.uniform(-1.0, 1.0, 300)
    data = sysid.IOData(u, np.convolve(np.tanh(2.0 * u), [0.0, 0.5, 0.3])[:300], 0.1)
    chain = sysid.structures.wiener_hammerstein(nb=2, nf=nf, nk=1, nb2=1, nf2=nf2, middle="sigmoid_network")
    found = starts(chain.scaled(data.u, data.y), data, 3, 0)
    assert len(found) == 3
    assert np.isfinite(found).all()
    for theta in found:
        first = theta[chain.dynamics[0][0]]
        assert first[:2].sum() == pytest.approx(1.0 + first[2 : 2 + nf].sum()), "its gain is 1: B(1) = F(1)"
    assert sysid.fit(chain, data, starts=2).fit_percent(data) > 80.0


@pytest.fixture
def random_fits(monkeypatch):
    scripts = Path(__file__).parents[2] / "scripts"
    monkeypatch.syspath_prepend(scripts)
    place = scripts / "studies" / "random_fits.py"
    spec = importlib.util.spec_from_file_location("random_fits", place)
    script = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(script)
    return script


def test_a_map_that_the_record_does_not_reach_takes_no_errors_for_its_own(random_fits):
    """Its part of the Jacobian is zero, and so was a sum of squares by which the level of the noise was divided."""
    noise = NoiseModel(np.array([1.0, -0.5]), 0.01)
    assert noise.level(np.zeros((9, 2)), [9]) == 0.01
    V = np.arange(18.0).reshape(9, 2)
    assert noise.level(1e-200 * V, [9]) == pytest.approx(noise.level(V, [9]))
    rng = np.random.default_rng([2136, 77])
    chain, data = random_fits.model(rng)[0], random_fits.record(rng)
    fit = sysid.fit(chain, data.select(0, int(0.6 * data.N)), seed=2136)
    assert np.isfinite(fit.theta).all()


def test_a_motor_profile_in_far_apart_units_ends_in_a_sentence(random_fits):
    """Warnings are errors in tests: the bounded least squares of its start multiplied zero by infinity."""
    name, wrong = random_fits.tried(50117)
    assert name.endswith("refused")
    assert wrong == []


@pytest.mark.parametrize("pole", [5e-324, -1e-310, 1e-150, 0.0])
def test_a_pole_near_zero_has_no_known_deviation_and_no_warning(pole, tmp_path):
    """Such a pole times Ts may be no number."""

    def change(document):
        document["theta"].update({name: -pole for name in document["theta"] if name.endswith(".f1")})

    fit = sysid.load(changed("wiener_hammerstein", change, tmp_path))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        found = sysid.linear.modes(fit)
    assert [mode.pole for mode in found] == [pole, pole]
    assert not any(np.isfinite(mode.damping_std) for mode in found if abs(pole) < 1e-300)
