"""A servo's log in counts of its encoder gives the joint that the same log gives in radians."""

import sys
from pathlib import Path

import numpy as np
import pytest

from sysid.data.record import IOData
from sysid.data.wraps import turn_of
from sysid.structures import ServoJoint
from sysid.workflow.identification import identify_file
from sysid.workflow.setting import Setting

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "scripts"))
sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "scripts" / "studies"))

from servo_joints import drawn, record

COUNTS = 4096 / (2 * np.pi)  # a rad
CASES = Path(__file__).resolve().parents[1] / "contracts" / "cases"


@pytest.mark.nightly
@pytest.mark.parametrize("seed", range(8))
def test_counts_fit_as_well_as_radians(seed, tmp_path):
    rng = np.random.default_rng(seed)
    joint = drawn(rng)
    data, _ = record(joint, rng, 12.0)
    t, u, y = joint.Ts * np.arange(data.N), data.u[:, 0], data.y[:, 0]
    logs = {
        "t_s,goal_rad,angle_rad": (u, np.rint(y * COUNTS) / COUNTS),
        "t_s,goal,position": (np.rint(u * COUNTS + 2048), np.rint(y * COUNTS + 2048)),
    }
    percents, speeds = [], []
    for names, columns in logs.items():
        np.savetxt(tmp_path / "a.csv", np.column_stack([t, *columns]), "%.7g", ",", header=names, comments="")
        result = identify_file(tmp_path / "a.csv", Setting(ServoJoint(loop="pd" if joint.kd else "p")))
        percents.append(result.evaluation.validation_fit)
        speeds += [value.value for value in result.evaluation.values if value.name == "speed_full_drive"]
    assert any("a turn is taken as 4096" in note for note in result.record.notes)
    assert percents[1] == pytest.approx(percents[0], abs=0.1)
    assert speeds[1] / COUNTS == pytest.approx(speeds[0], rel=0.05)


def test_a_log_in_counts_fits_as_its_radians_do(tmp_path):
    """In radians the case has 99.88 % in validation; with a turn of 2 pi counts it had 97.2 %."""
    t, u, y = np.loadtxt(CASES / "servo.csv", delimiter=",", skiprows=1).T
    columns = [t, np.rint(u * COUNTS + 2048), np.rint(y * COUNTS + 2048)]
    np.savetxt(tmp_path / "a.csv", np.column_stack(columns), "%.7g", ",", header="t_s,goal,position", comments="")
    result = identify_file(tmp_path / "a.csv", Setting(ServoJoint()))
    assert result.evaluation.validation_fit > 99.8
    assert any("a turn is taken as 4096" in note for note in result.record.notes)


@pytest.mark.parametrize(
    ("unit", "y", "turn"),
    [
        ("rad", [0.0, 100.0], 2 * np.pi),
        ("deg", [0.0, 3.0], 360.0),
        ("", [-0.3, 1.2], 2 * np.pi),
        ("", [-31.5, 40.2], 360.0),
        ("", [0.0, 180.0], 360.0),
        ("", [1500.0, 2600.0], 4096.0),
        ("", [-574.0, 718.0], 4096.0),
    ],
)
def test_a_turn_without_a_unit_is_the_likeliest(unit, y, turn):
    assert turn_of(IOData(np.zeros(2), np.array(y), 0.1, y_unit=unit)) == turn
