"""References for a proportional position loop: each includes the error that the loop needs to move its joint.

The motor boards have proportional gain only, so a joint moves when its error times the gain exceeds friction, load and
back-EMF. The planned values of these are added to the reference as feed-forward (Olsson et al., Friction models and
friction compensation, European Journal of Control 4, 1998, section 4). At rest nothing is added, and the actuators'
friction holds.
"""

import numpy as np

from twin.hardware.potentiometer import potentiometer
from twin.parameters import JOINTS, Parameters
from twin.plant.leg import LEGS, robot
from twin.robot.gait import Plan
from twin.robot.statics import Statics

STILL = 1e-5  # [m/s or rad/s] below this an actuator is at rest
KEPT = 0.2  # [s] for which the feed-forward continues after the plan is at rest, until the joint arrives


def shaped(plan: Plan, parameters: Parameters | None = None) -> np.ndarray:
    """References (N, 12) [rad] for robots with `parameters` to follow the plan's angles."""
    parameters = parameters or Parameters()
    model = robot(parameters)
    statics = Statics(model, parameters)
    speed = np.gradient(np.array([statics.travel(row) for row in plan.angles]), plan.Ts, axis=0)
    speed[np.abs(speed) < STILL] = 0.0
    loads = np.array([statics.loads(*row) for row in zip(plan.torso, plan.angles, plan.stance, strict=True)])
    limit = parameters["supply_voltage"]
    volts = np.clip(statics.volts(loads, speed), -limit, limit)
    scale = potentiometer(parameters).scale
    gains = np.tile([parameters[f"{joint}.servo_kp"] * scale for joint in JOINTS], len(LEGS))  # [V/rad]
    lead = np.divide(volts, gains, out=np.zeros_like(volts), where=gains > 0)
    return plan.angles + _kept(lead, round(KEPT / plan.Ts))


def _kept(lead: np.ndarray, samples: int) -> np.ndarray:
    """The feed-forward with each last value before zeros held for up to `samples` of them."""
    out = lead.copy()
    for _ in range(samples):
        late = np.roll(out, 1, axis=0)
        late[0] = 0.0
        # one sample further each time, never over the start of the next feed-forward
        out = np.where(out == 0.0, late, out)
    return out
