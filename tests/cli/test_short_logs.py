"""Logs that hold little: few samples, a single step, a signal that never moves. Each has a next step, and it works."""

import re
import shlex

import numpy as np
import pytest

from sysid.report.answer import POOR
from sysid.report.inspection_answer import answer
from sysid.structures import HammersteinWiener, OutputError, ServoJoint
from sysid.workflow.identification import identify_file
from sysid.workflow.inspection import inspect_file
from sysid.workflow.next_step import proposals
from sysid.workflow.setting import Setting
from twin.cli import main


def written(folder, N=60, goal=False, u=None, still=False):
    """A log of a lag that follows steps of five samples, or the input `u` (N,)."""
    rng, y = np.random.default_rng(1), np.zeros(N)
    u = np.repeat(rng.uniform(-3.0, 3.0, N // 5 + 1), 5)[:N] if u is None else u
    for k in range(N - 1):
        y[k + 1] = y[k] + 0.1 / 0.5 * (u[k] - y[k])
    y = np.zeros(N) if still else y + 0.01 * rng.normal(size=N)
    names = "goal [deg],angle [deg]" if goal else "u [V],y [degC]"
    path = folder / "log.csv"
    np.savetxt(path, np.column_stack([0.1 * np.arange(N), u, y]), "%.6g", ",", header=f"t [s],{names}", comments="")
    return path


@pytest.fixture(autouse=True)
def there(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)


def screen(path):
    return answer(inspect_file(path.name), None)


def runs(command):
    return main([*shlex.split(command)[1:], "--starts", "1", "--trials", "0", "--out", "next"]) == 0


@pytest.mark.parametrize("goal", [False, True])
def test_a_short_log_leads_to_a_structure_that_its_samples_can_hold(tmp_path, goal):
    step = screen(written(tmp_path, goal=goal)).next
    assert step == "Next: qpal identify log.csv --structure output_error"
    assert runs(step.removeprefix("Next: "))


def test_two_samples_a_parameter_are_enough_to_lead_to_a_structure(tmp_path):
    """The default has 48 parameters, and half of the record is for the fit."""
    moving = np.r_[np.random.default_rng(0).normal(size=30), np.zeros(370)]  # in one half, with more than two levels
    assert inspect_file(written(tmp_path, 400, u=moving)).first == ("identify",)
    for N, structure in ((192, ("--structure", "output_error")), (194, ())):
        assert inspect_file(written(tmp_path, N)).first == ("identify", *structure)
    assert inspect_file(written(tmp_path, 400, goal=True)).first == ("identify", "--structure", "servo_joint")
    assert inspect_file(written(tmp_path, 20)).first == ("identify",)  # no structure has room; data are asked for


def test_a_refusal_counts_all_samples_and_what_it_says_works(tmp_path, capsys):
    path = written(tmp_path)
    assert main(["identify", path.name]) == 2
    said = capsys.readouterr().err
    assert "of 60 samples --split 0.5 leaves 30 for the fit, which are too few for the 48 free parameters" in said
    assert "or record at least 98 samples" in said
    assert runs(f"qpal identify log.csv {re.search('--structure output_error', said)[0]}")
    assert main(["identify", path.name, "--split", "0.7"]) == 2
    assert "of 60 samples --split 0.7 leaves 42 for" in capsys.readouterr().err
    path.rename("other.csv")
    written(tmp_path, 40)
    assert main(["identify", path.name, "--validation", "other.csv"]) == 2
    assert "log.csv: 40 samples are too few for the 48 free parameters" in capsys.readouterr().err


def test_a_fit_of_a_short_log_proposes_no_structure_that_its_samples_cannot_hold(tmp_path):
    """Below two samples a parameter the goal of the log is no reason for a servo's loop."""
    for N, is_led in ((60, False), (400, True)):
        found = identify_file(written(tmp_path, N, goal=True), Setting(OutputError(1, 1, 3), starts=1))
        steps = [step.change.get("structure") for step in proposals(found)]
        assert (ServoJoint.name in steps) == is_led
        assert HammersteinWiener.name not in steps or is_led


def test_a_single_step_leads_to_a_process_which_fits_it(tmp_path):
    found = screen(written(tmp_path, 200, u=np.where(np.arange(200) < 40, 0.0, 3.0)))
    assert found.word != POOR
    assert found.next == "Next: qpal identify log.csv --structure process"
    assert runs(found.next.removeprefix("Next: "))


@pytest.mark.parametrize(
    ("given", "signal", "role"), [({"u": np.full(60, 2.0)}, "u [V]", "input"), ({"still": True}, "y [degC]", "output")]
)
def test_a_signal_that_never_moves_is_named_and_what_has_to_be_recorded(tmp_path, given, signal, role):
    found = screen(written(tmp_path, **given))
    assert found.word == POOR
    assert found.sentence == f"{signal} never changes, and no column that moves is left for the {role}."
    assert found.next == f"Next: record again while the {role} moves, or give a log that has it"


def test_a_log_of_one_signal_says_what_a_log_needs(tmp_path):
    path = tmp_path / "log.csv"
    rows = np.column_stack([0.1 * np.arange(60), np.random.default_rng(0).normal(size=60)])
    np.savetxt(path, rows, "%.6g", ",", header="t [s],u [V]", comments="")
    found = screen(path)
    assert found.sentence.endswith("of which t [s] shows time: no column is left for the output.")
    assert found.next.startswith("Next: give a log that has an input and an output, recorded together, or all files")
