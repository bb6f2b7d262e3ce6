"""What a drive has beside its parameters, beside the same drive whose parameters, or whose input, say the same."""

import numpy as np
import pytest

from twin.compare.structures import STRUCTURES
from twin.experiment import SETTLE, Experiment
from twin.hardware.linkage import middle
from twin.parameters import JOINTS, Parameters
from twin.plant.added import DRAG, HOTTER, PUSH, RUB, WEAKER, grid
from twin.plant.board import circuit
from twin.plant.mechanics import course

P, SECONDS, DT = Parameters(), 12.0, 1e-3
PLAIN = ("pwm", "dead_band", "sag", "load_friction", "stribeck", "asymmetry")


def run(joint, table=None, p=P, scale=1.0, extra=0.0):
    u = Experiment(joint, "aprbs", SECONDS, 0.05, 3).commands()[:, 0]
    volts = np.repeat(scale * u + extra, 50)
    return course(p, joint, PLAIN, volts, middle(P, joint), SETTLE, added=table)


def table(joint, row, values):
    made = grid(P, joint, SECONDS)
    full = made.zeros()
    full[row] = values(made) if callable(values) else values
    return full


@pytest.mark.parametrize("joint", JOINTS)
def test_a_table_is_what_a_parameter_or_another_input_does(joint):
    """Degrees RMS between both, and of the change itself. The implicit step takes viscous friction at the new speed."""
    motor = circuit(P, joint, PLAIN).motor
    per_volt, row = motor.gear * motor.constant / motor.resistance, f"{joint}.coulomb"
    top = grid(P, joint, SECONDS).speed[-1]
    viscous = P.replace({f"{joint}.viscous": P[f"{joint}.viscous"] + 2.0 * per_volt / top})
    pairs = {
        "weaker": (table(joint, WEAKER, 0.2), {"scale": 0.8}),
        "rub": (table(joint, RUB, 0.4), {"p": P.replace({row: P[row] + 0.4 * per_volt})}),
        "drag": (table(joint, DRAG, lambda made: 2.0 * made.speed / top), {"p": viscous}),
        "nothing": (table(joint, HOTTER, 0.0), {}),
    }
    plain = run(joint)
    for name, (added, other) in pairs.items():
        one, two = run(joint, added), run(joint, **other)
        assert np.degrees(np.sqrt(np.mean((one - two) ** 2))) < 0.02, name
        assert name == "nothing" or np.degrees(np.sqrt(np.mean((one - plain) ** 2))) > 0.2, name


def test_a_push_is_a_voltage_and_the_resistance_leaves_the_speed_without_load():
    """The shoulder's axis is vertical: without friction a larger resistance changes only how fast it gets there."""
    moved = run("shoulder", table("shoulder", PUSH, 0.7))
    np.testing.assert_allclose(moved[1000:], run("shoulder", extra=0.7)[1000:], atol=np.radians(0.3))
    free = P.replace({"shoulder.coulomb": 0.0, "shoulder.viscous": 0.0, "shoulder.bearing_coulomb": 0.0})
    speeds = []
    for added in (None, table("shoulder", HOTTER, 1.0)):
        steady = course(free, "shoulder", PLAIN, np.full(1500, 2.0), 0.0, 0.0, added=added)
        speeds.append(np.gradient(steady, DT)[[150, 1000]])
    assert speeds[1][1] == pytest.approx(speeds[0][1], rel=0.02)
    assert speeds[1][0] < 0.9 * speeds[0][0]


def test_tables_follow_time_place_and_speed():
    made = grid(P, "thigh", SECONDS)
    heat = STRUCTURES["heat"].drive(made, {"heat_volts": 0.3, "heat_resistance": 0.6, "heat_time": 5.0})
    late = np.searchsorted(made.time, 5.0)
    np.testing.assert_allclose(heat[[WEAKER, HOTTER], late], (1 - np.exp(-1)) * np.array([0.3, 0.6]), rtol=0.01)
    rub = STRUCTURES["place"].drive(made, {"rub_size": 2.0, "rub_place": 0.25, "rub_width": 0.1})[RUB]
    assert made.angle[rub.argmax()] == pytest.approx(made.angle[0] + 0.25 * np.ptp(made.angle), abs=0.002)
    assert np.ptp(made.angle[rub > 2.0 / np.e]) == pytest.approx(0.2, abs=0.01)
    push = STRUCTURES["cogging"].drive(made, {"cogging_sine": 0.6, "cogging_cosine": 0.8, "cogging_turns": 20.0})[PUSH]
    np.testing.assert_allclose(push, np.cos(20.0 * made.angle - np.arctan2(0.6, 0.8)), atol=1e-9)
    drag = STRUCTURES["drag"].drive(made, {"drag_size": 3.0, "drag_power": 0.5})[DRAG]
    assert drag[len(drag) // 4] == pytest.approx(1.5, rel=0.01)
