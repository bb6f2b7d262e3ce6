"""`qpal run`: a saved model on a record that it was not fitted to."""

import csv
import json
import math

import numpy as np
import pytest

import sysid
from sysid.base.files import json_value
from sysid.data.preprocess import detrend
from sysid.workflow.identification import identify_file
from sysid.workflow.model_run import run_file
from sysid.workflow.saved import Reading
from twin.cli import main

STRUCTURES = {
    "chain": ["output_error", "--orders", "2,2,1", "--offset", "none"],
    "nlarx": ["nlarx", "--orders", "2,2,1", "--starts", "1"],
}
LEVELS = ["--detrend", "mean"]  # so that the model has offsets of its record


def rows(N=600, seed=0):
    """A lag about a working point of 2 V and 40 mm, with coloured noise; time [s], volts, height [mm]."""
    rng = np.random.default_rng(seed)
    u, y, v = np.repeat(rng.uniform(1.0, 3.0, N // 5), 5), np.zeros(N), np.zeros(N)
    for t in range(2, N):
        y[t] = 1.3 * y[t - 1] - 0.4 * y[t - 2] + 0.2 * np.tanh(u[t - 1] - 2.0) + 0.05 * (u[t - 2] - 2.0)
        v[t] = 0.8 * v[t - 1] + 0.02 * rng.standard_normal()
    return np.column_stack([0.1 * np.arange(N), u, y + 40.0 + v])


def write(path, table, head="time_s,volts_V,height_mm"):
    lines = [",".join(map(repr, row)) for row in table.tolist()]
    path.write_text("\n".join([head, *lines]) + "\n")


@pytest.fixture(scope="module", params=sorted(STRUCTURES))
def place(request, tmp_path_factory):
    """A folder with a record, its second half as a file of its own, and a model of the first half."""
    folder = tmp_path_factory.mktemp(request.param)
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        table = rows()
        write(folder / "rig.csv", table)
        write(folder / "second.csv", table[300:])
        assert main(["identify", "rig.csv", "--structure", *STRUCTURES[request.param], *LEVELS, "--out", "fit"]) == 0
    return folder


def summary_of(arguments, capsys):
    assert main([*arguments, "--json"]) == 0
    return json.loads(capsys.readouterr().out)


def test_a_model_of_half_a_record_runs_on_the_raw_other_half(place, capsys, monkeypatch):
    """The fit is that of the report's validation, whose data had lost the mean of the whole record."""
    monkeypatch.chdir(place)
    capsys.readouterr()
    said = json.loads((place / "fit" / "summary.json").read_text())["fit_percent"]
    found = summary_of(["run", "fit/model.json", "second.csv", "--out", "run"], capsys)
    assert said["validation"] > 85.0
    assert found["fit_percent"]["free_run"] == pytest.approx(said["validation"], abs=1e-6)
    assert found["model"]["estimation"]["fit"] == pytest.approx(said["estimation"], abs=0.02)  # of its initial state
    again = summary_of(["run", "fit/model.json", "rig.csv", "--range", "30:", "--out", "part"], capsys)
    assert again["fit_percent"]["free_run"] == pytest.approx(said["validation"], abs=1e-6)
    assert "prediction" not in found
    assert found["next"] is None


@pytest.mark.parametrize(
    "change",
    [
        {"u_offset": None, "y_offset": None},
        {"u_offset": [-2.0]},
        {"y_offset": [0.0]},
        {"u_offset": [0.0]},
    ],
    ids=["none", "sign of u", "no y", "no u"],
)
def test_wrong_offsets_show(place, change, monkeypatch, tmp_path):
    monkeypatch.chdir(place)
    document = json.loads((place / "fit" / "model.json").read_text())
    (tmp_path / "wrong.json").write_text(json.dumps(document | change))
    found = json_value(run_file(str(tmp_path / "wrong.json"), Reading("second.csv")).as_dict())
    right = json.loads((place / "fit" / "summary.json").read_text())["fit_percent"]["validation"]
    assert not (found["fit_percent"]["free_run"] or -math.inf) > right - 5.0
    unknown = [note for note in found["notes"] if "has no offsets" in note]
    assert bool(unknown) == (change["u_offset"] is None if "u_offset" in change else False)
    assert all("--detrend mean" in note for note in unknown)


def test_an_old_model_runs_with_the_record_s_own_mean_removed(place, capsys, monkeypatch, tmp_path):
    monkeypatch.chdir(place)
    capsys.readouterr()
    document = json.loads((place / "fit" / "model.json").read_text())
    old = tmp_path / "old.json"
    old.write_text(json.dumps(document | {"u_offset": None, "y_offset": None}))
    found = summary_of(["run", str(old), "second.csv", "--detrend", "mean", "--out", "old"], capsys)
    assert found["fit_percent"]["free_run"] > 70.0


def test_the_outputs_are_a_table_at_the_record_s_level(place, capsys, monkeypatch):
    monkeypatch.chdir(place)
    capsys.readouterr()
    found = summary_of(["run", "fit/model.json", "second.csv", "--horizon", "3", "--out", "table"], capsys)
    with (place / "table" / "simulated.csv").open() as file:
        table = list(csv.DictReader(file))
    names = ["time_s", "volts_V", "height_m", "height_free_run_m", "height_ahead_3_m"]
    assert list(table[0]) == names
    values = np.array([[float(row[name]) for name in names] for row in table])
    raw = rows()[300:]
    np.testing.assert_allclose(values[:, :3], raw * [1.0, 1.0, 1e-3] - [30.0, 0.0, 0.0], atol=1e-12)
    fit, data = sysid.load("fit/model.json"), sysid.IOData(raw[:, 1], 1e-3 * raw[:, 2], 0.1)
    np.testing.assert_allclose(values[:, 3], fit.simulate(data), atol=1e-12)
    np.testing.assert_allclose(values[:, 4], fit.predict(data, 3), atol=1e-12)
    n, y = found["not_scored"], values[:, 2]
    for column, percent in ((3, found["fit_percent"]["free_run"]), (4, found["prediction"]["fit_percent"])):
        error = np.linalg.norm((y - values[:, column])[n:]) / np.linalg.norm(y[n:] - y[n:].mean())
        assert percent == pytest.approx(100.0 * (1.0 - error), abs=1e-9)
    held = np.linalg.norm(y[n:] - y[np.maximum(np.arange(n, 300) - 3, 0)]) / np.linalg.norm(y[n:] - y[n:].mean())
    assert found["prediction"]["fit_percent_of_the_last_output_held"] == pytest.approx(100 * (1 - held), abs=1e-9)
    html = (place / "table" / "report.html").read_text()
    assert "Prediction 3 sample(s) ahead" in html
    assert "NOT a free run" in html


def test_inputs_alone_are_run_from_rest(place, capsys, monkeypatch, tmp_path):
    """By `sysid.Fit.simulate` of the input alone, which counts from the means of the estimation data."""
    monkeypatch.chdir(place)
    capsys.readouterr()
    raw = rows()[300:]
    write(tmp_path / "alone.csv", raw[:, :2], "time_s,volts_V")
    found = summary_of(["run", "fit/model.json", str(tmp_path / "alone.csv"), "--out", "alone"], capsys)
    assert found["fit_percent"] is None
    assert found["notes"][0].startswith("the record has no output to compare with: the model runs from rest")
    assert found["notes"][0].endswith("counted from the levels of its estimation data")
    with (place / "alone" / "simulated.csv").open() as file:
        table = list(csv.DictReader(file))
    assert list(table[0]) == ["time_s", "volts_V", "height_free_run_m"]
    fit, run = sysid.load("fit/model.json"), np.array([float(row["height_free_run_m"]) for row in table])
    np.testing.assert_allclose(run, fit.simulate(raw[:, 1] - fit.u_offset[0]) + fit.y_offset[0], atol=1e-12)
    np.testing.assert_allclose(run[30:], fit.simulate(sysid.IOData(raw[:, 1], 1e-3 * raw[:, 2], 0.1))[30:], atol=2e-4)
    assert (place / "alone/figures/free-run.png").exists()
    (tmp_path / "map.toml").write_text('[clock]\ncolumn = "time_s"\n[[input]]\ncolumn = "volts_V"\n')
    arguments = ["run", "fit/model.json", str(tmp_path / "alone.csv")]
    mapped = summary_of([*arguments, "--map", str(tmp_path / "map.toml"), "--range", "10:", "--out", "mapped"], capsys)
    assert mapped["read"]["samples"] == 200
    (tmp_path / "column.csv").write_text("\n".join(["volts_V", *map(repr, raw[:, 1].tolist())]))
    column = ["run", "fit/model.json", str(tmp_path / "column.csv"), "--ts", "0.1", "--out", "column"]
    assert summary_of(column, capsys)["read"]["samples"] == 300
    assert "no sampling time is given" in refused([*column[:3], "--out", "column"], capsys)
    assert "--horizon is 2 and" in refused([*arguments, "--horizon", "2"], capsys)
    write(tmp_path / "current.csv", raw[:, :2], "time_s,current_A")
    other = [*arguments[:2], str(tmp_path / "current.csv"), "--input", "current_A"]
    assert "the input is in A and the model's in V" in refused(other, capsys)
    write(tmp_path / "height.csv", raw[:, [0, 2]], "time_s,height_mm")
    assert "no column is left for the input" in refused([*arguments[:2], str(tmp_path / "height.csv")], capsys)
    (tmp_path / "bare.csv").write_text("\n".join(f"{t!r},{u!r}" for t, u in raw[:, :2].tolist()))
    bare = refused([*arguments[:2], str(tmp_path / "bare.csv")], capsys)
    assert bare.endswith("column 2 is the input; a run from rest needs the input alone: give --input 2\n")


def test_a_run_that_leaves_what_the_model_was_fitted_on_is_said(place, capsys, monkeypatch, tmp_path):
    monkeypatch.chdir(place)
    capsys.readouterr()
    raw = rows()[300:]
    write(tmp_path / "strong.csv", raw[:, :2] * [1.0, 4.0], "time_s,volts_V")
    notes = summary_of(["run", "fit/model.json", str(tmp_path / "strong.csv"), "--out", "strong"], capsys)["notes"]
    assert any("of the input's samples lie outside" in note for note in notes)
    assert any(note.startswith("the run goes from") and "the model extrapolates there" in note for note in notes)


def refused(arguments, capsys):
    assert main(arguments) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert err.count("\n") == 1
    return err


def test_what_does_not_belong_together_is_a_sentence(place, capsys, monkeypatch, tmp_path):
    monkeypatch.chdir(place)
    capsys.readouterr()
    model, table = "fit/model.json", rows()
    slow = tmp_path / "slow.csv"
    write(slow, table[::2])
    said = refused(["run", model, str(slow)], capsys)
    assert "every 0.2 s and the model every 0.1 s" in said
    assert "--resample" in said
    angle = tmp_path / "angle.csv"
    write(angle, table, "time_s,volts_V,height_deg")
    assert "the output is in rad and the model's in m" in refused(["run", model, str(angle)], capsys)
    write(tmp_path / "short.csv", table[:15])
    if "chain" in place.name:
        assert "give a longer one" in refused(["run", model, str(tmp_path / "short.csv")], capsys)
    assert "--horizon is 0" in refused(["run", model, "second.csv", "--horizon", "0"], capsys)
    said = refused(["run", model, "second.csv", "--detrend", "line"], capsys)
    assert "--detrend is 'line'; give mean" in said
    assert "second.csv" in refused(["run", "second.csv", model], capsys)


def test_a_model_of_two_inputs_and_outputs_runs_by_a_mapping(tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    rng = np.random.default_rng(0)
    u, y = np.repeat(rng.uniform(1.0, 3.0, (40, 2)), 5, axis=0), np.zeros((200, 2))
    for t in range(1, 200):
        y[t] = 0.8 * y[t - 1, 0] + u[t - 1, 0] + 0.3 * u[t - 1, 1], 0.6 * y[t - 1, 1] + 0.5 * u[t - 1, 1]
    y += 10.0 + 0.02 * rng.standard_normal(y.shape)
    data = sysid.IOData(u, y, 0.1)
    model = sysid.structures.output_error(1, 1, 1, nu=2, ny=2)
    fit = sysid.fit(model, detrend(data), search="lm", starts=1)
    fit.save("two.json")
    write(tmp_path / "two.csv", np.column_stack([0.1 * np.arange(200), u, y]), "time_s,a,b,c,d")
    roles = "".join(
        f'[[{role}]]\ncolumn="{c}"\n' for role, c in zip(["input"] * 2 + ["output"] * 2, "abcd", strict=True)
    )
    (tmp_path / "two.toml").write_text('[clock]\ncolumn="time_s"\nunit="s"\n' + roles)
    found = summary_of(["run", "two.json", "two.csv", "--map", "two.toml", "--horizon", "2", "--out", "run"], capsys)
    np.testing.assert_allclose(found["fit_percent"]["outputs"], fit.fit_percents(data), atol=1e-6)
    head = (tmp_path / "run" / "simulated.csv").read_text().splitlines()[0]
    assert head == "time_s,u1,u2,y1,y2,y1_free_run,y2_free_run,y1_ahead_2,y2_ahead_2"
    said = refused(["run", "two.json", "two.csv", "--input", "a", "--output", "c", "--time", "time_s"], capsys)
    assert "1 input(s) are read and the model has 2; name as many columns with --input" in said


def test_a_record_of_another_rate_can_be_resampled(place, capsys, monkeypatch, tmp_path):
    monkeypatch.chdir(place)
    capsys.readouterr()
    table, fast = rows()[300:], tmp_path / "fast.csv"
    write(fast, np.column_stack([0.05 * np.arange(600), np.repeat(table[:, 1:], 2, axis=0)]))
    found = summary_of(["run", "fit/model.json", str(fast), "--resample", "--out", "fast"], capsys)
    assert found["fit_percent"]["free_run"] > 70.0
    assert any("resampled from 0.05 to 0.1 s" in note for note in found["notes"])


def test_a_model_that_does_not_follow_names_the_next_command(place, capsys, monkeypatch, tmp_path):
    """Another plant, at a higher level: both are said, and the command that it names runs."""
    monkeypatch.chdir(place)
    capsys.readouterr()
    other = rows(seed=3)
    other[:, 1] += 4.0
    other[:, 2] = 80.0 - other[:, 2]
    write(tmp_path / "other.csv", other)
    arguments = ["run", "fit/model.json", str(tmp_path / "other.csv"), "--horizon", "1", "--out", "other"]
    found = summary_of(arguments, capsys)
    if found["prediction"]["fit_percent"] < found["prediction"]["fit_percent_of_the_last_output_held"]:
        assert "the model does not help to predict here" in (place / "other" / "report.html").read_text()
    assert any("which the estimation data cover: the model extrapolates" in note for note in found["notes"])
    assert any("do not come from the same plant" in note for note in found["notes"])
    words = found["next"]["command"].split()
    assert words[:3] == ["qpal", "identify", str(tmp_path / "other.csv")]
    identify_file(words[2], _setting(words[words.index("--structure") + 1]))


def _setting(structure):
    from sysid.structures import TABLE
    from sysid.workflow.setting import Setting

    return Setting(TABLE[structure](), starts=1)
