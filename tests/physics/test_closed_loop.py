"""The tendon leg against the same leg with its actuator as bodies: cylinder, rod and a closed kinematic loop."""

import mujoco
import numpy as np
import pytest

from twin import Parameters
from twin.geometry import stroke
from twin.leg import BENCH_LEG, bench, bench_spec
from twin.motor import motor

P = Parameters()
WITHOUT = ("backlash",)
# The loop's stiffness. solref 0.004 1 with MuJoCo's default solimp gapes by 0.2 mm under load: 0.2 deg at the thigh.
STIFF = {"solref": [0.004, 1], "solimp": [0.99, 0.999, 0.001, 0.5, 2]}
STIFFER = {"solref": [0.002, 1], "solimp": [0.999, 0.9999, 0.0001, 0.5, 2]}


def closed_loop(joint: str, connection: dict) -> mujoco.MjModel:
    """The bench of `joint` with a cylinder on the base pin, a rod that slides in it, and the rod tied to its pin."""
    spec = bench_spec(joint, without=WITHOUT)
    base, pin = spec.site(f"{joint}_base{BENCH_LEG}"), spec.site(f"{joint}_rod{BENCH_LEG}")
    tendon, constants = spec.tendon(joint + BENCH_LEG), motor(P, joint)
    start = np.array(pin.pos) + np.array(pin.parent.pos) - np.array(base.pos)  # base pin to rod pin at joint angle 0
    length = float(np.linalg.norm(start))
    # A tendon has no mass: the bodies get little of it, and no weight.
    light = {"mass": 0.05, "inertia": [1e-4] * 3, "explicitinertial": True, "gravcomp": 1.0}
    cylinder = base.parent.add_body(name="cylinder", pos=base.pos, **light)
    cylinder.add_joint(name="cylinder", type=mujoco.mjtJoint.mjJNT_HINGE, axis=[0, 1, 0])
    rod = cylinder.add_body(name="rod", pos=start, **light)
    slide = rod.add_joint(name="rod", type=mujoco.mjtJoint.mjJNT_SLIDE, axis=start / length)
    slide.range, slide.limited = np.array(stroke(P, joint)) - length, mujoco.mjtLimited.mjLIMITED_TRUE
    slide.solimp_limit, slide.solref_limit = tendon.solimp_limit, tendon.solref_limit
    slide.solimp_friction, slide.solref_friction = tendon.solimp_friction, tendon.solref_friction
    slide.frictionloss, slide.damping[0] = P[f"{joint}.coulomb"], P[f"{joint}.viscous"]
    kind = {"type": mujoco.mjtEq.mjEQ_CONNECT, "objtype": mujoco.mjtObj.mjOBJ_BODY}
    spec.add_equality(name1="rod", name2=pin.parent.name, **kind, **connection)
    spec.delete(spec.actuator(joint + BENCH_LEG))
    spec.delete(tendon)
    driver = spec.add_actuator(name=joint, target="rod", trntype=mujoco.mjtTrn.mjTRN_JOINT)
    driver.set_to_dcmotor(motorconst=[constants.constant] * 2, resistance=constants.resistance)
    driver.gear[0], driver.armature = constants.gear, constants.inertia
    return spec.compile()


def angle(model: mujoco.MjModel, joint: str) -> np.ndarray:
    """Joint angle [deg] every ms under random levels of a second each, from angle 0, where the loop is assembled."""
    data = mujoco.MjData(model)
    hinge = data.joint(joint + BENCH_LEG)
    record = []
    for volts in np.random.default_rng(5).uniform(-12, 12, 20).repeat(1000):
        data.ctrl[0] = volts
        mujoco.mj_step(model, data)
        record.append(float(hinge.qpos[0]))
    return np.rad2deg(record)


@pytest.mark.parametrize("joint", ["thigh", "shank"])
def test_the_tendon_leg_moves_as_the_closed_loop(joint: str) -> None:
    tendon = angle(bench(joint, without=WITHOUT), joint)
    assert np.ptp(tendon) > 30  # half of the travel takes part
    stiff, stiffer = (
        np.sqrt(np.mean((angle(closed_loop(joint, connection), joint) - tendon) ** 2))
        for connection in (STIFF, STIFFER)
    )
    assert stiff < 0.05
    assert stiffer < stiff / 2  # what is left is the loop's give, not another model
