"""Logs of controllers: which column goes into the plant, and which is asked for."""

import numpy as np
import pytest

import sysid
from sysid.base.errors import InputError
from sysid.channels.guess import guess


def loop(seed=0, kp=2.0, holds=20):
    """Set point, output of a PI controller from 0 to 100, and measured temperature of an oven (N,), every 0.5 s."""
    rng, Ts = np.random.default_rng(seed), 0.5
    goal, x, integral = np.repeat(rng.uniform(20.0, 60.0, holds), 60), 20.0, 0.0
    u, y = np.zeros(len(goal)), np.zeros(len(goal))
    for k, wanted in enumerate(goal):
        y[k] = x + 0.05 * rng.normal()
        integral += (wanted - y[k]) * Ts / 20.0
        u[k] = min(max(kp * (wanted - y[k] + integral), 0.0), 100.0)
        x += Ts / 15.0 * (20.0 + 0.6 * u[k] - x)
    return goal, u, y


def written(folder, names, *columns):
    path = folder / "log.csv"
    rows = np.column_stack([0.5 * np.arange(len(columns[0])), *columns])
    np.savetxt(path, rows, "%.6g", ",", header=f"time [s],{names}", comments="")
    return path


@pytest.mark.parametrize(
    "names",
    [
        "setpoint,output,measurement",
        "sp,co,pv",
        "set point,controller output,measurement",
        "Setpoint,Output,Input",
        "target,pwm,temp",
        "setpoint [degC],heater [%],temperature [degC]",
        "goal [deg],duty,angle [deg]",
        "set point [%],valve,level [%]",
    ],
)
def test_what_a_controller_gives_out_is_the_input_and_what_follows_the_set_point_the_output(tmp_path, names):
    goal, actuator, answer = names.split(",")
    for order in ((0, 1, 2), (2, 0, 1), (1, 2, 0)):
        columns = [(names.split(",")[k], loop()[k]) for k in order]
        found = guess(written(tmp_path, ",".join(name for name, _ in columns), *(c for _, c in columns)))
        assert not found.unclear
        assert [found.mapping.input[0].column, found.mapping.output[0].column] == [actuator, answer]
        said = " ".join(found.why)
        assert f"column {goal!r} is the set point of a controller by its name, and {answer!r} follows it" in said
        assert f"--input {goal!r} --output {answer!r}" in said


@pytest.mark.parametrize(
    ("names", "more"),
    [
        ("goal [deg],angle [deg]", None),
        ("goal [deg],current [A],angle [deg]", 1),  # of a servo's motor
        ("goal [deg],drive_share,angle [deg]", 1),
        ("goal [deg],humidity,angle [deg]", "noise"),  # which does not jump with the goal
        ("goal [deg],voltage [V],angle [deg]", "supply"),
    ],
)
def test_the_goal_of_a_servo_is_its_input_where_no_other_column_drives_it(tmp_path, names, more):
    goal, u, y = loop()
    rng = np.random.default_rng(1)
    middle = {None: [], 1: [u], "noise": [rng.normal(size=len(u))], "supply": [7.4 + 0.01 * rng.normal(size=len(u))]}
    found = guess(written(tmp_path, names, goal, *middle[more], y))
    assert not found.unclear
    assert [found.mapping.input[0].column, found.mapping.output[0].column] == ["goal [deg]", "angle [deg]"]


def test_columns_that_do_not_show_what_follows_the_set_point_are_asked_for(tmp_path):
    """A set point that never changes, and an output by its name that may be the controller's."""
    _, u, y = loop()
    goal = np.where(np.arange(len(u)) < 600, 40.0, 41.0)
    with pytest.raises(InputError, match="'setpoint', 'output' and 'measurement' may be a controller's"):
        sysid.read(written(tmp_path, "setpoint,output,measurement", goal, u, y))


def test_two_columns_that_follow_the_set_point_alike_leave_it_open(tmp_path):
    """One is the profile that the servo goes along."""
    goal, u, y = loop()
    rng = np.random.default_rng(2)
    path = written(tmp_path, "goal,u,y,profile", goal, u, y, y + 0.05 * rng.normal(size=len(y)))
    with pytest.raises(InputError, match="columns 'goal', 'u' may each be the input"):
        sysid.read(path)


def test_a_set_point_that_nothing_comes_near_leaves_it_open(tmp_path):
    """What moves by a fifth of it need not be the answer, also where it is the closest by far."""
    goal, u, _ = loop()
    u, y = 0.01 * u, 20.0 + 0.2 * (goal - 20.0)
    with pytest.raises(InputError, match="'setpoint', 'output' and 'measurement' may be a controller's"):
        sysid.read(written(tmp_path, "setpoint,output,measurement", goal, u, y))


def test_the_closest_column_is_the_answer_and_not_the_quietest(tmp_path):
    """What a proportional controller gives out may lie near the set point too, and vary less than the answer."""
    goal, _, _ = loop()
    rng = np.random.default_rng(3)
    y, u = goal + rng.normal(size=len(goal)), 16.0 + 0.6 * goal + 2.0 * rng.normal(size=len(goal))
    found = guess(written(tmp_path, "setpoint,output,measurement", goal, u, y)).mapping
    assert [found.input[0].column, found.output[0].column] == ["output", "measurement"]


def test_a_second_place_that_jumps_with_the_goal_is_no_input(tmp_path):
    goal, u, y = loop()
    with pytest.raises(InputError, match="columns 'angle', 'position' may each be the output"):
        sysid.read(written(tmp_path, "goal,angle,position", goal, y, u))


def test_the_answer_is_in_the_unit_of_the_set_point(tmp_path):
    """What the heater gets may come closer to it in numbers."""
    goal, _, _ = loop()
    rng = np.random.default_rng(4)
    u, y = (goal + size * rng.normal(size=len(goal)) for size in (0.1, 5.0))
    found = guess(written(tmp_path, "setpoint [degC],heater [%],temperature [degC]", goal, u, y)).mapping
    assert [found.input[0].column, found.output[0].column] == ["heater [%]", "temperature [degC]"]
