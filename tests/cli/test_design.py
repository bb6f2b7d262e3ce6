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


def test_the_break_away_that_a_sweep_hides_is_found_with_the_proposed_experiment(first, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert main(["design", str(first), "--for", "ends,breakaway", "--out", "next", "--json"]) == 0
    summary = json.loads(capsys.readouterr().out)
    read = read_record("next/design.csv")
    assert (read.data.Ts, read.data.u_unit, read.data.y_unit) == (pytest.approx(0.02), "V", "rad")
    assert summary["Ts"] == pytest.approx(0.02)  # a third of lag and delay, in place of more than both
    assert summary["duration"] == pytest.approx(read.data.N * 0.02)
    assert np.abs(read.data.u).max() == pytest.approx(summary["largest_input"])
    told = main(["simulate", "--joint", "thigh", "--input-log", "next/design.csv", "--log", "second.csv", "--out", "s"])
    assert told == 0
    capsys.readouterr()
    assert main(["identify", "second.csv", "--structure", "actuated_joint", "--out", "i", "--json"]) == 0
    found, true = values(json.loads(capsys.readouterr().out)), twin_truth("thigh", 0.02)
    for name in ("breakaway_up", "breakaway_down"):
        assert found[name]["value"] == pytest.approx(true[name], rel=0.1), name


def test_a_record_that_is_no_joint_and_targets_that_are_none_are_refused(first, capsys):
    assert main(["design", str(first), "--for", "rust"]) == 2
    assert "--for has 'rust'; give some of ends, breakaway, backlash" in capsys.readouterr().err
    assert main(["design", str(first), "--volts", "1"]) == 2
    assert "may not exceed 1; allow larger inputs or speeds" in capsys.readouterr().err
