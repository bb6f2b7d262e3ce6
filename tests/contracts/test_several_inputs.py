"""Logs of several inputs beside one output: all are named, and one command identifies with all of them."""

import re
import shlex

import numpy as np
import pytest

from sysid.channels.guess import Given, guess
from sysid.channels.mapping_file import read_map
from sysid.report.inspection_answer import following
from sysid.workflow.inspection import inspect_file

N, TS = 300, 0.5


def staircase(seed, low, high):
    return np.random.default_rng(seed).uniform(low, high, N // 15).repeat(15)


def answer(*inputs):
    y = np.zeros(N)
    for k in range(1, N):
        y[k] = 0.95 * y[k - 1] + 0.05 * sum(u[k - 1] - u.mean() for u in inputs)
    return 20.0 + y + 0.02 * np.random.default_rng(9).normal(size=N)


PUMP, VALVE, THIRD = staircase(0, 6.0, 18.0), staircase(1, 30.0, 60.0), staircase(2, 0.0, 5.0)


def log(path, header, *columns):
    np.savetxt(path, np.column_stack(columns), delimiter=",", header=header, comments="", fmt="%.6g")
    return path


def named(command):
    """Inputs, output and the other options of a command."""
    words = shlex.split(command)
    assert words[:2] == ["qpal", "identify"]
    options = dict(zip(words[3::2], words[4::2], strict=True))
    return options.pop("--input").split(","), options.pop("--output"), options


@pytest.mark.parametrize(
    ("inputs", "output"),
    [
        (("pump_lpm", "valve_pct"), "level_cm"),
        (("dosing", "valve_pct"), "h_cm"),  # the one stays in most rows, the other is in per cent
        (("pump_cmd", "valve_pct"), "level_cm"),  # one says it by its name
        (("pump_lpm", "valve_pct"), "y"),  # the output says so by its name
        (("heater_W", "fan_pct"), "temp_C"),
        (("pump_lpm", "valve_pct", "inflow_lpm"), "level_cm"),
        (("Pumpe", "Ventil"), "Druck"),
        (("pump (l/min)", "valve (%)"), "level (cm)"),
    ],
)
def test_all_columns_that_may_be_inputs_are_in_one_command(inputs, output, tmp_path):
    us = (PUMP, VALVE, THIRD)[: len(inputs)]
    file = log(tmp_path / "tank.csv", ",".join(["time [s]", *inputs, output]), TS * np.arange(N), *us, answer(*us))
    found = inspect_file(file)
    assert found.signals is None
    assert named(found.command) == (list(inputs), output, {})
    assert following(found) == f"Next: {found.command}"
    assert all(name in found.unclear[0] for name in inputs)


def test_inputs_that_move_in_every_row_say_so_by_their_names(tmp_path):
    noise = np.random.default_rng(4).normal(size=(2, N))
    us = PUMP + noise[0], VALVE + noise[1]
    file = log(tmp_path / "a.csv", "time [s],pump_lpm,valve_mm,level_cm", TS * np.arange(N), *us, answer(*us))
    assert named(inspect_file(file).command) == (["pump_lpm", "valve_mm"], "level_cm", {})


@pytest.mark.parametrize(
    ("given", "options", "words"),
    [
        (Given(), {"--time": "t", "--time-unit": "s"}, "if 't' is in s: "),
        (Given(time="t", time_unit="ms"), {"--time": "t", "--time-unit": "ms"}, ""),
        (Given(Ts=2.0), {"--ts": "2"}, ""),
    ],
)
def test_a_clock_without_a_unit_is_in_the_command(given, options, words, tmp_path):
    file = log(tmp_path / "tank.csv", "t,pump_lpm,valve_pct,level_cm", np.arange(N), PUMP, VALVE, answer(PUMP, VALVE))
    found = inspect_file(file, given=given)
    assert named(found.command) == (["pump_lpm", "valve_pct"], "level_cm", options)
    assert following(found) == f"Next: {words}{found.command}"


def test_a_log_without_a_clock_asks_for_the_sampling_time(tmp_path):
    file = log(tmp_path / "tank.csv", "pump_lpm,valve_pct,level_cm", PUMP, VALVE, answer(PUMP, VALVE))
    said = following(inspect_file(file))
    assert re.match(r"Next: with the sampling time in place of SECONDS: qpal identify .* --ts SECONDS$", said)


def test_the_written_map_has_all_inputs_and_asks_for_each(tmp_path):
    file = log(tmp_path / "tank.csv", "t,pump_lpm,valve_pct,level_cm", np.arange(N), PUMP, VALVE, answer(PUMP, VALVE))
    text = inspect_file(file, map_path="MAP.toml").text
    assert re.findall(r'^column = "(\w+)" +# CHOOSE', text, re.MULTILINE) == ["pump_lpm", "valve_pct"]
    (tmp_path / "MAP.toml").write_text(text)
    mapping = read_map(tmp_path / "MAP.toml")
    assert [c.column for c in mapping.input] == ["pump_lpm", "valve_pct"]
    assert [c.column for c in mapping.output] == ["level_cm"]


def test_a_column_that_never_moves_or_answers_too_is_no_input(tmp_path):
    time, still = TS * np.arange(N), np.full(N, 30.0)
    file = log(tmp_path / "a.csv", "time [s],pump_lpm,valve_pct,level_cm", time, PUMP, still, answer(PUMP))
    assert "valve_pct" not in inspect_file(file).command
    levels = answer(PUMP), answer(VALVE)  # two answers: which inputs belong to one output, nothing says
    file = log(tmp_path / "b.csv", "time [s],pump_lpm,valve_pct,level_cm,other_cm", time, PUMP, VALVE, *levels)
    assert not inspect_file(file).command.startswith("qpal identify")
    coarse = np.round(answer(VALVE))  # an answer that stays in most rows is one where nothing else answers
    file = log(tmp_path / "d.csv", "time [s],valve_pct,flow_lpm", time, VALVE, coarse)
    assert [c.column for c in guess(file).mapping.output] == ["flow_lpm"]
    file = log(tmp_path / "c.csv", "time [s],valve_pct,level_cm", time, VALVE, levels[1])
    assert [c.column for c in guess(file).mapping.input] == ["valve_pct"]
    assert guess(file).unclear == ()
