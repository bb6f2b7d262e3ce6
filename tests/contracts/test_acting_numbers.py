"""Saved models with large entries: a run that is not finite is told by its sample, and the step that is named works."""

import json
from dataclasses import replace

import numpy as np
import polars as pl
import pytest
from exported import structure_fit

import sysid
from sysid.base.errors import InputError
from sysid.estimation.free_run import FAR, autoregression, beyond
from sysid.estimation.origin import Origin
from sysid.export import c
from twin.cli import main

# Structures whose runs can leave every number, with the entries that make them: filters elsewhere are stable.
WILD = {"nlarx": "L.y1", "state_space": "state.E1,2", "armax": "linear.f1"}


@pytest.fixture(scope="module")
def wild(tmp_path_factory):
    """Folders with model.json, log.csv and inputs.csv."""
    folders = {}
    for name, entry in WILD.items():
        folder = folders[name] = tmp_path_factory.mktemp(name)
        fit, _ = structure_fit(name)
        fit = replace(fit, origin=Origin("u", "y", "", "", 200, 90.0), u_offset=np.zeros(1), y_offset=np.zeros(1))
        path = fit.save(folder / "model.json")
        document = json.loads(path.read_text())
        theta = document["theta"]
        document["theta"] = {k: 1e3 * v if k == entry else v for k, v in theta.items()}
        path.write_text(json.dumps(document))
        rng = np.random.default_rng(0)
        u = np.repeat(rng.uniform(-1, 1, 40), 5)
        y = np.zeros(200)
        for k in range(1, 200):
            y[k] = 0.8 * y[k - 1] + 0.2 * u[k - 1]
        table = pl.DataFrame({"t_s": 0.1 * np.arange(200), "u": u, "y": y + 0.001 * rng.standard_normal(200)})
        table.write_csv(folder / "log.csv")
        table.drop("y").write_csv(folder / "inputs.csv")
    return folders


def first_gap(folder, column):
    """The first sample of a column that is not finite; its table has no nan."""
    values = pl.read_csv(folder / "out" / "simulated.csv")[column].cast(pl.Float64).to_numpy()
    assert not np.isnan(values).any()
    return int(np.argmax(~np.isfinite(values)))


@pytest.mark.parametrize("name", WILD)
@pytest.mark.parametrize("file", ["log.csv", "inputs.csv"])
def test_a_run_that_is_not_finite_is_told_by_its_sample(name, file, wild, capsys):
    folder = wild[name]
    words = ["--time", "t_s", "--input", "u", *(["--output", "y"] if file == "log.csv" else [])]
    assert main(["run", str(folder / "model.json"), str(folder / file), *words, "--out", str(folder / "out")]) == 0
    sample = first_gap(folder, "y_free_run")
    assert sample > 0
    said = capsys.readouterr()
    assert f"diverges: it is not finite from sample {sample} on; " in said.out
    assert "Warning" not in said.out + said.err
    notes = json.loads((folder / "out" / "summary.json").read_text())["notes"]
    assert any(f"not finite from sample {sample} on" in note for note in notes)


def test_the_prediction_that_is_named_is_finite(wild, capsys):
    folder = wild["nlarx"]
    assert "qpal run with --horizon 1 on a log that has them" in sysid.load(folder / "model.json").remedy
    words = ["--time", "t_s", "--input", "u", "--output", "y", "--out", str(folder / "out"), "--horizon"]
    assert main(["run", str(folder / "model.json"), str(folder / "log.csv"), *words, "1"]) == 0
    assert first_gap(folder, "y_ahead_1") == 0
    assert np.isfinite(pl.read_csv(folder / "out" / "simulated.csv")["y_ahead_1"].to_numpy()).all()
    capsys.readouterr()


def test_a_prediction_that_is_not_finite_is_told_too(wild, capsys):
    folder = wild["state_space"]
    words = ["--time", "t_s", "--input", "u", "--output", "y", "--out", str(folder / "out"), "--horizon", "3"]
    assert main(["run", str(folder / "model.json"), str(folder / "log.csv"), *words]) == 0
    sample = first_gap(folder, "y_ahead_3")
    assert (
        f"the prediction 3 ahead diverges: it is not finite from sample {sample} on" in capsys.readouterr().out.lower()
    )


def test_the_structure_that_is_named_runs(wild, capsys):
    folder = wild["state_space"]
    assert "(output_error)" in sysid.load(folder / "model.json").remedy
    words = ["--time", "t_s", "--input", "u"]
    small = ["--output", "y", "--structure", "output_error", "--orders", "1,1,1", "--out", str(folder / "fit")]
    assert main(["identify", str(folder / "log.csv"), *words, *small]) == 0
    model = str(folder / "fit" / "model.json")
    assert main(["run", model, str(folder / "inputs.csv"), *words, "--out", str(folder / "out")]) == 0
    assert "diverges" not in capsys.readouterr().out


@pytest.mark.parametrize("way", ["--c", "--python", "--matlab"])
@pytest.mark.parametrize("name", ["nlarx", "state_space"])
def test_an_export_says_that_its_model_diverges(name, way, wild, capsys):
    folder = wild[name]
    assert main(["export", str(folder / "model.json"), way, "--out", str(folder / "export")]) == 0
    assert "the free run diverges: " in capsys.readouterr().out
    assert any("diverges" in w for w in json.loads((folder / "export" / "summary.json").read_text())["warnings"])


def test_a_number_that_no_float_holds_is_not_written_as_another():
    fit, _ = structure_fit("hammerstein")
    theta = fit.theta.copy()
    theta[fit.model.names.index("linear.b0")] = 1e39
    large = replace(fit, theta=theta)
    with pytest.raises(InputError, match=r"linear.b0 is 1e\+39, and a float holds up to 3.4e\+38; leave --single"):
        c.written_source(large, "model", single=True)
    assert "1e+39" in c.source(large)
    assert "e38" not in c.written_source(fit, "model", single=True).text


def test_the_guard_names_the_first_sample_and_nothing_else():
    y = np.linspace(0.0, 1.0, 9)[:, None]
    assert beyond(y, "x") is None
    assert beyond(y, "x", far=0.5) == "the free run diverges: from sample 5 on it is more than 0.5 from zero; x"
    y[4] = np.nan
    assert beyond(y, "x", "it", place=" of experiment 2") == (
        "it diverges: it is not finite from sample 4 of experiment 2 on; x"
    )
    assert (
        beyond(np.array([0.0, -np.inf]), "x", far=1.0) == "the free run diverges: it is not finite from sample 1 on; x"
    )


def test_a_finite_run_that_is_far_from_the_record_is_told():
    """No other state keeps the run near: the input alone drives it away."""
    fit, _ = structure_fit("output_error")
    theta = fit.theta.copy()
    theta[fit.model.names.index("linear.b0")] = 1e12
    u = np.repeat([0.0, 1.0, -1.0, 0.5], 25)
    data = sysid.IOData(u, 0.1 * np.roll(u, 1), fit.Ts)
    said = replace(fit, theta=theta).divergence(data)
    assert f"on it is more than {FAR:.0e} times the range of the output away" in said
    sample = int(said.partition("sample ")[2].split()[0])
    run = replace(fit, theta=theta).simulate(data)
    assert np.isfinite(run).all()
    assert sample == int(np.argmax(np.abs(run - data.y[0, 0]) > FAR * 0.15))
    assert fit.divergence(data) is None


def test_residuals_of_any_size_have_one_colour():
    rng = np.random.default_rng(1)
    v = np.convolve(rng.standard_normal(400), [1.0, 0.7, 0.3])[:400]
    a = autoregression(v, (400,))
    assert len(a) > 0
    for power in (-500, 10, 700):
        assert autoregression(np.ldexp(v, power), (400,)) == a
