"""Servo mode: the position loop on the potentiometer, its poles, its errors, and all three joints at once."""

import numpy as np
import pytest
from rig import ANGLE, IDEAL_BRIDGE, QUIET, READING, VOLTS, record, shown

from twin import IMPERFECTIONS, JOINTS, Experiment, Parameters, truth
from twin.experiment import respond
from twin.hardware.actuator import drive, motor
from twin.hardware.linkage import end_angles, middle
from twin.hardware.potentiometer import potentiometer
from twin.truth import LINEAR

P = Parameters()
SCALE = potentiometer(P).scale
GAINS = {"p": {}, "pi": {"servo_ki": 400.0}, "pid": {"servo_ki": 300.0, "servo_kd": 5.0}}


def smooth(joint: str, gains: dict[str, float]) -> Parameters:
    """Parameters without Coulomb friction, with servo gains."""
    dry = {f"{joint}.coulomb": 0.0, f"{joint}.bearing_coulomb": 0.0}
    return P.replace(dry | {f"{joint}.{name}": value for name, value in gains.items()})


@pytest.mark.parametrize("joint", JOINTS)
@pytest.mark.parametrize("gains", GAINS.values(), ids=GAINS)
def test_loop_poles_agree_with_the_closed_form(joint: str, gains: dict[str, float]) -> None:
    known = truth(joint, 0.01, smooth(joint, gains), "servo")
    assert len(known.poles) == 2 + len(gains)
    # 1e-3 of each pole in s; finite differences see the moment arm change a little.
    np.testing.assert_allclose(known.poles_s, known.closed_form_poles_s, rtol=1e-3)
    assert known.gain == pytest.approx(1 / SCALE)


@pytest.mark.parametrize("joint", JOINTS)
@pytest.mark.parametrize("gains", GAINS.values(), ids=GAINS)
def test_a_small_step_of_the_reference_shows_the_loop_poles(joint: str, gains: dict[str, float]) -> None:
    p, Ts, jump = smooth(joint, gains), 0.01, 1e-4
    hold = SCALE * middle(p, joint)
    experiment = Experiment(joint, Ts=Ts, parameters=p, without=LINEAR, mode="servo")
    y = respond(experiment, np.full((80, 1), hold + jump))[:, 0, READING]
    error = (hold + jump) / SCALE - y[1:]
    # The error is a sum of the loop's modes: a linear recursion that the record must obey, its roots the poles.
    n = len(truth(joint, Ts, p, "servo").poles)
    rows = np.column_stack([error[n - k - 1 : len(error) - k - 1] for k in range(n)])
    coefficients = np.linalg.lstsq(rows / np.abs(rows).max(), error[n:] / np.abs(rows).max(), rcond=None)[0]
    found = np.sort_complex(np.roots([1.0, *-coefficients]).astype(complex))[::-1]
    expected = truth(joint, Ts, p, "servo").poles
    # 2e-3 in z: the arm moves by 1e-4 on the way. A mode that is gone within one sample cannot be seen in the record.
    seen = np.abs(expected) > 0.1
    np.testing.assert_allclose(found[seen], expected[seen], atol=2e-3)


@pytest.mark.parametrize("joint", JOINTS)
def test_what_friction_leaves_of_the_error(joint: str) -> None:
    lo, hi = end_angles(P, joint)
    goals = np.repeat(np.array([0.3, 0.7, 0.4, 0.6]), 60) * (hi - lo) + lo
    rows = shown(joint, SCALE * goals, ("backlash",), mode="servo", Ts=0.1)
    rest = rows[59::60]
    # At rest the loop asks for less than what breaks away: load changes with the angle, so the largest of the table's.
    asked = np.abs(goals[59::60] - rest[:, READING]) * SCALE * P[f"{joint}.servo_kp"]
    assert asked.max() < 1.3 * max(np.abs(truth(joint).breakaway_voltage))
    assert np.abs(goals[59::60] - rest[:, ANGLE]).max() < np.deg2rad(3.5)
    assert np.ptp(rest[:, ANGLE]) > 0.35 * (hi - lo)  # it did go there


@pytest.mark.parametrize("joint", JOINTS)
def test_the_integral_does_not_grow_while_the_supply_limits_the_voltage(joint: str) -> None:
    """A joint waits at its end for a goal beyond it. However long, it turns back at once, and in the same way."""
    p = P.replace({f"{joint}.servo_ki": 400.0})
    lo, hi = end_angles(p, joint)
    ways = []
    for wait in (100, 250):
        goals = np.concatenate([np.full(wait, hi + 1.0), np.full(40, 0.5 * (lo + hi))])
        ways.append(shown(joint, SCALE * goals, mode="servo", Ts=0.1, parameters=p)[wait:])
    for way in ways:
        assert way[1, VOLTS] < -0.9 * 12.0  # one sample later; the supply sags a little
        assert way[5, READING] < way[0, READING] - np.deg2rad(2.0)
    # 0.01 deg: at its end a joint rests, and creeps by less than this.
    np.testing.assert_allclose(ways[0][:, READING], ways[1][:, READING], atol=np.deg2rad(0.01))


def test_the_loop_sees_its_own_noise_and_repeats_it() -> None:
    def volts(seed: int, without: tuple[str, ...] = ("adc",)) -> np.ndarray:
        experiment = Experiment("shoulder", Ts=0.01, seed=seed, without=without, mode="servo")
        return respond(experiment, np.zeros((500, 1)))[:, 0, VOLTS]

    np.testing.assert_array_equal(volts(1), volts(1))
    assert np.abs(volts(1) - volts(2)).max() > 0.1
    assert np.ptp(volts(1, ("adc", "noise"))) < 1e-9
    # Below the dead band nothing leaves the bridge; what does must come from noise of this size.
    amplitude = P["shoulder.servo_kp"] * SCALE * P["pot_noise"]
    assert 0.2 * amplitude < volts(1).std() < 1.1 * amplitude


def test_noise_in_the_loop_is_standard_normal_and_white() -> None:
    # A joint that cannot move, with every other part of the drive off, shows the noise as voltage.
    stuck = P.replace({"shoulder.coulomb": 20.0, "pot_noise": 0.01, "shoulder.servo_kp": 10.0})
    without = tuple(name for name in IMPERFECTIONS if name not in ("friction", "noise"))
    experiment = Experiment("shoulder", Ts=0.01, seed=3, parameters=stuck, without=without, mode="servo")
    z = respond(experiment, np.zeros((8000, 1)))[:, 0, VOLTS] / (-10.0 * SCALE * 0.01)
    n = len(z)
    assert abs(z.mean()) < 4 / np.sqrt(n)
    assert abs(z.var() - 1) < 4 * np.sqrt(2 / n)
    assert abs(np.mean(z**4) / 3 - 1) < 4 * np.sqrt(96 / n) / 3
    assert abs(np.corrcoef(z[1:], z[:-1])[0, 1]) < 4 / np.sqrt(n)


def test_a_joints_own_signals_do_not_depend_on_the_others() -> None:
    log = Experiment("leg", "aprbs", 20.0).run()
    assert log.u.shape == log.y.shape == (200, 3)
    assert np.abs(np.corrcoef(log.u.T) - np.eye(3)).max() < 0.6  # three draws, not one
    same = Experiment("leg", "aprbs", 20.0, without=("noise", "friction")).run()
    np.testing.assert_array_equal(log.u, same.u)


def test_joints_share_the_supply() -> None:
    quiet = (*QUIET, *(name for name in IDEAL_BRIDGE if name != "sag"), "end_stops")
    experiment = Experiment("leg", without=quiet, Ts=0.1)
    alone, together = (respond(experiment, np.tile(u, (3, 1)))[0, :, VOLTS] for u in ([12.0, 0, 0], [12.0, 12, 12]))
    parts = [P["supply_resistance"] / motor(P, joint).resistance for joint in JOINTS]
    # All motors stand still at the first sample: each draws V / Ra.
    assert alone[0] == pytest.approx(12 / (1 + parts[0]), rel=1e-6)
    assert together == pytest.approx([12 / (1 + sum(parts))] * 3, rel=1e-6)


def test_the_leg_moves_a_joint_as_the_single_bench_does() -> None:
    u = np.zeros((60, 3))
    u[:, 2] = np.repeat([12.0, -12.0], 30)
    leg = respond(Experiment("leg", without=(*QUIET, "gravity", *IDEAL_BRIDGE)), u)[:, 2, ANGLE]
    alone = record("shank", u[:, 2], ("gravity", *IDEAL_BRIDGE))
    # 0.2 deg: on the single bench the thigh has neither play nor give.
    assert np.rad2deg(np.abs(leg - alone)).max() < 0.2
    assert np.rad2deg(np.ptp(alone)) > 20


def test_drive_command_is_the_inverse_of_the_sagging_supply() -> None:
    bridge = drive(P, "thigh")
    resistance = motor(P, "thigh").resistance
    for volts in (-8.0, 0.0, 0.5, 11.0):
        duty = (bridge.command(volts, resistance) - np.sign(volts) * bridge.dead_band) / bridge.supply
        bus = bridge.supply / (1 + duty**2 * bridge.resistance / resistance)
        assert duty * bus == pytest.approx(volts, abs=1e-12)
    with pytest.raises(ValueError, match="cannot put"):
        bridge.command(100.0, resistance)
