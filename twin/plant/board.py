"""The user data of a model for the motor board that `kernels` runs, made from circuits."""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass

import mujoco
import numpy as np

from twin.hardware.actuator import Drive, DryFriction, Motor, drive, dry_friction, motor
from twin.hardware.potentiometer import Potentiometer, potentiometer
from twin.imperfections import TABLE as IMPERFECTIONS
from twin.imperfections import slot_value
from twin.parameters import Parameters
from twin.plant import slots

SENSOR = "board"
LOAD_LAG = 0.005  # [s] over which the axial load is averaged before friction follows it
TENDON_ROW = int(mujoco.mjtConstraint.mjCNSTR_FRICTION_TENDON)
JOINT_ROW = int(mujoco.mjtConstraint.mjCNSTR_FRICTION_DOF)


@dataclass(frozen=True)
class Circuit:
    """One actuated joint on the board. `viscous` is the friction of the drive; the others name elements of the model.

    `common` and `own` are the numbers of the imperfections for the whole board and for this joint, by slot.
    """

    motor: Motor
    drive: Drive
    friction: DryFriction
    viscous: float
    pot: Potentiometer
    common: Mapping[str, float]
    own: Mapping[str, float]


def circuit(parameters: Parameters, joint: str, without: Collection[str] = ()) -> Circuit:
    """The circuit of `joint` with the imperfections that are switched on."""
    p = parameters.switched_off(without)
    return Circuit(
        motor(parameters, joint),
        drive(parameters, joint, without),
        dry_friction(parameters, joint, without),
        p[f"{joint}.viscous"],
        potentiometer(parameters, without),
        {name: slot_value(slot, p, joint) for kind in IMPERFECTIONS.values() for name, slot in kind.board.items()},
        {name: slot_value(slot, p, joint) for kind in IMPERFECTIONS.values() for name, slot in kind.joint.items()},
    )


def add_sensor(spec: mujoco.MjSpec) -> None:
    """Add the user data and the sensor of a board for all actuators to a model."""
    joints = len(spec.actuators)
    spec.nuserdata = slots.HEAD + slots.WIDTH * joints
    spec.add_sensor(
        name=SENSOR,
        type=mujoco.mjtSensor.mjSENS_USER,
        datatype=mujoco.mjtDataType.mjDATATYPE_REAL,
        needstage=mujoco.mjtStage.mjSTAGE_ACC,
        dim=slots.COLUMNS * joints,
    )


def user_data(
    model: mujoco.MjModel, circuits: Sequence[Circuit], servo: bool = False, pot_on_link: bool = True, seed: int = 0
) -> np.ndarray:
    """User data (nuserdata,) of the board of `model` with `circuits`, one for each actuator; they share one supply.

    `seed` draws the measurement noise of the position loop in servo mode. With `pot_on_link` the potentiometers read
    the links, behind the backlash, else the drives.
    """
    assert len(circuits) == model.nu
    h, common = model.opt.timestep, circuits[0].drive
    out = np.zeros(model.nuserdata)
    for slot, value in {
        slots.MAGIC: slots.MAGIC_VALUE,
        slots.JOINTS: len(circuits),
        slots.STEP: h,
        slots.PERIOD: max(1, round(common.period / h)),
        slots.SUPPLY: common.supply,
        slots.SEED: seed % 2**53,
        slots.SENSOR: model.sensor(SENSOR).adr[0],
        slots.FILTER: h / (LOAD_LAG + h),
        slots.BUS: common.supply,
        **{slots.OF_BOARD[name]: value for name, value in circuits[0].common.items()},
    }.items():
        out[slot] = value
    for k, joint_circuit in enumerate(circuits):
        block = out[slots.HEAD + k * slots.WIDTH :]
        for slot, value in (_electrics(joint_circuit, servo) | _places(model, k, pot_on_link)).items():
            block[slot] = value
    return out


def _electrics(c: Circuit, servo: bool) -> dict[int, float]:
    """Numbers of motor, friction, drive and potentiometer by slot, and the states at the start."""
    return {
        slots.GEAR: c.motor.gear,
        slots.CONSTANT: c.motor.constant,
        slots.RESISTANCE: c.motor.resistance,
        slots.INERTIA: c.motor.reflected_inertia,
        slots.VISCOUS: c.viscous,
        slots.COULOMB_UP: c.friction.up,
        slots.COULOMB_DOWN: c.friction.down,
        slots.LOWER: c.drive.lower,
        slots.UPPER: c.drive.upper,
        slots.SERVO: float(servo),
        slots.KP: c.drive.kp,
        slots.KI: c.drive.ki,
        slots.KD: c.drive.kd,
        slots.POT_SCALE: c.pot.scale,
        slots.POT_STEP: c.pot.step,
        slots.POT_HALF: 0 if c.pot.bits is None else 2 ** (c.pot.bits - 1),
        slots.POT_NONLINEARITY: c.pot.nonlinearity,
        slots.POT_WAVE: c.pot.wave,
        slots.LAST: np.nan,
        slots.GIVEN: np.nan,
        **{slots.OF_JOINT[name]: value for name, value in c.own.items()},
    }


def _places(model: mujoco.MjModel, k: int, pot_on_link: bool) -> dict[int, float]:
    """Addresses of the joint, backlash and friction of actuator k in the model, by name: thigh_00, thigh_play_00."""
    name = model.actuator(k).name
    joint, suffix = name.rsplit("_", 1)
    target = int(model.actuator_trnid[k, 0])
    tendon = model.actuator_trntype[k] == mujoco.mjtTrn.mjTRN_TENDON
    slide = not tendon and model.jnt_type[target] == mujoco.mjtJoint.mjJNT_SLIDE
    plays = [model.joint(i).name for i in range(model.njnt)]
    play = f"{joint}_play_{suffix}"
    address = int(model.joint(play).qposadr[0]) if play in plays else -1
    return {
        slots.ROW_TYPE: TENDON_ROW if tendon else JOINT_ROW,
        slots.ROW_ID: target if tendon else int(model.jnt_dofadr[target]),
        slots.OFFSET: _pin_distance(model, joint, suffix) if slide else 0.0,
        slots.HINGE: int(model.joint(name).qposadr[0]),
        slots.PLAY: address,
        slots.POT_PLAY: address if pot_on_link else -1,
    }


def _pin_distance(model: mujoco.MjModel, joint: str, suffix: str) -> float:
    """Zero position [m] of the slide of a closed loop."""
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    base, rod = (data.site(f"{joint}_{pin}_{suffix}").xpos for pin in ("base", "rod"))
    return float(np.linalg.norm(rod - base))
