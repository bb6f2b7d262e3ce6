"""A servo without friction is none of a filter where its drive comes to the limit; without that it is one."""

import numpy as np
import pytest

from sysid.data.record import IOData
from sysid.joint.posterior import fit_joint
from sysid.joint.values import joint_values
from sysid.joint.verdict import LIMITED, _limited, verdict
from sysid.structures import ServoJoint

TS, SPEED, LAG, DEAD = 0.01, 6.3, 0.04, 0.009  # s, rad/s at full drive, s, rad


def record(kp: float, size: float, step: float = 0.0) -> IOData:
    """A proportional loop about a motor with a lag, in steps of 1 ms; the angle read in steps of `step` [rad]."""
    rng = np.random.default_rng(3)
    goal = np.concatenate([np.full(rng.integers(30, 90), rng.uniform(-size, size)) for _ in range(20)])
    x = w = 0.0
    y = np.empty(len(goal))
    for k, r in enumerate(goal):
        y[k] = x
        for _ in range(10):
            e = np.sign(r - x) * max(abs(r - x) - DEAD, 0.0)
            w += 1e-3 / LAG * (SPEED * np.clip(kp * e, -1.0, 1.0) - w)
            x += 1e-3 * w
    y = np.round(y / step) * step if step else y + 2e-4 * rng.normal(size=len(y))
    return IOData(goal, y, TS, "goal", "angle", "rad", "rad")


def fitted(data: IOData):
    return fit_joint(data, ServoJoint(dead=DEAD).model_of(data), starts=2, parts=())


def test_a_servo_that_comes_to_its_limit_has_its_values_and_a_bound_of_its_friction():
    data = record(4.6, 1.0, step=0.005)
    found = fitted(data)
    assert verdict(found, data).joint
    values = {value.name: value for value in joint_values(found.fit, data=data, linearity=1.0)}
    for name, truth in (("speed_full_drive", SPEED), ("kp", 4.6)):
        assert values[name].determined
        assert values[name].value == pytest.approx(truth, rel=0.02)
    friction = [value for name, value in values.items() if name.startswith(("moving_friction", "coulomb"))]
    assert friction
    assert all(value.why.startswith("below ") and " duty" in value.why for value in friction)


def test_a_servo_that_keeps_below_its_limit_is_a_filter():
    data = record(4.6, 0.15)
    found = fitted(data)
    assert _limited(found.fit, data) < LIMITED
    said = verdict(found, data)
    assert not said.joint
    assert "no dry friction" in said.sentence() or "explains it as well" in said.sentence()
