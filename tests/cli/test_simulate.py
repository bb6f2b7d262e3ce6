"""`qpal simulate`: modes, joints, settings and parameters reach the log; what does not fit ends in a sentence."""

import json

import numpy as np
import pytest

import twin
from sysid.formats import WRITTEN
from twin.cli import main


@pytest.mark.parametrize("suffix", WRITTEN)
@pytest.mark.parametrize("mode", ["voltage", "servo"])
def test_a_log_of_all_joints_comes_back_from_its_file(suffix, mode, tmp_path, capsys):
    path = tmp_path / f"leg{suffix}"
    given = ["--joint", "leg", "--mode", mode, "--excitation", "aprbs", "--duration", "6", "--set", "hold_max=1.5"]
    assert main(["simulate", *given, "--log", str(path), "--out", str(tmp_path / "out"), "--json"]) == 0
    summary = json.loads(capsys.readouterr().out)
    assert set(summary["truth"]) == set(summary["angle_range"]) == set(twin.JOINTS)
    assert summary["truth"]["thigh"]["mode"] == mode
    direct = twin.Experiment("leg", "aprbs", 6.0, seed=1, mode=mode, options={"hold_max": 1.5}).run()
    back = twin.Log.load(path)
    assert (back.joint, back.mode) == ("leg", mode)
    for name in ("u", "y", "y_true"):
        np.testing.assert_array_equal(getattr(back, name), getattr(direct, name))
    np.testing.assert_array_equal(back.io("shank").y[:, 0], direct.y[:, 2])
    assert back.io().y.shape == (60, 3)


def test_settings_parameters_and_layout_reach_the_experiment(tmp_path, capsys):
    values = tmp_path / "leg.toml"
    values.write_text("[shank]\ncoulomb = 10.0\n", encoding="utf-8")
    given = ["--joint", "shank", "--set", "amplitude=9,half_period=3", "--pot-side", "drive", "--params", str(values)]
    given += ["--realisation", "closed_loop", "--duration", "10"]
    assert main(["simulate", *given, "--out", str(tmp_path / "out"), "--json"]) == 0
    log = json.loads(capsys.readouterr().out)["log"]
    assert log["options"]["amplitude"] == 9
    assert log["options"]["half_period"] == 3
    assert (log["pot_side"], log["realisation"]) == ("drive", "closed_loop")
    assert log["parameters_changed"] == {"shank.coulomb": 10.0}


def test_stroke_keeps_the_joint_inside(tmp_path, capsys):
    given = ["--joint", "shoulder", "--excitation", "aprbs", "--duration", "20", "--stroke", "inside"]
    assert main(["simulate", *given, "--out", str(tmp_path / "out"), "--json"]) == 0
    summary = json.loads(capsys.readouterr().out)
    low, high = twin.truth("shoulder").end_angles
    assert low + 0.02 < summary["angle_range"][0] < summary["angle_range"][1] < high - 0.02
    assert summary["resting_at_ends"] == 0.0


@pytest.mark.parametrize(
    ("given", "says"),
    [
        (["--set", "amplitude=20"], "reaches 20 V, the supply 12 V; give a smaller"),
        (["--set", "amplitude"], "give name=value"),
        (["--set", "amplitude=6,amplitude=7"], "names amplitude twice"),
        (["--set", "amplitude=loud"], "give a number above 0"),
        (["--set", "colour=1"], "unknown option of sweep 'colour'"),
        (["--mode", "torque"], "unknown mode 'torque'"),
        (["--joint", "leg", "--stroke", "inside"], "design one joint at a time"),
        (["--stroke", "sideways"], "unknown where 'sideways'"),
        (["--pot-side", "both"], "unknown pot side 'both'"),
        (["--realisation", "gears"], "unknown realisation 'gears'"),
        (["--params", "nowhere.toml"], "does not exist"),
        (["--without", "rust"], "unknown imperfection 'rust'"),
    ],
)
def test_what_does_not_fit_is_said_in_one_line(given, says, tmp_path, capsys):
    assert main(["simulate", *given, "--duration", "10", "--out", str(tmp_path / "out")]) == 2
    said = capsys.readouterr().err
    assert says in said
    assert said.count("\n") == 1
    assert not list(tmp_path.iterdir())
