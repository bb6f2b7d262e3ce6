"""A servo on a stand that swings a point mass: the leg's geared motor and board with a pendulum in place of the leg."""

from collections.abc import Collection

import mujoco
import numpy as np

from sysid.base.errors import InputError
from twin.hardware.motor import motor
from twin.parameters import Parameters
from twin.plant.board import add_sensor
from twin.plant.leg import BENCH_LEG, LEAST

JOINT = "shoulder"  # whose rows describe the servo: motor, gear, friction and gains at the joint
NAME = JOINT + BENCH_LEG
# As in the MJCF of the leg: MuJoCo's default friction lets a loaded joint creep.
STIFF = {"solimp_friction": [0.9999, 0.9999, 0.001, 0.5, 2], "solref_friction": [0.002, 1]}


def pendulum(parameters: Parameters, mass: float, length: float, without: Collection[str] = ()) -> mujoco.MjModel:
    """A hinge with `mass` [kg] at `length` [m], hanging at angle 0, driven by the motor of `JOINT`.

    It has no backlash and no end stops. Raises InputError for a mass or length that is not positive.
    """
    if not (0.0 < mass < np.inf and 0.0 < length < np.inf):
        raise InputError(f"the pendulum has {mass} kg at {length} m; give a positive mass and length")
    values, constants = parameters.switched_off(without), motor(parameters, JOINT)
    spec = mujoco.MjSpec()
    spec.option.timestep = 0.001
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    spec.option.tolerance = 1e-12
    spec.option.disableflags |= mujoco.mjtDisableBit.mjDSBL_ISLAND  # the board writes into the solver's friction rows
    spec.option.gravity[2] = -values["gravity"]
    # A point mass has no inertia of its own, which MuJoCo does not take: a ball of a gram's inertia does no harm.
    body = spec.worldbody.add_body(
        name="pendulum", mass=mass, ipos=[0, 0, -length], inertia=[1e-9] * 3, explicitinertial=True
    )
    hinge = body.add_joint(name=NAME, type=mujoco.mjtJoint.mjJNT_HINGE, axis=[0, 1, 0])
    hinge.solimp_friction, hinge.solref_friction = STIFF["solimp_friction"], STIFF["solref_friction"]
    hinge.frictionloss = max(values[f"{JOINT}.coulomb"], LEAST)
    hinge.damping[0] = values[f"{JOINT}.viscous"]
    hinge.limited = mujoco.mjtLimited.mjLIMITED_FALSE
    actuator = spec.add_actuator(name=NAME, target=NAME, trntype=mujoco.mjtTrn.mjTRN_JOINT)
    actuator.set_to_dcmotor(motorconst=[constants.constant] * 2, resistance=constants.resistance)
    actuator.gear[0], actuator.armature = constants.gear, constants.inertia
    add_sensor(spec)
    return spec.compile()
