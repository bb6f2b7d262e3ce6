"""What a log says without a map: the unit of its clock, which column is which, and where there are two readings."""

import shlex

import numpy as np
import pytest
from rig_tables import table

from sysid import InputError
from sysid.channels.guess import Given, guess
from sysid.channels.reading import from_table
from twin.cli import main


@pytest.mark.parametrize(
    ("name", "step", "unit", "seconds"),
    [
        ("t", 0.1, None, 0.1),  # in s alone: 0.1 ms is no step of an actuator's log
        ("time", 0.002, None, 0.002),
        ("t", 20.0, None, 0.020),  # in ms alone: 20 s is none either
        ("t", 20000.0, None, 0.020),
        ("millis", 5.0, None, 0.005),
        ("micros", 5.0, None, 5e-6),
        ("t", 10.0, "s", 10.0),
        ("t", 10.0, "ms", 0.010),
        ("time", 0.5, "min", 30.0),
    ],
)
def test_the_unit_of_a_clock(name, step, unit, seconds):
    k = np.arange(100)
    made = from_table(table({name: unit} if unit else {}, **{name: step * k, "u": k % 7, "y": k % 5}))
    assert made.Ts == pytest.approx(seconds, rel=1e-12)


@pytest.mark.parametrize("step", [0.5, 1.0, 5.0, 10.0, 2000.0])
def test_a_clock_of_two_plausible_units_is_refused(step):
    k = np.arange(100)
    columns = table(t=step * k, u=k % 7, y=k % 5)
    with pytest.raises(
        InputError, match=r"column 't' names no unit, and its steps of .* say which with --time 't' --time-unit m?s"
    ):
        from_table(columns)
    for unit, factor in (("s", 1.0), ("ms", 1e-3)):
        made = from_table(columns, Given(time="t", time_unit=unit))
        assert made.Ts == pytest.approx(step * factor, rel=1e-12)


def test_stamps_since_1970_say_their_unit():
    k = np.arange(200)
    for scale in (1.0, 1e3, 1e6):
        made = from_table(table(stamp=(1.76e9 + 0.01 * k) * scale, u=k % 7, y=k % 5))
        assert made.Ts == pytest.approx(0.01, rel=1e-4)


K = np.arange(120)
MOVES = {"a": np.sin(K), "b": np.cos(0.3 * K), "c": np.sin(0.2 * K**1.1)}


@pytest.mark.parametrize(
    ("names", "units", "said"),
    [
        (("t", "x", "z"), {}, "name one with --input and one with --output"),
        (("t", "voltage", "pwm", "angle"), {}, "columns 'voltage', 'pwm' may each be the input"),
        (("t", "goal_position", "duty", "position"), {}, "columns 'goal_position', 'duty' may each be the input"),
        (("t", "u", "angle_1", "angle_2"), {}, "columns 'angle_1', 'angle_2' may each be the output"),
        (("t", "control_output", "angle"), {}, "'control_output' fits an input and an output"),
        (("t", "angle", "speed"), {}, "name one with --input"),
        (("t", "angle"), {}, "no column is left for the input"),
        (("t", "p", "q1", "r"), {"p": "V", "r": "V"}, "columns 'p', 'r' may each be the input"),
        (("u", "y"), {}, "no sampling time is given; give it with --ts"),
        (("index", "u", "y"), {}, "no sampling time is given"),
    ],
)
def test_what_has_two_readings_is_refused(names, units, said):
    moves = {name: np.sin((0.1 + 0.05 * j) * K) for j, name in enumerate(names)}
    for clock in ("t", "index"):
        if clock in moves:
            moves[clock] = 0.01 * K if clock == "t" else K
    found = guess(table(units, **moves))
    assert said in found.unclear[0]
    with pytest.raises(InputError, match=r"rig\.csv: "):
        found.sure(table(**moves))


@pytest.mark.parametrize(
    ("names", "units", "input", "output"),
    [
        (("y", "u"), {}, "u", "y"),  # in this order a file of two columns is turned round
        (("t", "angle_deg", "voltage"), {}, "voltage", "angle_deg"),
        (("time", "goal_position", "position", "temp"), {}, "goal_position", "position"),
        (("t", "u", "speed", "y"), {}, "u", "y"),
        (("t", "ch1", "ch2"), {"ch1": "deg", "ch2": "V"}, "ch2", "ch1"),
        (("t", "pot_voltage", "motor_voltage"), {}, "motor_voltage", "pot_voltage"),
        (("t", "GoalPosition", "PresentPosition"), {}, "GoalPosition", "PresentPosition"),
        (("t", "u", "x"), {}, "u", "x"),
    ],
)
def test_roles_by_name_unit_and_elimination(names, units, input, output):
    moves = {name: np.sin((0.1 + 0.05 * j) * K) for j, name in enumerate(names)}
    moves |= {clock: 0.01 * K for clock in ("t", "time") if clock in moves}
    found = guess(table(units, **moves), Given(Ts=None if {"t", "time"} & set(names) else 0.1))
    assert not found.unclear
    assert (found.mapping.input[0].column, found.mapping.output[0].column) == (input, output)


def test_a_path_is_read_first(tmp_path):
    path = tmp_path / "rig.csv"
    np.savetxt(path, np.column_stack([0.01 * K, np.sin(K), np.cos(K)]), delimiter=",", header="t,y,u", comments="")
    for named in (path, str(path)):
        found = guess(named)
        assert not found.unclear
        assert (found.mapping.input[0].column, found.mapping.output[0].column) == ("u", "y")
    with pytest.raises(InputError, match=r"none\.csv"):
        guess(tmp_path / "none.csv")


def test_a_supply_is_no_input():
    goal, volts = np.sin(0.1 * K), 7.4 + 0.3 * np.sin(K)
    found = guess(table(timestamp=0.005 * K, goal_position=goal, position=goal, input_volts=volts))
    assert found.mapping.input[0].column == "goal_position"
    assert any("'input_volts' barely varies" in sentence for sentence in found.why)


@pytest.mark.parametrize("output", [None, "Level (cm)"])
def test_two_inputs_in_one_unit_are_both_named(output, tmp_path, monkeypatch, capsys):
    """A valve from 42 to 68 % varies within a third of its mean, as a supply, but as much as the pump beside it."""
    pump, valve = (np.random.default_rng(seed).uniform(*ends, 200) for seed, ends in ((0, (36, 75)), (1, (42, 68))))
    log = {"t (s)": np.arange(200.0), "Pump (%)": pump, "Valve (%)": valve, "Level (cm)": np.cumsum(pump - valve)}
    units = {name: name.partition("(")[2].rstrip(")") for name in log}
    found = guess(table(units, **log), Given(output=output))
    assert not any("supply" in sentence for sentence in found.why)
    options = "--input 'Pump (%),Valve (%)' --output 'Level (cm)'"
    assert found.unclear[0].endswith(options)
    monkeypatch.chdir(tmp_path)
    np.savetxt("tank.csv", np.column_stack(list(log.values())), delimiter=",", header=",".join(log), comments="")
    given = ["tank.csv", *shlex.split(options), "--structure", "output_error", "--orders", "1,1,1", "--starts", "1"]
    assert main(["identify", *given, "--trials", "0", "--out", "m"]) == 0  # the options that are named work
    main(["info", "tank.csv"])
    assert f"Next: qpal identify tank.csv {options}" in capsys.readouterr().out


def test_a_column_in_the_unit_of_the_input_is_not_lost_silently():
    log = {"Heater PWM (%)": 50 + 20 * np.sin(K), "Fan (%)": 50 + 20 * np.cos(K), "angle (deg)": np.sin(0.3 * K)}
    found = guess(table({"Heater PWM (%)": "%", "Fan (%)": "%", "angle (deg)": "deg"}, **{"t (s)": 1.0 * K}, **log))
    assert found.mapping.input[0].column == "Heater PWM (%)"
    assert any("Fan (%) left out" in s and "--input 'Heater PWM (%),Fan (%)'" in s for s in found.why)


@pytest.mark.parametrize(("warm", "unit"), [("T", "degC"), ("T_C", ""), ("T", "Nm"), ("t", "N"), ("T (K)", "")])
@pytest.mark.parametrize("clock", ["time_s", "time", "t_ms"])
def test_what_rises_in_a_unit_that_is_no_time_is_no_clock(clock, warm, unit):
    """A motor that warms up in a test rises as a clock does."""
    k, step = np.arange(100), 10.0 if clock == "t_ms" else 0.01
    made = from_table(
        table({warm: unit} if unit else {}, **{clock: step * k, "u": k % 7, "y": k % 5, warm: 20 + k / 9})
    )
    assert made.input[0].values[3] == 3.0
    assert made.Ts == pytest.approx(0.01, rel=1e-12)


def test_columns_that_show_the_time_of_the_clock_are_neither_input_nor_output():
    k = np.arange(100)
    times = dict.fromkeys(("cmd.time", "cmd.stamp", "position.time"), 0.01 * k)
    made = from_table(table({}, **times, **{"cmd.voltage": k % 7, "position.angle": k % 5}))
    assert (made.input[0].column, made.output[0].column, made.Ts) == ("cmd.voltage", "position.angle", 0.01)
