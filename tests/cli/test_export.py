"""`qpal export`: what it writes loads where it is meant to go."""

import json
import runpy

import mujoco
import numpy as np
import pytest

import sysid
import twin
from twin.cli import main

ROBOT = """<mujoco><compiler meshdir="parts"/><asset><mesh name="m" file="m.obj"/></asset><worldbody>
  <body><joint name="knee" axis="0 1 0"/><geom type="mesh" mesh="m"/></body></worldbody></mujoco>"""
TETRAHEDRON = "v 0 0 0\nv .1 0 0\nv 0 .1 0\nv 0 0 .1\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n"


@pytest.fixture(scope="module")
def log(tmp_path_factory):
    path = tmp_path_factory.mktemp("log") / "shank.csv"
    twin.Experiment(joint="shank", excitation="aprbs", duration=60.0, Ts=0.1, seed=4).run().save(path)
    return path


def test_a_log_becomes_a_joint_of_a_robot_with_meshes(log, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "parts").mkdir()
    (tmp_path / "parts" / "m.obj").write_text(TETRAHEDRON)
    (tmp_path / "robot.xml").write_text(ROBOT)
    command = ["export", str(log), "--name", "knee", "--into", "robot.xml", "--torque-per-volt", "9", "--json"]
    assert main([*command, "--out", "made"]) == 0
    summary = json.loads(capsys.readouterr().out)
    assert summary["files"] == ["knee.xml", "robot.xml"]
    assert summary["difference_rms_percent_of_stroke"] < 0.5
    (tmp_path / "made" / "robot.xml").rename(tmp_path / "new.xml")  # beside its meshes
    model = mujoco.MjModel.from_xml_path("new.xml")
    assert {model.joint(k).name for k in range(model.njnt)} == {"knee", "knee_motor"}


def test_c_python_and_mjcf_of_a_saved_fit(log, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    data = twin.Log.load(log).io()
    fit = sysid.fit(sysid.structures.actuated_joint(play=False), data, search="lm", starts=2, seed=0)
    fit.save("model.json")
    assert main(["export", "model.json", "--c", "--python", "--mjcf", "--name", "knee", "--out", "made", "--json"]) == 0
    summary = json.loads(capsys.readouterr().out)
    assert summary["difference_rms_percent_of_stroke"] < 0.5
    assert sorted(summary["files"]) == ["knee.c", "knee.h", "knee.py", "knee.xml"]
    assert mujoco.MjModel.from_xml_path("made/knee.xml").nu == 1
    run = runpy.run_path("made/knee.py")["simulate"]
    np.testing.assert_allclose(
        run(data.u[:50, 0].tolist()), fit.model.simulate(fit.theta, data.u).ravel()[:50], atol=1e-9
    )


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["model.json"], "add --mjcf, --c, --fmu, --python, --matlab, --onnx, --modelica or --control"),
        (["log.csv", "--c"], "log.csv"),
        (["model.json", "--mjcf"], "a output_error has no motor"),
        (["gone.json", "--mjcf"], "gone.json"),
        (["model.json", "--mjcf", "--name", "no joint"], "no joint"),
    ],
)
def test_what_cannot_be_exported_is_said(arguments, said, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    u = np.repeat(np.random.default_rng(0).uniform(-1, 1, 30), 4)
    sysid.fit(sysid.structures.output_error(1, 1, 1), sysid.IOData(u, np.cumsum(u), 0.1)).save("model.json")
    (tmp_path / "log.csv").write_text("u,y\n1,2\n2,3\n3,3\n")
    assert main(["export", *arguments]) == 2
    err = capsys.readouterr().err
    assert said in err
    assert err.count("\n") == 1
    assert not (tmp_path / "runs").exists()
