"""Each imperfection: its level measured, and gone when it is switched off."""

import mujoco
import numpy as np
import pytest
from rig import IDEAL_BRIDGE, QUIET, VOLTS, record, shown

from twin import JOINTS, Experiment, Parameters, truth
from twin.hardware.linkage import end_angles, linkage, middle, stroke
from twin.hardware.potentiometer import potentiometer
from twin.plant.board import circuit
from twin.plant.leg import bench
from twin.plant.stepping import step

P = Parameters()
CROSSING = {"shoulder": 4.0, "thigh": 16.0, "shank": 16.0}  # [s] that surely take a joint at 6 V from end to end


@pytest.mark.parametrize("joint", JOINTS)
def test_a_held_leg_does_not_creep(joint: str) -> None:
    angle = np.rad2deg(record(joint, np.zeros(610), start=0.0))
    # Under 0.01 deg in a minute, power off; the first second lets the link settle in its play.
    assert np.ptp(angle[10:]) < 0.01


def test_the_creep_bound_can_fail() -> None:
    model = bench("thigh")
    model.tendon_solimp_fri[:], model.tendon_solref_fri[:] = (0.9, 0.95, 0.001, 0.5, 2), (0.02, 1)  # MuJoCo's defaults
    run = Experiment("thigh").prepare(model, u=np.zeros((610, 1)), start={"thigh": 0.0})
    angle = step([run], 0.1, 0.5)[0, :, 0, 0]
    assert np.rad2deg(np.ptp(angle[10:])) > 0.1


@pytest.mark.parametrize("joint", ["thigh", "shank"])
def test_without_friction_gravity_moves_the_leg(joint: str) -> None:
    loose = record(joint, np.zeros(50), without=("friction",), start=0.0)
    assert np.rad2deg(np.ptp(loose)) > 0.1  # back-EMF alone slows it; with friction it stays within 0.01 deg
    weightless = record(joint, np.zeros(50), without=("friction", "gravity"), start=0.0)
    assert np.rad2deg(np.ptp(weightless)) < 1e-6


@pytest.mark.parametrize("joint", JOINTS)
def test_the_switch_of_friction_takes_all_of_it(joint: str) -> None:
    left = circuit(P, joint, ("friction",))
    assert [left.friction.static(way, 1e3) for way in (-1, 1)] == [0.0, 0.0]
    assert (left.viscous, left.own["LOAD_FRICTION"]) == (0.0, 0.0)
    model = bench(joint, without=("friction",))
    for field in (model.dof_frictionloss, model.tendon_frictionloss, model.dof_damping, model.tendon_damping):
        assert not np.any(field)


@pytest.mark.parametrize("joint", JOINTS)
def test_play_is_as_wide_as_its_parameter(joint: str) -> None:
    model = bench(joint, without=("gravity",))
    data = mujoco.MjData(model)
    data.qpos[0] = middle(P, joint)
    ends = []
    for torque in (0.5, -0.5):  # [N m] on the link, of the size of its weight; friction holds the drive side
        data.qfrc_applied[1] = torque
        mujoco.mj_step(model, data, 1500)
        ends.append(data.qpos[1])
    assert ends[0] - ends[1] == pytest.approx(truth(joint).backlash, rel=0.02)


def test_lost_motion_at_a_reversal_is_the_play() -> None:
    # No gravity on the shoulder's axis: the link stays, held by its bearing, while the gear crosses the play.
    model = bench("shoulder")
    data = mujoco.MjData(model)
    for volts in (2.2, 0.0):  # slowly, so that the link does not coast on through the play
        data.ctrl[0] = volts
        mujoco.mj_step(model, data, 3000)
    link, gear = data.qpos.sum(), data.qpos[0]
    data.ctrl[0] = -2.2
    while abs(data.qpos.sum() - link) < 1e-5:
        mujoco.mj_step(model, data)
    # 5 %: the link coasts by a little as the gear stops, and the gear goes on while the link gets going.
    assert gear - data.qpos[0] == pytest.approx(P["shoulder.backlash"], rel=0.05)


@pytest.mark.parametrize("joint", JOINTS)
@pytest.mark.parametrize("volts", [12.0, 6.0])
def test_travel_ends_where_the_pins_say(joint: str, volts: float) -> None:
    there = np.full(round(CROSSING[joint] / 0.1), volts)
    angle = record(joint, np.concatenate([there, -2 * np.sign(there) * volts / 2, -there]), without=("backlash",))
    n = len(there)
    lo, hi = truth(joint).end_angles
    # The switch trips a margin before the stop, and a slow approach rests in between.
    margin = P[f"{joint}.switch_margin"]
    arms = (1.0, 1.0) if joint == "shoulder" else [linkage(P, joint).arm(q) for q in (lo, hi)]
    for rest, end, arm in zip((angle[-1], angle[n - 1]), (lo, hi), arms, strict=True):
        assert abs(rest - end) < margin / arm + np.deg2rad(0.01)


@pytest.mark.parametrize("joint", JOINTS)
def test_ends_lie_where_full_voltage_leaves_the_drive(joint: str) -> None:
    """Limit switches far before the stop: the drive coasts on by its speed, and seldom as far as the stop."""
    for mm in (1.0, 3.0):
        margin = 1e-3 * mm if joint != "shoulder" else np.deg2rad(mm)
        p = Parameters({f"{joint}.switch_margin": margin})
        there = np.full(round(CROSSING[joint] / 0.1), 12.0)
        angle = record(joint, np.concatenate([there, -there]), without=("backlash",), parameters=p)
        known = truth(joint, 0.1, p)
        # The board looks once in 10 ms, so two arrivals at full speed differ by as much as the drive moves in it.
        tick = known.gain * 12.0 * p["switch_period"]
        for rest, end, switch, hard in zip(
            (angle[-1], angle[len(there) - 1]), known.end_angles, known.switch_angles, end_angles(p, joint), strict=True
        ):
            assert abs(rest - end) < tick + np.deg2rad(0.02)
            assert abs(switch - hard) > np.deg2rad(0.3 * mm)
            assert min(switch, hard) - 1e-3 <= end <= max(switch, hard) + 1e-3


@pytest.mark.parametrize("joint", JOINTS)
def test_play_lets_the_link_pass_the_end_by_half_its_width(joint: str) -> None:
    y = Experiment(joint=joint, duration=40.0, without=(*QUIET, "nonlinearity")).run().y
    lo, hi = truth(joint).end_angles
    slack = truth(joint).backlash / 2 + np.deg2rad(0.05)  # the play, and the 0.05 deg of the test above
    assert lo - slack < y.min() < lo + slack
    assert hi - slack < y.max() < hi + slack


@pytest.mark.parametrize("joint", JOINTS)
def test_limit_switch_cuts_the_motor_outward_only(joint: str) -> None:
    end = end_angles(P, joint)[1]
    for without, outward in (((), 0.0), (("end_stops",), 12.0)):
        rows = shown(joint, np.repeat([12.0, -12.0], 5), (*without, *IDEAL_BRIDGE), start=end, Ts=0.1)
        np.testing.assert_array_equal(rows[:5, VOLTS], outward)
        np.testing.assert_array_equal(rows[5:, VOLTS], -12.0)
        assert rows[-1, 0] < rows[5, 0]  # inward the motor runs


def test_supply_limits_the_voltage() -> None:
    rows = shown("shank", np.array([-30.0, -3.0, 0.0, 3.0, 30.0, 0.0]), IDEAL_BRIDGE, Ts=0.02)
    assert rows[:, VOLTS].tolist() == [-12, -3, 0, 3, 12, 0]


@pytest.mark.parametrize("joint", JOINTS)
@pytest.mark.parametrize("direction", [-1, 1])
def test_breakaway_voltage(joint: str, direction: int) -> None:
    rate, step = 0.05, np.deg2rad(0.1)  # a ramp [V/s], and the motion [rad] of the link that counts as started
    u = direction * np.arange(0, 6, rate * 0.1)
    moved = np.abs(record(joint, u) - record(joint, u[:1])[0])
    started = u[np.argmax(moved > step)]
    known = truth(joint)
    lag = np.sqrt(2 * step * rate / known.gain)  # speed grows as gain rate t, so `step` takes this many volts more
    # 3 %: the link gets going against its own inertia and, on the shoulder, after a knock through the play.
    assert started - direction * lag == pytest.approx(known.breakaway_voltage[(direction + 1) // 2], rel=0.03)


def test_below_breakaway_nothing_moves() -> None:
    down, up = truth("shank").breakaway_voltage
    for volts in (0.97 * down, 0.97 * up):
        assert np.rad2deg(np.ptp(record("shank", np.full(100, volts), ("backlash",))[10:])) < 0.01


def test_noise_has_the_parameters_level() -> None:
    log = Experiment(without=("adc", "dropouts")).run()
    assert log.y_true is not None
    error = log.y - log.y_true
    # 6 %: four standard errors of a deviation from 2,500 samples.
    assert error.std() == pytest.approx(P["pot_noise"], rel=0.06)
    assert abs(error.mean()) < 4 * P["pot_noise"] / np.sqrt(log.N)
    assert abs(np.corrcoef(error[1:], error[:-1])[0, 1]) < 4 / np.sqrt(log.N)  # white


def test_adc_rounds_to_its_step() -> None:
    log = Experiment(without=("noise", "dropouts")).run()
    assert log.y_true is not None
    step = P["pot_range"] / 1024
    codes = log.y / step
    np.testing.assert_allclose(codes, np.round(codes), atol=1e-9)
    assert np.abs(log.y - log.y_true).max() <= step / 2 + 1e-12
    assert np.unique(np.round(codes)).size > 100  # of 227 in 60 deg; the sweep passes them in strides


def test_adc_ends_at_its_codes() -> None:
    rng = np.random.default_rng(0)
    reading = potentiometer(P, without=("noise",)).read(np.array([-10.0, 10.0]), rng)
    assert reading / (P["pot_range"] / 1024) == pytest.approx([-512, 511])


def test_noise_and_adc_off_leave_the_true_angle() -> None:
    log = Experiment(duration=20.0, without=("noise", "adc", "dropouts")).run()
    np.testing.assert_array_equal(log.y, log.y_true)


def test_gravity_helps_down_and_hinders_up() -> None:
    def seconds(without: tuple[str, ...]) -> list[int]:
        angle = record("thigh", np.repeat([-12.0, 12.0, -12.0], 100), without=without)
        return [int(np.sum(np.abs(np.diff(leg)) > np.deg2rad(0.1))) for leg in (angle[100:200], angle[200:])]

    down, up = seconds(())
    assert up > 1.15 * down
    level_down, level_up = seconds(("gravity",))
    assert level_up == pytest.approx(level_down, abs=1)  # samples: the way there is the way back


def test_without_end_stops_the_actuator_leaves_its_stroke() -> None:
    angle = record("shoulder", np.full(30, 12.0), without=("end_stops",))
    assert angle[-1] > 1.5 * stroke(P, "shoulder")[1]
