"""Short records of a servo's drive and angle: a filter of many parameters repeats such a loop, and a motor made it."""

import sys
from pathlib import Path

import numpy as np
import pytest
from often import often

from sysid.data.record import IOData
from sysid.joint.posterior import fit_joint
from sysid.joint.verdict import verdict

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "scripts"))
sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "scripts" / "studies"))
from servo_joints import drawn, goals, simulated


def log(seed: int) -> IOData:
    """Volts and angle of a drawn servo for 5 s, simulated apart from the library; the volts follow the angle."""
    rng = np.random.default_rng([77, seed])
    joint = drawn(rng)
    goal = goals(rng, round(5.0 / joint.Ts), joint.Ts)
    y = simulated(joint, goal)
    y += joint.noise * rng.normal(size=len(y))
    duty = np.clip(joint.kp * (goal - y) - joint.kd * np.gradient(y, joint.Ts), -1.0, 1.0)
    return IOData(7.4 * duty, y, joint.Ts, "drive", "angle", "V", "rad")


@pytest.mark.nightly
def test_short_logs_of_a_servo_are_joints_or_undetermined() -> None:
    """Of four, two are joints and one is undetermined; on one a Hammerstein-Wiener model is as good in every way."""
    said = [verdict(fit_joint(data), data) for data in map(log, often(4, 1))]
    assert sum(one.joint for one in said) >= len(said) / 2
    assert sum(one.joint or one.undetermined for one in said) >= 3 * len(said) / 4
    for one in said:
        if one.undetermined:
            assert one.sentence().startswith("This record does not show whether it is that of an actuated joint")
            assert "no physical value is given" in one.sentence()
