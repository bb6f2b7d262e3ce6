"""The next step of a record that is too short to show a joint: an experiment, whose record does show it."""

import json
import shlex

import pytest

from twin.cli import main

LEG = ["--joint", "thigh", "--params", "leg.toml"]
SHORT = ["--excitation", "aprbs", "--duration", "20", "--ts", "0.05", "--seed", "4"]


def identified(log, out):
    main(["identify", log, "--structure", "actuated_joint", "--out", out])
    with open(f"{out}/summary.json") as file:
        return json.load(file)


@pytest.mark.nightly
def test_a_record_that_shows_no_joint_leads_to_one_that_does(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "leg.toml").write_text("[thigh]\ncoulomb = 45\nviscous = 700\n")
    assert main(["simulate", *LEG, *SHORT, "--log", "short.csv"]) == 0
    first = identified("short.csv", "first")
    assert not first["joint"]["joint"]
    words = shlex.split(first["next"]["command"])
    assert words == ["qpal", "design", "short.csv"]
    assert main([*words[1:], "--out", "design"]) == 0
    assert "does not show whether it is that of an actuated joint" in " ".join(capsys.readouterr().out.split())
    assert main(["simulate", *LEG, "--input-log", "design/design.csv", "--log", "new.csv"]) == 0
    then = identified("new.csv", "then")
    assert then["joint"]["joint"]
    assert then["fit_percent"]["validation"] > 90.0
