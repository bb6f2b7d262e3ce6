"""What a drive has beside its parameters, beside the same drive whose parameters, or whose input, say the same."""

import numpy as np
import pytest

from twin.compare.structures import STRUCTURES
from twin.experiment import SETTLE, Experiment
from twin.hardware.linkage import middle
from twin.parameters import JOINTS, Parameters
from twin.plant.added import DRAG, HOTTER, NOTHING, PUSH, RUB, WEAKER, Added, grid
from twin.plant.board import circuit
from twin.plant.mechanics import course

P, SECONDS, DT = Parameters(), 12.0, 1e-3
PLAIN = ("pwm", "dead_band", "sag", "load_friction", "stribeck", "asymmetry")


def run(joint, table=NOTHING, p=P, scale=1.0, extra=0.0):
    u = Experiment(joint, "aprbs", SECONDS, 0.05, 3).commands()[:, 0]
    volts = np.repeat(scale * u + extra, 50)
    return course(p, joint, PLAIN, volts, middle(P, joint), SETTLE, added=table)


def table(joint, row, values):
    made = grid(P, joint, SECONDS)
    full = made.zeros()
    full[row] = values(made) if callable(values) else values
    return Added(full, made.spans)


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
    for added in (NOTHING, table("shoulder", HOTTER, 1.0)):
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


def test_a_table_stays_where_it_is_when_an_end_moves():
    """The shoulder's swing meets neither end: one that moves outward changes nothing, nor where a push acts."""
    wavy = table("shoulder", PUSH, lambda made: np.sin(20.0 * made.angle))
    wider = P.replace({"shoulder.upper": P["shoulder.upper"] + 0.2})
    volts = np.repeat(np.tile([3.0, -3.0], 6), 500)
    courses = [course(p, "shoulder", PLAIN, volts, middle(P, "shoulder"), SETTLE, added=wavy) for p in (P, wider)]
    assert np.ptp(courses[0]) > 0.1
    assert courses[0].max() < P["shoulder.upper"] - 0.05
    np.testing.assert_allclose(courses[1], courses[0], atol=1e-9)


def test_a_push_is_a_force_also_where_the_resistance_has_grown():
    free = P.replace({"shoulder.coulomb": 0.0, "shoulder.viscous": 0.0, "shoulder.bearing_coulomb": 0.0})
    made = grid(P, "shoulder", SECONDS)
    first = []
    for hotter in (0.0, 1.0):
        full = made.zeros()
        full[PUSH], full[HOTTER] = 2.0, hotter
        still = course(free, "shoulder", (*PLAIN, "backlash"), np.zeros(300), 0.0, 0.0, added=Added(full, made.spans))
        first.append(float(np.gradient(still, DT)[5]))
    assert first[0] > 0.01
    assert first[1] == pytest.approx(first[0], rel=0.05)  # before speed, which brakes through the resistance


def test_time_counts_from_the_first_command():
    """A voltage that is lost from 3 s on is an input that ends then, less its delay; a rest goes before."""
    lost = table("shoulder", WEAKER, lambda made: (made.time > 3.0).astype(float))
    volts = np.repeat(np.tile([4.0, -4.0], 6), 1000)
    ends = np.where(np.arange(len(volts)) * DT < 3.0 - P["delay"], volts, 0.0)
    one = course(P, "shoulder", PLAIN, volts, 0.0, SETTLE, added=lost)
    two = course(P, "shoulder", PLAIN, ends, 0.0, SETTLE)
    assert np.degrees(np.abs(one - two).max()) < 0.5
    assert np.degrees(np.ptp(one)) > 5.0


def test_waves_in_the_speed_are_a_guess_of_the_cogging():
    """1.5 sin(20 y) V is added to a drive of 0.1 rad/s per V, which goes to and fro."""
    Ts, per_volt = 0.02, 0.1
    u = np.repeat(np.tile([6.0, -6.0], 5), 150)
    x, y = np.zeros(len(u)), np.zeros(len(u))
    for k in range(1, len(u)):
        x[k] = x[k - 1] + Ts * per_volt * u[k]
        y[k] = y[k - 1] + Ts * per_volt * (u[k] + 1.5 * np.sin(20.0 * y[k - 1]))
    noise = 1e-4 * np.random.default_rng(0).standard_normal(len(u))
    best = STRUCTURES["cogging"].guess(u, y + noise, x, Ts)[0]
    assert best["cogging_turns"] == pytest.approx(20.0, abs=0.5)
    assert np.hypot(best["cogging_sine"], best["cogging_cosine"]) == pytest.approx(1.5, rel=0.15)
