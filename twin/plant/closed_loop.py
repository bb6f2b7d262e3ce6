"""The linear actuator as bodies: cylinder and rod in a closed kinematic loop in place of the spatial tendon."""

import mujoco
import numpy as np

from twin.hardware.linkage import linkage, stroke
from twin.hardware.motor import motor
from twin.parameters import Parameters

# MuJoCo's default solref, 0.02 1, opens the loop by a millimetre and more under load; 0.004 1 with the default solimp
# still by 0.2 mm, which is 0.2 degrees at the thigh.
CONNECT = {"solref": [0.002, 1], "solimp": [0.999, 0.9999, 0.0001, 0.5, 2]}
# A tendon has no mass: the bodies get little of it, and no weight. The pins' inertia is in the lever already.
LIGHT = {"mass": 0.002, "inertia": [2e-6] * 3, "explicitinertial": True, "gravcomp": 1.0}


def close_loop(spec: mujoco.MjSpec, p: Parameters, joint: str, suffix: str) -> None:
    """Replace the tendon of `joint` (thigh or shank) by a cylinder on the base pin and a rod that slides in it.

    Hinge {joint}_cylinder and slide {joint}_rod join them; `connect` ties the rod to its pin. Motor, friction and ends
    of stroke move from the tendon to the slide, whose zero is the pins' distance at joint angle 0.
    """
    base, pin = spec.site(f"{joint}_base{suffix}"), spec.site(f"{joint}_rod{suffix}")
    tendon, constants = spec.tendon(joint + suffix), motor(p, joint)
    start = np.array(pin.pos) + np.array(pin.parent.pos) - np.array(base.pos)  # base pin to rod pin at joint angle 0
    start[1] = 0.0
    length = float(np.linalg.norm(start))
    cylinder = base.parent.add_body(name=f"{joint}_cylinder{suffix}", pos=base.pos, **LIGHT)
    cylinder.add_joint(name=f"{joint}_cylinder{suffix}", type=mujoco.mjtJoint.mjJNT_HINGE, axis=[0, 1, 0])
    rod = cylinder.add_body(name=f"{joint}_rod{suffix}", pos=start, **LIGHT)
    slide = rod.add_joint(name=f"{joint}_rod{suffix}", type=mujoco.mjtJoint.mjJNT_SLIDE, axis=start / length)
    slide.range, slide.limited = np.array(stroke(p, joint)) - length, tendon.limited
    slide.solimp_limit, slide.solref_limit = tendon.solimp_limit, tendon.solref_limit
    slide.solimp_friction, slide.solref_friction = tendon.solimp_friction, tendon.solref_friction
    slide.frictionloss, slide.damping[0] = tendon.frictionloss, tendon.damping[0]
    kind = {"type": mujoco.mjtEq.mjEQ_CONNECT, "objtype": mujoco.mjtObj.mjOBJ_BODY}
    spec.add_equality(name1=rod.name, name2=pin.parent.name, **kind, **CONNECT)
    old = spec.actuator(joint + suffix)
    old.trntype, old.target = mujoco.mjtTrn.mjTRN_JOINT, slide.name
    old.set_to_dcmotor(motorconst=[constants.constant] * 2, resistance=constants.resistance)
    spec.delete(tendon)


def assembled(p: Parameters, joint: str, angle: float) -> tuple[float, float]:
    """Cylinder hinge [rad] and rod slide [m] at joint `angle` [rad]."""
    triangle = linkage(p, joint)
    base = p[f"{joint}.base_radius"] * np.exp(1j * p[f"{joint}.base_angle"])

    def reach(q: float) -> complex:
        # Angles are up positive and joints turn downwards: the rod pin stands at rod_angle - q.
        return p[f"{joint}.rod_radius"] * np.exp(1j * (p[f"{joint}.rod_angle"] - q)) - base

    turned = -np.angle(reach(angle) / reach(0.0))
    return float(turned), triangle.length(angle) - triangle.length(0.0)
