"""`qpal run` with several models: several saved models on one record."""

import json
from dataclasses import replace

import numpy as np
import pytest

import sysid
from sysid.data.trends import with_offsets
from twin.cli import main


def record(N=400, seed=0, Ts=0.1):
    """A lag behind a saturation, at 5 V and 300 units."""
    rng = np.random.default_rng(seed)
    u, y = np.repeat(rng.uniform(-2.0, 2.0, N // 8), 8), np.zeros(N)
    for t in range(1, N):
        y[t] = 0.8 * y[t - 1] + np.clip(u[t - 1], -1.0, 1.0)
    return sysid.IOData(u + 5.0, y + 300.0 + 0.02 * rng.standard_normal(N), Ts)


def deviations(**options):
    """The record about its working point."""
    return with_offsets(record(**options), np.array([5.0]), np.array([300.0]))


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Models of deviations: of the right structure, linear, and of one pole more than there is."""
    folder, own = tmp_path_factory.mktemp("models"), deviations()
    for name, model in (
        ("clipped", sysid.structures.hammerstein(1, 1, 1, "saturation")),
        ("linear", sysid.structures.output_error(1, 1, 1)),
        ("larger", sysid.structures.hammerstein(2, 3, 1, "saturation")),
    ):
        sysid.fit(model, own, starts=2).save(folder / f"{name}.json")
    other = record(seed=1)
    lines = [f"{a!r},{b!r}" for a, b in zip(other.u[:, 0].tolist(), other.y[:, 0].tolist(), strict=True)]
    (folder / "new.csv").write_text("u,y\n" + "\n".join(lines) + "\n")
    return folder


def test_the_table_ranks_the_free_runs_on_the_raw_record(folder, monkeypatch, capsys):
    monkeypatch.chdir(folder)
    names = ["linear", "clipped", "larger"]
    command = ["run", *(f"{name}.json" for name in names), "new.csv", "--ts", "0.1", "--out", "made"]
    assert main([*command, "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    data = record(seed=1)
    rows = {row["name"]: row for row in found["models"]}
    assert set(rows) == set(names)
    for name, row in rows.items():
        fit = sysid.load(f"{name}.json")
        assert row["fit_percent"] == pytest.approx(fit.fit_percent(data), abs=1e-9)
        assert row["estimation"]["fit"] == fit.origin.fit
        assert row["criteria"]["fpe"] == fit.criteria.fpe
        assert row["parameters"] == fit.criteria.d
        assert row["orders"] == {"nb": 2 if name == "larger" else 1, "nf": 3 if name == "larger" else 1, "nk": 1}
    fits = [row["fit_percent"] for row in found["models"]]
    assert fits == sorted(fits, reverse=True)
    assert found["best"] == found["models"][0]["name"] in ("clipped", "larger")
    assert rows["clipped"]["fit_percent"] > 95.0 > rows["linear"]["fit_percent"] + 5.0


def test_the_best_is_marked_and_a_smaller_one_as_good_is_named(folder, monkeypatch, capsys):
    monkeypatch.chdir(folder)
    files = ["linear.json", "larger.json", "clipped.json"]
    assert main(["run", *files, "new.csv", "--ts", "0.1", "--out", "told"]) == 0
    said = capsys.readouterr().out
    best = json.loads((folder / "told" / "summary.json").read_text())["best"]
    marked = [line for line in said.splitlines() if line.strip().startswith("best ")]
    assert len(marked) == 1
    assert f" {best} " in marked[0]
    assert f"{best} follows the record best" in said
    assert ("clipped is within 0.5 points of it" in said) == (best == "larger")
    assert {path.name for path in (folder / "told" / "figures").iterdir()} == {"overlay.png", "one-by-one.png"}


def test_models_of_another_sampling_time_are_told_what_to_do(folder, monkeypatch, capsys, tmp_path):
    monkeypatch.chdir(folder)
    slow = tmp_path / "slow.json"
    sysid.fit(sysid.structures.output_error(1, 1, 1), deviations(Ts=0.2), starts=1).save(slow)
    command = ["run", "clipped.json", str(slow), "new.csv", "--ts", "0.1", "--out", "two"]
    assert main(command) == 2
    said = capsys.readouterr().err
    assert "slow.json" in said
    assert "every 0.1 s and the model every 0.2 s; add --resample" in said
    assert main([*command, "--resample", "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    notes = {row["name"]: row["notes"] for row in found["models"]}
    assert any("resampled from 0.1 to 0.2 s" in note for note in notes["slow"])
    assert not any("resampled" in note for note in notes["clipped"])


def test_models_of_one_name_keep_their_folders(folder, monkeypatch, capsys):
    monkeypatch.chdir(folder)
    for name in ("a", "b"):
        (folder / name).mkdir(exist_ok=True)
        (folder / name / "model.json").write_text((folder / "linear.json").read_text())
    assert main(["run", "a/model.json", "b/model.json", "new.csv", "--ts", "0.1", "--out", "same", "--json"]) == 0
    assert {row["name"] for row in json.loads(capsys.readouterr().out)["models"]} == {"a/model", "b/model"}


def test_where_no_model_follows_none_is_called_best(folder, monkeypatch, capsys, tmp_path):
    """The plant turned round: every model is worse than the mean, and the next command is named."""
    monkeypatch.chdir(folder)
    other = record(seed=1)
    lines = [f"{a!r},{b!r}" for a, b in zip(other.u[:, 0].tolist(), (600.0 - other.y[:, 0]).tolist(), strict=True)]
    (tmp_path / "turned.csv").write_text("u,y\n" + "\n".join(lines) + "\n")
    command = ["run", "linear.json", "clipped.json", str(tmp_path / "turned.csv"), "--ts", "0.1", "--out", "turned"]
    assert main(command) == 0
    said = capsys.readouterr().out
    assert "No model follows the record" in said
    assert not [line for line in said.splitlines() if line.strip().startswith("best ")]
    assert "▲ poor: " in said
    assert "This model does not follow the record; fit one to it." in said
    assert "Next: qpal identify" in said


def test_a_network_that_diverges_is_told_so(folder, monkeypatch, capsys, tmp_path):
    monkeypatch.chdir(folder)
    fit = sysid.fit(sysid.structures.nlarx(1, 1, 1, units=0), deviations(), starts=1)
    theta = fit.theta.copy()
    theta[1] = 1.6  # dy/dy(t-1)
    replace(fit, theta=theta).save(tmp_path / "wild.json")
    command = [
        "run",
        str(tmp_path / "wild.json"),
        "linear.json",
        "new.csv",
        "--ts",
        "0.1",
        "--out",
        "wild",
        "--json",
    ]
    assert main(command) == 0
    rows = json.loads(capsys.readouterr().out)["models"]
    assert [row["name"] for row in rows] == ["linear", "wild"]
    assert rows[1]["fit_percent"] is None
    assert any("the free run diverges" in note for note in rows[1]["notes"])


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["new.csv"], "only new.csv is given"),
        (["linear.json", "gone.csv"], "gone.csv"),
        (["gone.json", "new.csv"], "cannot read gone.json"),
        (["new.csv", "linear.json"], "the log stands last, after the models: qpal run linear.json new.csv"),
    ],
)
def test_bad_input_is_a_sentence(folder, monkeypatch, capsys, arguments, said):
    monkeypatch.chdir(folder)
    assert main(["run", *arguments, "--ts", "0.1"]) == 2
    err = capsys.readouterr().err
    assert said in err
    assert err.count("\n") == 1


def test_a_model_on_its_own_record_is_not_to_be_fitted_to_it_again(folder, monkeypatch):
    """A record whose second half is another plant's: the model follows the first, to which it was fitted."""
    monkeypatch.chdir(folder)
    own, other = record(seed=1), record(seed=2)
    y = own.y[:, 0].copy()
    y[len(y) // 2 :] = 600.0 - other.y[len(y) // 2 :, 0]
    lines = [f"{a!r},{b!r}" for a, b in zip(own.u[:, 0].tolist(), y.tolist(), strict=True)]
    (folder / "changed.csv").write_text("u,y\n" + "\n".join(lines) + "\n")
    options = ["--ts", "0.1", "--structure", "output_error", "--orders", "1,1,1", "--starts", "1"]
    assert main(["identify", "changed.csv", *options, "--out", "fitted"]) == 0
    assert main(["run", "fitted/model.json", "changed.csv", "--ts", "0.1", "--out", "again", "--json"]) == 0
    told = json.loads((folder / "again" / "summary.json").read_text())
    assert "was fitted to this record" in told["next"]["why"]
    assert told["next"]["command"].endswith("--structure auto")
