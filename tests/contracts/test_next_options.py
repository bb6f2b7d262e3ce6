"""What is named next fits the record, costs least first, and keeps the options that still apply."""

import re
import shlex
from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import lfilter

from sysid.structures import HammersteinWiener, OutputError, ServoJoint
from sysid.workflow.changes import command
from sysid.workflow.identification import identify_file
from sysid.workflow.next_step import _search_structures, proposals
from sysid.workflow.setting import Setting
from sysid.workflow.steps import NextStep
from sysid.workflow.trials import tried
from twin.cli import main

N, TS = 800, 0.01


@pytest.fixture(autouse=True)
def in_a_folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)


def servo(path: str, goal: str, place: str) -> str:
    """Steps of 60 degrees at a speed that is limited, as a servo goes to them."""
    r = np.random.default_rng(0).uniform(-60.0, 60.0, N // 50).repeat(50)
    y = np.zeros(N)
    for k in range(1, N):
        y[k] = y[k - 1] + np.clip(0.3 * (r[k - 1] - y[k - 1]), -2.0, 2.0)
    rows = np.column_stack([TS * np.arange(N), r, y + 0.05 * np.random.default_rng(1).standard_normal(N)])
    np.savetxt(path, rows, delimiter=",", header=f"time [s],{goal},{place}", comments="", fmt="%.6g")
    return path


@pytest.mark.parametrize(("goal", "is_servo"), [("goal_deg", True), ("setpoint_V", False), ("voltage_V", False)])
def test_a_goal_in_the_unit_of_the_place_leads_to_a_servo(goal, is_servo, capsys):
    main(["info", servo("log.csv", goal, "pos_deg"), "--out", "i"])
    (said,) = re.findall(r"^Next: (.*)$", capsys.readouterr().out, re.MULTILINE)
    assert said.endswith("--structure servo_joint") is is_servo
    result = identify_file("log.csv", Setting(OutputError(1, 1, 1), starts=1))
    structures = [step.change.get("structure") for step in proposals(result)]
    assert ("servo_joint" in structures) is is_servo
    if is_servo:
        assert structures.index("servo_joint") < structures.index("auto")


def lagging():
    u = np.random.default_rng(2).uniform(-1.0, 1.0, N // 20).repeat(20)
    y = lfilter([0.0, 0.1], [1.0, -0.9], u) + 0.2 * u**2
    np.savetxt("lag.csv", np.column_stack([TS * np.arange(N), u, y]), delimiter=",", header="t,u,y", comments="")
    return identify_file("lag.csv", Setting(OutputError(1, 1, 1, offset="none"), starts=1))


def test_another_structure_keeps_what_was_given_and_it_has_too():
    words = shlex.split(command(lagging(), structure=HammersteinWiener.name, nf=1))
    assert words[words.index("--offset") + 1] == "none"
    assert main([*words[1:], "--starts", "1", "--trials", "0", "--out", "o"]) == 0


def test_a_search_says_which_known_value_it_does_not_take():
    result = replace(lagging(), asked=Setting(ServoJoint(dead=0.5), starts=1))
    search = _search_structures(result)
    assert search.why.endswith("(a search does not take --dead)")
    assert "--dead" not in search.command


def test_a_process_is_tried_before_more_starts():
    result, asked = lagging(), []
    e = result.evaluation
    result = replace(result, evaluation=replace(e, fit=replace(e.fit, seconds=5.0)))  # 20 starts would take 100 s
    steps = [
        NextStep("the search did not converge", "a", {"starts": 20}),
        NextStep("a process", "b", {"structure": "process", "kind": "P2D"}, guess=True),
    ]

    def attempt(setting, *_):
        asked.append(setting.recipe.name)
        return result.evaluation

    tried(result, steps, attempt, 100.0)
    assert asked[0] == "process"
