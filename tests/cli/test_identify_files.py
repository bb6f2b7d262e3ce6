"""`qpal identify` with several files, validation files and preparation: known plants from short records."""

import json
import shlex

import numpy as np
import pytest
from scipy.signal import lfilter

from sysid.data.preparation import Preparation
from sysid.structures import OutputError
from sysid.workflow.changes import command
from sysid.workflow.identification import identify_file
from sysid.workflow.record import read_record
from sysid.workflow.setting import Setting
from sysid.workflow.sources import merge_prepared
from twin.cli import main

POLES = [0.6, 0.9]
OE = Setting(OutputError(2, 2, 1), starts=1)
LINE = ["--structure", "output_error", "--orders", "2,2,1", "--starts", "1"]


def plant(seed, N=200, state=0.0, noise=0.02):
    """u and the output of a plant with the poles POLES, whose slow one begins at `state`."""
    rng = np.random.default_rng(seed)
    u = np.repeat(rng.uniform(-1.0, 1.0, N // 5), 5)
    y = lfilter([0.0, 0.5, 0.2], np.poly(POLES), u) + state * 0.9 ** np.arange(N)
    return u, y + noise * rng.normal(size=N)


def save(path, u, y, Ts=0.1, units=("V", "rad")):
    cells = [
        ["" if np.isnan(x) else repr(float(x)) for x in row] for row in zip(Ts * np.arange(len(u)), u, y, strict=True)
    ]
    head = f"t [s],u [{units[0]}],y [{units[1]}]\n"
    path.write_text(head + "".join(",".join(row) + "\n" for row in cells))
    return path


@pytest.fixture
def three(tmp_path, monkeypatch):
    """a.csv, b.csv and c.csv: one plant, whose slow pole begins at 8, -6 and 3."""
    monkeypatch.chdir(tmp_path)
    for k, (name, state) in enumerate((("a", 8.0), ("b", -6.0), ("c", 3.0))):
        save(tmp_path / f"{name}.csv", *plant(k, state=state))
    return tmp_path


def refused(arguments, capsys):
    assert main(["identify", *arguments]) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert err.count("\n") == 1
    return err


def test_files_are_experiments_with_initial_states_of_their_own(three, capsys):
    arguments = ["a.csv", "b.csv", "--validation", "c.csv", *LINE, "--detrend", "none", "--json", "--out", "o"]
    assert main(["identify", *arguments]) == 0
    summary = json.loads(capsys.readouterr().out)
    np.testing.assert_allclose(sorted(p["re"] for p in summary["poles"]), POLES, atol=3e-3)
    assert summary["fit_percent"]["validation"] > 98.5  # noise alone leaves 1 %
    assert summary["criteria"]["N"] == 400
    assert summary["criteria"]["d"] == 4 + 2 * 2 + 1  # both initial states are estimated, and an offset
    read = summary["read"]
    assert read["experiments"] == [{"file": "a.csv", "samples": 200}, {"file": "b.csv", "samples": 200}]
    assert (read["split"], read["validation"]["file"], read["validation"]["samples"]) == (None, "c.csv", 200)
    assert any("2 files are 2 experiments" in note for note in read["notes"])


def test_without_validation_files_every_experiment_is_split(three):
    found = identify_file(["a.csv", "b.csv"], OE, split=0.6, detrend="none").evaluation
    assert found.estimation.lengths == (120, 120)
    assert found.validation.lengths == (80, 80)
    a, b = (read_record(f"{name}.csv").data.y for name in "ab")
    assert np.array_equal(found.validation.y, np.concatenate([a[120:], b[120:]]))
    assert found.validation_fit > 98.0


def test_validation_records_count_from_the_zero_of_the_estimation_data(three):
    found = identify_file("a.csv", OE, validation=["b.csv", "c.csv"], detrend="mean").evaluation
    a, b, c = (read_record(f"{name}.csv").data for name in "abc")
    assert found.estimation.N == a.N  # all of it
    assert found.validation.lengths == (200, 200)
    np.testing.assert_allclose(found.validation.y_offset, a.y.mean(axis=0))
    np.testing.assert_allclose(found.validation.y, np.concatenate([b.y, c.y]) - a.y.mean())
    lines = identify_file("a.csv", OE, validation=["c.csv"], detrend="linear").evaluation
    assert abs(lines.validation.y.mean()) < 1e-9  # its own line


@pytest.mark.parametrize("given", [["--validation", "b.csv,c.csv"], ["--validation", "b.csv", "--validation", "c.csv"]])
def test_validation_is_a_list_or_repeated(three, given, monkeypatch):
    seen = []
    monkeypatch.setattr("sysid.workflow.identification.identify_file", lambda *_, **k: seen.append(k) or 1 / 0)
    with pytest.raises(ZeroDivisionError):
        main(["identify", "a.csv", *given])
    assert [str(path) for path in seen[0]["validation"]] == ["b.csv", "c.csv"]


def test_files_that_do_not_go_together(three, capsys):
    u, y = plant(5)
    save(three / "slow.csv", u, y, Ts=0.2)
    save(three / "degrees.csv", u, y, units=("V", "m"))
    assert "leave one of the two out" in refused(["a.csv", "--validation", "b.csv", "--split", "0.5"], capsys)
    assert "--resample 0.2" in refused(["a.csv", "slow.csv", *LINE], capsys)
    assert "--resample 0.2" in refused(["a.csv", "--validation", "slow.csv", *LINE], capsys)
    assert "is in m, 'y [rad]' of a.csv in rad" in refused(["a.csv", "degrees.csv", *LINE], capsys)
    assert "--filter is '3'" in refused(["a.csv", "--filter", "3"], capsys)
    assert "count from zero" in refused(["a.csv", "--structure", "actuated_joint", "--filter", "1:"], capsys)
    assert "--detrend is linear" in refused(["a.csv", "--structure", "auto", "--detrend", "linear"], capsys)
    merged = identify_file(["a.csv", "slow.csv"], OE, preparation=Preparation(resample=0.2))
    assert merged.record.data.lengths == (100, 200)


def test_preparation_comes_before_the_split(three):
    steps = Preparation(resample=0.2, filter=(None, 1.0))
    result = identify_file("a.csv", OE, preparation=steps, detrend="none")
    found, want = result.evaluation, steps.apply(read_record("a.csv").data)
    assert np.array_equal(np.concatenate([found.estimation.y, found.validation.y]), want.y)
    assert np.array_equal(np.concatenate([found.estimation.u, found.validation.u]), want.u)
    assert sum("resampled" in note or "Butterworth" in note for note in result.record.notes) == 2
    assert result.as_dict()["read"]["prepared"] == ["--resample", "0.2", "--filter", ":1"]


def test_empty_cells_of_an_output_are_missing_samples(three, capsys):
    u, y = plant(9)
    y[40], y[60:75] = np.nan, np.nan
    save(three / "gap.csv", u, y)
    result = identify_file("gap.csv", OE, detrend="none")
    found = result.evaluation
    assert np.flatnonzero(found.estimation.missing[:, 0]).tolist() == [40, *range(60, 75)]
    assert found.fit.criteria.N == 84  # of 100
    np.testing.assert_allclose(sorted(found.poles.real), POLES, atol=0.01)
    assert found.estimation_fit > 98.0  # the straight line over the long gap is not scored
    assert any("16 empty cell(s)" in note and "marked as missing" in note for note in result.record.notes)
    filled = identify_file("gap.csv", OE, detrend="none", preparation=Preparation(missing="fill")).evaluation
    assert np.flatnonzero(filled.estimation.missing[:, 0]).tolist() == list(range(60, 75))
    assert "row 42, column 'y [rad]'" in refused(["gap.csv", *LINE, "--missing", "refuse"], capsys)
    u[3] = np.nan
    save(three / "gap.csv", u, y)
    assert "row 5, column 'u [V]'" in refused(["gap.csv", *LINE], capsys)


def test_the_next_command_says_all_that_was_given(three, capsys):
    steps = Preparation(missing="fill", resample=0.2, filter=(None, 2.0))
    result = identify_file(["a.csv", "b.csv"], OE, validation=["c.csv"], preparation=steps)
    words = shlex.split(command(result))
    assert words[:4] == ["qpal", "identify", "a.csv", "b.csv"]
    for pair in ("--resample 0.2", "--filter :2", "--missing fill", "--validation c.csv", "--orders 2,2,1"):
        assert pair in " ".join(words)
    assert "--split" not in words
    assert main([*words[1:], "--json", "--out", "again"]) == 0
    again = json.loads(capsys.readouterr().out)
    assert again["fit_percent"]["validation"] == result.evaluation.validation_fit


def test_a_file_counts_once(three, capsys):
    assert "b.csv is given twice" in refused(["a.csv", "b.csv", "./b.csv", *LINE], capsys)
    assert "a.csv is given twice" in refused(["a.csv", "--validation", "a.csv", *LINE], capsys)


def test_files_with_zeros_of_their_own_are_told(tmp_path, monkeypatch):
    """One zero counts for all files; where that is wrong, somebody has to be told."""
    monkeypatch.chdir(tmp_path)
    for k, (name, zero) in enumerate((("a", -20.0), ("b", 40.0), ("c", -20.5))):
        u, y = plant(k)
        save(tmp_path / f"{name}.csv", u, y + zero)
    apart, alike = identify_file(["a.csv", "b.csv"], OE), identify_file(["a.csv", "c.csv"], OE)
    assert any("levels of the outputs differ" in note for note in apart.record.notes)
    assert not any("levels" in note for note in alike.record.notes)


@pytest.mark.parametrize("pulse", [0.0, 9.0])
def test_inputs_of_several_files_that_differ_are_told_where_they_do_as_it_says(pulse, tmp_path):
    """Of 3 and of -3 V on the mean; with a pulse of 9 V it moves by more. Volts of a joint count from zero."""
    records = []
    for way in (-1, 1):
        u, y = plant(2)
        u[3] = way * pulse
        records.append(read_record(save(tmp_path / f"{way}.csv", u + way * 3.0, y)))
    merged, joint = (merge_prepared(records, absolute, Preparation()) for absolute in (False, True))
    assert any("levels of the inputs differ" in note for note in merged.notes) == (pulse == 0.0)
    assert not any("levels" in note for note in joint.notes)


@pytest.mark.parametrize("option", [["--detrend", "linear"], ["--filter", "0.02:"]], ids=["line", "slow"])
def test_a_model_of_what_no_offset_undoes_says_so(option, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    u, y = plant(0)
    save(tmp_path / "a.csv", u, y + np.linspace(0.0, 20.0, len(y)))
    assert main(["identify", "a.csv", *LINE, *option, "--out", "o"]) == 0
    assert main(["run", "o/model.json", "a.csv", "--out", "r"]) == 0
    assert "has no offsets (a line or what is slow was removed" in " ".join(capsys.readouterr().out.split())
