"""`qpal demo`: the truth beside what was identified, and commands that work as they are named."""

import json
import re
import shlex
from types import SimpleNamespace

import numpy as np
import pytest

from sysid.joint.values import JointValue
from twin.cli import main
from twin.report import demo


def test_each_value_stands_beside_its_truth_in_one_unit():
    values = (
        JointValue("end_low", -0.2, -0.25, -0.15, "rad"),
        JointValue("end_high", 0.9, 0.85, 0.95, "rad"),
        JointValue("backlash", 0.01, None, None, "rad", False, "crossings by the link: 5, but 6 are needed"),
    )
    result = SimpleNamespace(evaluation=SimpleNamespace(values=values, judged_fit=98.7))
    true = {"end_low": np.radians(-10.0), "end_high": 0.84, "backlash": np.radians(0.5)}
    rows = demo.grid(result, true).rows
    assert [row[3:] for row in rows] == [("−10.00", "yes", "deg"), ("48.13", "no", "deg"), ("0.5000", "–", "deg")]
    assert [row[1] for row in rows[:2]] == ["−11.5", "51.6"]
    assert demo.open_values(result, "my runs/log.csv")[0].endswith("5, but 6 are needed.")


@pytest.mark.nightly  # tests/cli/test_every_verb.py runs it too
def test_the_intervals_hold_the_truth_and_each_command_that_it_names_runs(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert main(["demo", "--out", "made"]) == 0
    shown = capsys.readouterr().out
    assert "interval holds it" in shown
    summary = json.loads((tmp_path / "made" / "summary.json").read_text(encoding="utf-8"))
    assert summary["fit_percent"]["validation"] > 98.0
    commands = re.findall(r"qpal ((?:info|design --for \w+) made/log\.csv)", shown)
    assert len(commands) >= 2
    assert "FILE" not in shown
    for command in commands:
        assert main(shlex.split(command)) == 0, command
