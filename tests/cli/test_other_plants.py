"""Records of plants that are no leg, and sentences on them that people can act on."""

import re
import shlex
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.signal import lfilter
from shown import joint_fit

import twin
from sysid.joint.values import JointValue
from sysid.report import gain, identify_answer
from sysid.report.answer import WORDS
from sysid.report.sections import undetermined_in_words
from sysid.structures import OutputError
from sysid.uncertainty.intervals import Interval
from sysid.workflow.identification import identify_file
from sysid.workflow.setting import Setting
from twin.cli import main

N = 400


@pytest.fixture(autouse=True)
def in_a_folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)


def written(path: str, header: str, seed: int, zero: float = 0.0, inputs: int = 1) -> str:
    rng = np.random.default_rng(seed)
    u = [rng.uniform(-1.0, 1.0, N // 20).repeat(20) * (1.0 + 0.5 * (np.arange(N) > N // 2)) for _ in range(inputs)]
    y = zero + lfilter([0.0, 0.3], [1.0, -0.9], sum(u)) + 0.01 * rng.normal(size=N)
    np.savetxt(path, np.column_stack([0.1 * np.arange(N), *u, y]), delimiter=",", header=header, comments="")
    return path


OVEN = "t [s],heater [V],T [degC]"


def test_a_record_in_any_unit_is_compared_with_its_saved_model(capsys):
    for name, seed in (("mon.csv", 0), ("tue.csv", 1)):
        written(name, OVEN, seed, 20.0)
    given = ["--structure", "output_error", "--orders", "1,1,1", "--starts", "1", "--trials", "0", "--out", "m"]
    assert main(["identify", "mon.csv", *given]) == 0
    capsys.readouterr()
    assert main(["compare", "tue.csv", "--against", "m/model.json", "--out", "c"]) == 0
    assert "● good: of the record explained by the model's free run" in capsys.readouterr().out
    assert main(["compare", "tue.csv", "--against", "m/model.json", "--align", "delay", "--out", "d"]) == 2


def test_a_temperature_is_told_to_be_no_angle_and_the_command_that_is_named_works(capsys):
    written("my oven.csv", OVEN, 0, 20.0)
    assert main(["compare", "my oven.csv"]) == 2
    said = capsys.readouterr().err
    assert "needs an angle; for another plant: qpal identify 'my oven.csv'" in said
    assert "deg" not in said.partition("needs")[2]
    (command,) = re.findall("qpal (identify .*)", said)
    more = ["--structure", "output_error", "--orders", "1,1,1", "--starts", "1", "--trials", "0"]
    assert main([*shlex.split(command), *more]) == 0


def test_a_joint_that_nobody_named_is_said_first(capsys):
    log = twin.Experiment("thigh", "aprbs", 10.0, seed=1).run()
    rows = np.column_stack([log.Ts * np.arange(len(log.u)), log.u, np.rad2deg(log.y)])
    np.savetxt("motor.csv", rows, delimiter=",", header="t [s],motor [V],angle [deg]", comments="")
    given = ["--free", "coulomb,no_load_speed", "--fix", "dead_band", "--seconds", "1e-9", "--out", "o"]
    assert main(["calibrate", "motor.csv", *given]) in (0, 1)
    said = " ".join(capsys.readouterr().out.split())
    first = said.index("No --joint is given, so the leg's thigh was taken")
    assert first < said.index("qpal identify motor.csv --structure actuated_joint")
    assert len(said[: said.index("--structure actuated_joint")].split()) <= WORDS


def test_a_channel_of_several_is_named_where_the_model_extrapolates():
    path = written("two.csv", "t [s],Pump [V],Valve [V],Level [m]", 3, inputs=2)
    result = identify_file(
        path, Setting(OutputError(1, 1, 1), starts=1), input="Pump [V],Valve [V]", output="Level [m]"
    )
    said = [note for note in result.evaluation.notes if "was seen from" in note]
    assert said
    assert all(note.startswith(("Pump was", "Valve was", "Level was")) for note in said)


def test_friction_at_rest_that_is_shown_and_not_measured_is_one_claim():
    value = JointValue("moving_friction_up", 0.6, 0.5, 0.7, "V", True, "break-away is not determined: no starts")
    found = joint_fit()
    assert "higher friction at rest upward" in found.sentence()
    said = undetermined_in_words(SimpleNamespace(values=(value,), joint_fit=found))
    assert "Break-away voltage up (above the moving friction, but not by how much): no starts." in said
    open_ = replace(found, parts=found.parts[1:])
    assert "above the moving" not in undetermined_in_words(SimpleNamespace(values=(value,), joint_fit=open_))


@pytest.mark.parametrize(("half", "said"), [(0.2, r"1\.80* to 2\.20*"), (14.0, "not determined")])
def test_a_gain_whose_sign_is_open_is_not_determined(half, said, monkeypatch):
    result = identify_file(written("log.csv", OVEN, 4), Setting(OutputError(1, 1, 1), starts=1))
    found = Interval(2.0, half / 2.0, 2.0 - half, 2.0 + half)
    monkeypatch.setattr(gain.intervals, "gain", lambda info, u: found)
    (row,) = [row for row in identify_answer.values(result.evaluation).rows if row[0].startswith("gain")]
    assert re.fullmatch(said, row[2])
