"""Plants that a newcomer brings, from the first command to the last: what the first screen says, and its next command.

Each record is drawn here from a plant whose values are known.
"""

import re
import shlex

import numpy as np
import pytest

from sysid.structures import OutputError
from sysid.workflow.identification import identify_file
from sysid.workflow.next_step import proposals
from sysid.workflow.setting import Setting
from twin.cli import main


def held(rng, n, low, high, shortest, longest):
    """An input (n,) of levels from `low` to `high`, each held for `shortest` to `longest` samples."""
    steps = [np.full(rng.integers(shortest, longest), rng.uniform(low, high)) for _ in range(n // shortest + 1)]
    return np.round(np.concatenate(steps)[:n], 1)


def write(path, header, *columns):
    np.savetxt(path, np.column_stack(columns), delimiter=",", header=header, comments="", fmt="%.6g")


def screen(capsys, *words):
    """What a command writes; it must succeed."""
    capsys.readouterr()
    assert main([str(word) for word in words]) == 0
    return capsys.readouterr().out


def next_of(text):
    """The command after "Next", as its words without qpal."""
    found = re.search(r"^Next[^:\n]*: qpal (.*)$", text, re.MULTILINE)
    assert found, text
    return shlex.split(found[1])


@pytest.fixture
def here(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return tmp_path


def unstable(path, seed, n=900, Ts=0.05):
    """A gap [mm] whose pole is +0.5 rad/s, held by a proportional controller of its coil [A]."""
    rng = np.random.default_rng(seed)
    goal, grow, x = held(rng, n, -1.0, 1.0, 20, 100), np.exp(0.5 * Ts), 0.0
    u, y = np.zeros(n), np.zeros(n)
    for k in range(n):
        y[k] = x + 0.01 * rng.standard_normal()
        u[k] = 1.5 * (goal[k] - y[k])
        x = grow * x + 4.0 * (grow - 1.0) * u[k] + 0.005 * rng.standard_normal()
    write(path, "t [s],coil [A],gap [mm]", Ts * np.arange(n), u, y)


def test_a_model_of_an_unstable_plant_is_judged_by_its_prediction_in_both_verbs(here, capsys):
    unstable("a.csv", 1)
    unstable("b.csv", 2)
    columns = ("--input", "coil [A]", "--output", "gap [mm]")
    text = screen(capsys, "identify", "a.csv", *columns, "--structure", "armax", "--starts", 1, "--out", "m")
    (error,) = re.findall(r"error of gap one step ahead, RMS +(\S+)", text)
    assert 0.01 < float(error) < 0.03  # [mm]: the noise of a reading is 0.01
    text = screen(capsys, "run", "m/model.json", "b.csv", *columns)
    first = r"[5-9]\d\.\d\d % . (usable|good): of the record explained by the model's prediction \d+ steps ahead"
    assert re.match(first, text)
    assert "same plant" not in text
    assert "Next" not in text
    assert re.search(r"RMS error \d+ ahead", text)


def test_an_integrating_plant_is_offered_a_process_with_an_integrator(here, capsys):
    rng, n = np.random.default_rng(4), 1000
    u = 40.0 + held(rng, n, -20.0, 20.0, 15, 60)
    level = 50.0 + np.r_[0.0, np.cumsum(0.05 * (u - 40.0))[:-1]] + 0.2 * rng.standard_normal(n)
    write("tank.csv", "t [s],inflow [%],level [cm]", 1.0 * np.arange(n), u, level)
    columns = ("--input", "inflow [%]", "--output", "level [cm]")
    tried = ("--trials", "30")  # a busy machine tries less
    words = next_of(screen(capsys, "identify", "tank.csv", *columns, "--structure", "process", *tried))
    assert words[words.index("--structure") :][:4] == ["--structure", "process", "--kind", "P0I"]
    text = screen(capsys, *words)
    assert "good:" in text.splitlines()[0]
    gain = re.findall(r"^ gain +(\S+)", text, re.MULTILINE)
    assert float(gain[0]) == pytest.approx(0.05, rel=0.01)  # [cm/%/s]


def test_a_voltage_that_moves_an_angle_without_end_stops_leads_to_a_joint(here, capsys):
    """A motor of 20 deg/s/V with 0.4 V of friction; its process fit leaves the friction, which only a joint has."""
    rng, n, Ts = np.random.default_rng(5), 1000, 0.02
    u = held(rng, n, -6.0, 6.0, 15, 50)
    angle, speed, y = 0.0, 0.0, np.zeros(n)
    for k in range(n):
        y[k] = angle + 0.05 * rng.standard_normal()
        for _ in range(20):
            way = np.sign(speed) or np.sign(u[k]) * (abs(u[k]) > 0.4)
            faster = speed + 0.001 / 0.08 * (20.0 * (u[k] - 0.4 * way) * abs(way) - speed)
            speed = 0.0 if speed * faster < 0.0 else faster
            angle += 0.001 * speed
    write("motor.csv", "time [s],motor voltage [V],angle [deg]", Ts * np.arange(n), u, y)
    text = screen(capsys, "identify", "motor.csv", "--structure", "process", "--kind", "P0I")
    assert re.search(r"^(Next|Or)\b[^:\n]*: qpal identify motor.csv --structure actuated_joint$", text, re.MULTILINE)
    assert "armax" not in text


def test_an_input_without_effect_is_said_first_and_no_model_is_searched(here, capsys):
    rng, n = np.random.default_rng(6), 1000
    drift = 20.0 + np.cumsum(0.1 * rng.standard_normal(n))
    write("none.csv", "t [s],u [V],y [degC]", 1.0 * np.arange(n), held(rng, n, 0.0, 10.0, 20, 80), drift)
    for words in (["info", "none.csv"], ["identify", "none.csv", "--structure", "output_error", "--starts", "1"]):
        lines = screen(capsys, *words).splitlines()
        assert "poor" in lines[0]
        assert lines[1].startswith("The record shows no effect of u on y (p = ")
        (step,) = [line for line in lines if line.startswith("Next")]
        assert step.startswith("Next: record again with an input that moves y")


@pytest.mark.parametrize(
    ("column", "leads"), [("temp [degC]", "hammerstein_wiener"), ("angle [deg]", "actuated_joint")]
)
def test_only_what_may_be_a_place_is_offered_end_stops(column, leads, here, capsys):
    """A heater that is clipped at 60 %: its temperature rests at the highest, as an angle at an end stop does."""
    rng, n = np.random.default_rng(7), 1500
    u, y = np.round(held(rng, n, 0.0, 100.0, 60, 160)), np.zeros(n)
    for k in range(1, n):
        y[k] = y[k - 1] + (2.0 * min(u[k - 1], 60.0) - y[k - 1]) / 20.0
    write("sat.csv", f"t [s],heater [%],{column}", 1.0 * np.arange(n), u, 20.0 + y + 0.1 * rng.standard_normal(n))
    assert next_of(screen(capsys, "info", "sat.csv"))[2:4] == ["--structure", leads]
    result = identify_file("sat.csv", Setting(OutputError(1, 1, 1), starts=1), trials=0.0)
    offered = {step.change.get("structure") for step in proposals(result)}  # what is said depends on what was tried
    assert ("actuated_joint" in offered) == (leads == "actuated_joint")
