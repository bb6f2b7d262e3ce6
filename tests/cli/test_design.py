"""`qpal design`: its input drives the twin, and the record then tells what the first one could not."""

import json

import numpy as np
import pytest

import twin
from sysid.workflow.record import read_record
from twin.cli import main
from twin.studies.beyond import twin_truth


@pytest.fixture(scope="module")
def first(tmp_path_factory):
    path = tmp_path_factory.mktemp("first") / "thigh.csv"
    options = {"jitter": 0.5, "shrink": 0.4}
    twin.Experiment("thigh", "sweep", 125.0, 0.1, seed=1, options=options).run().save(path)
    return path


def values(summary):
    return {value["name"]: value for value in summary["values"]}


@pytest.mark.nightly
def test_the_break_away_that_a_sweep_hides_is_found_with_the_proposed_experiment(first, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert main(["design", str(first), "--for", "ends,breakaway", "--out", "next", "--json"]) == 0
    summary = json.loads(capsys.readouterr().out)
    read = read_record("next/design.csv")
    assert (read.data.Ts, read.data.u_unit, read.data.y_unit) == (pytest.approx(0.02), "V", "rad")
    assert summary["Ts"] == pytest.approx(0.02)  # a third of lag and delay, in place of more than both
    assert summary["duration"] == pytest.approx(read.data.N * 0.02)
    told = main(["simulate", "--joint", "thigh", "--input-log", "next/design.csv", "--log", "second.csv", "--out", "s"])
    assert told == 0
    capsys.readouterr()
    assert main(["identify", "second.csv", "--structure", "actuated_joint", "--out", "i", "--json"]) == 0
    found, true = values(json.loads(capsys.readouterr().out)), twin_truth("thigh", 0.02)
    for name in ("breakaway_up", "breakaway_down"):
        assert found[name]["value"] == pytest.approx(true[name], rel=0.1), name


def test_a_speed_is_limited_and_told_in_the_unit_of_the_file(first, tmp_path, capsys):
    """The same record with its angle in degrees: 5 rad/s would be no limit."""
    data, path = read_record(first).data, tmp_path / "degrees.csv"
    table = np.column_stack([data.t, data.u[:, 0], np.degrees(data.y[:, 0])])
    np.savetxt(path, table, fmt="%.9g", delimiter=",", header="time [s],voltage [V],angle [deg]", comments="")
    assert main(["design", str(path), "--for", "ends", "--strike", "5", "--out", str(tmp_path / "o"), "--json"]) == 0
    summary = json.loads(capsys.readouterr().out)
    planned = read_record(tmp_path / "o" / "design.csv").data
    assert planned.y_unit == "rad"
    assert summary["fastest"] == pytest.approx(
        np.degrees(np.abs(np.diff(planned.y[:, 0])).max()) / planned.Ts, rel=1e-4
    )
    assert summary["fastest_unit"] == "deg/s"
    page = (tmp_path / "o" / "report.html").read_text(encoding="utf-8")
    assert f"every {summary['Ts']:g} s, in place of 0.1 s: lag and delay of the joint together" in page
    assert 4.0 < summary["fastest"] <= 5.0
    ends = [value for value in summary["now"] if value["name"] in ("end_low", "end_high")]
    assert [value["unit"] for value in ends] == ["deg", "deg"]
    seen = np.degrees([data.y.min(), data.y.max()])
    assert [value["value"] for value in ends] == pytest.approx(seen, abs=1.0)  # where it rested, with noise


def test_limits_that_cannot_be_are_refused_before_the_fit(first, tmp_path, monkeypatch, capsys):
    monkeypatch.setattr("sysid.workflow.design.fit_joint", lambda *_, **__: pytest.fail("the joint is fitted"))
    for option, value, said in (
        ("--volts", "0", "--volts is 0; give a positive number"),
        ("--strike", "-1", "--strike is -1; give a positive number"),
        ("--sample", "inf", "--sample is inf; give a positive number"),
        ("--sample", "0.2", "--sample is 0.2 s and the log has a sample every 0.1 s"),
    ):
        assert main(["design", str(first), option, value, "--out", str(tmp_path / "o")]) == 2
        assert said in capsys.readouterr().err


def test_a_record_that_is_no_joint_and_targets_that_are_none_are_refused(first, capsys):
    assert main(["design", str(first), "--for", "rust"]) == 2
    assert "--for has 'rust'; give some of ends, breakaway, backlash" in capsys.readouterr().err
    assert main(["design", str(first), "--volts", "1", "--seconds", "1e-9"]) == 2  # with any joint
    assert "may not exceed 1; allow larger inputs or speeds" in capsys.readouterr().err
