"""Joints of a robot that are not calibrated: held where the log says they stand, or where nothing moves them."""

import numpy as np
import pytest
from robots import HIP, KNEE, PENDULUM, TRUTH, chirp, record, write_table

from sysid.base.errors import InputError
from twin.mjcf import calibration, logs, robot

TS = 0.004


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """The folder of robot.xml."""
    made = tmp_path_factory.mktemp("robot")
    (made / "robot.xml").write_text(PENDULUM)
    return made


@pytest.mark.parametrize("told", [True, False])
def test_a_joint_without_a_log_is_held_where_a_column_says(told, folder, tmp_path):
    """The knee is bent by one radian, which turns the weight at the hip; without its column the bias takes that up."""
    rng, t, bent = np.random.default_rng(8), np.arange(1500) * TS, 1.0
    u = np.column_stack([chirp(t)])
    text = PENDULUM.replace('<joint name="knee" axis="0 1 0"/>', "").replace(
        '<body pos="0 0 -.3">', f'<body pos="0 0 -.3" euler="0 {np.degrees(bent)} 0">'
    )
    text = text.replace('<position name="knee_servo" joint="knee" kp="20" kv="0.4"/>', "")
    y = record(text, TRUTH, (HIP,), u, TS, 1e-3, rng)
    head = f"time [s],command [rad],hip angle [rad]{',knee_servo angle [deg]' if told else ''}"
    columns = [t, u[:, 0], y[:, 0], *([np.full(1500, np.degrees(bent))] if told else [])]
    np.savetxt(tmp_path / "log.csv", np.column_stack(columns), delimiter=",", comments="", header=head)
    rig = robot.read(folder / "robot.xml", (HIP,))
    log = logs.read(str(tmp_path / "log.csv"), rig, "command [rad]", "hip angle [rad]")
    result = calibration.calibrate(rig, [log])
    assert rig.held == ("knee",)
    assert (abs(result[f"{HIP}.bias"].value - TRUTH[f"{HIP}.bias"]) < 0.005) == told
    assert result.remarks[0].startswith(
        f"log.csv: joints of actuators that are not named were held: knee at {'57.3 deg' if told else '0 deg *'}"
    )


def test_a_joint_that_is_logged_may_be_held_by_its_command(folder, tmp_path):
    rng, t = np.random.default_rng(8), np.arange(1000) * TS
    u = np.column_stack([chirp(t), np.full(1000, 0.4)])
    write_table(tmp_path / "log.csv", (HIP, KNEE), u, record(PENDULUM, TRUTH, (HIP, KNEE), u, TS, 1e-3, rng), TS)
    rig = robot.read(folder / "robot.xml", (HIP, KNEE))
    assert (
        logs.read(
            str(tmp_path / "log.csv"),
            rig,
            f"{HIP} command [rad],{KNEE} command [rad]",
            f"{HIP} angle [deg],{KNEE} angle [deg]",
        )
        .u[:, 1]
        .tolist()
        == [0.4] * 1000
    )
    u[:, 0] = 0.1
    write_table(tmp_path / "still.csv", (HIP, KNEE), u, u, TS)
    with pytest.raises(InputError, match="no command changes; give a log in which a joint is moved"):
        logs.read(
            str(tmp_path / "still.csv"),
            rig,
            f"{HIP} command [rad],{KNEE} command [rad]",
            f"{HIP} angle [deg],{KNEE} angle [deg]",
        )


def test_a_held_joint_that_moves_is_to_be_named(folder, tmp_path):
    t = np.arange(100) * TS
    rows = np.column_stack([t, np.sin(t), np.sin(t), np.sin(20.0 * t)])
    np.savetxt(tmp_path / "log.csv", rows, delimiter=",", comments="", header="time [s],u [rad],y [rad],knee [rad]")
    with pytest.raises(InputError, match=r"the joint 'knee' moves by .* deg .* name its actuator with --actuator too"):
        logs.read(str(tmp_path / "log.csv"), robot.read(folder / "robot.xml", (HIP,)), "u [rad]", "y [rad]")


def test_a_free_base_is_held_and_units_are_looked_at(folder, tmp_path):
    path = tmp_path / "free.xml"
    path.write_text(
        PENDULUM.replace('<body pos="0 0 1">', '<body name="base"><freejoint/><geom size=".1"/><body>', 1).replace(
            "</body>\n  </worldbody>", "</body></body>\n  </worldbody>"
        )
    )
    rig = robot.read(path, (KNEE,))
    assert rig.model.nq == 2
    assert "held in the air" in rig.notes[0]
    log = tmp_path / "log.csv"
    rows = np.column_stack([np.arange(50) * TS, np.sin(np.arange(50)), np.sin(np.arange(50))])
    np.savetxt(log, rows, delimiter=",", comments="", header="time [s],command [V],angle [deg]")
    with pytest.raises(InputError, match=r"the input 'command .V.' is in V, and actuator 'knee_servo' needs rad"):
        logs.read(str(log), rig)
