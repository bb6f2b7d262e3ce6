"""The compiled MuJoCo model of the leg bench or the whole free robot, from parameters and model/qpal.xml."""

from collections.abc import Collection, Mapping
from copy import copy
from functools import cache, lru_cache
from pathlib import Path

import mujoco
import numpy as np

from sysid.base.checks import checked
from sysid.base.errors import InputError, unknown
from twin.hardware.actuator import motor
from twin.hardware.linkage import end_angles, linkage, middle, stroke
from twin.imperfections import IMPERFECTIONS
from twin.parameters import JOINTS, LEG, REALISATIONS, Parameters
from twin.plant.board import Circuit, add_sensor, circuit

LEGS = {"front_left": "_00", "rear_left": "_10", "rear_right": "_01", "front_right": "_11"}
BENCH_LEG = LEGS["front_left"]
LEAST = 1e-9  # [N or N m]


def model_path() -> Path:
    """Path of the MJCF: inside an installed package, or beside it in a checkout."""
    package = Path(__file__).parents[1]
    for path in (package / "model" / "qpal.xml", package.parent / "model" / "qpal.xml"):
        if path.is_file():
            return path
    raise FileNotFoundError(
        f"qpal.xml is neither in {package / 'model'} nor in {package.parent / 'model'}; reinstall qpal"
    )


@checked(late=True)
def joints_of(joint: str) -> tuple[str, ...]:
    """The joints that `joint` names: itself, or all three for "leg". Raises InputError for another name."""
    if joint == LEG:
        return JOINTS
    return (check_joint(joint),)


@checked(late=True)
def check_joint(joint: str) -> str:
    """`joint`; raises InputError if the leg does not have it."""
    if joint not in JOINTS:
        raise unknown("joint", joint, (*JOINTS, LEG))
    return joint


@checked(late=True)
def check_switches(without: Collection[str]) -> tuple[str, ...]:
    """The switched-off imperfections in the order of `IMPERFECTIONS`; raises InputError for one that does not exist."""
    if isinstance(without, str):
        raise InputError(f"without is the string {without!r}; give a tuple of names, for example ({without!r},)")
    for name in without:
        if name not in IMPERFECTIONS:
            raise unknown("imperfection", name, IMPERFECTIONS)
    return tuple(name for name in IMPERFECTIONS if name in without)


@checked(late=True)
def robot(parameters: Parameters | None = None, without: Collection[str] = ()) -> mujoco.MjModel:
    """The free robot on the floor with 12 motors, one for each joint, in the order of `LEGS`."""
    spec = _spec(parameters or Parameters(), check_switches(without), tuple(LEGS.values()))
    add_sensor(spec)
    return spec.compile()


@checked(late=True)
def robot_circuits(parameters: Parameters) -> list[Circuit]:
    """The circuits of the whole robot in the order of its actuators; all four legs are equal."""
    return [circuit(parameters, joint) for joint in JOINTS] * len(LEGS)


@checked(late=True)
def bench(
    joint: str, parameters: Parameters | None = None, without: Collection[str] = (), realisation: str = "tendon"
) -> mujoco.MjModel:
    """The leg bench: torso held, the front left leg off the floor, `joint` free and the other two held rigidly.

    The held joints are fixed at mid stroke, without backlash or compliance. `joint` "leg" leaves all three free.
    Element names keep the leg's suffix `BENCH_LEG`: thigh_00, thigh_play_00, thigh_angle_00. `realisation`: the linear
    actuators are spatial tendons, or cylinder and rod in a closed kinematic loop.
    """
    rows = tuple((parameters or Parameters()).values.items())
    return copy(_compiled(joint, rows, check_switches(without), realisation))


@lru_cache(maxsize=32)  # 1.5 MB each
def _compiled(
    joint: str, rows: tuple[tuple[str, float], ...], without: tuple[str, ...], realisation: str
) -> mujoco.MjModel:
    """The compiled bench, of which callers get copies; `rows` are the parameters, which a cache can hold as a tuple."""
    return bench_spec(joint, Parameters(dict(rows)), without, realisation).compile()


@checked(late=True)
def bench_spec(
    joint: str, parameters: Parameters | None = None, without: Collection[str] = (), realisation: str = "tendon"
) -> mujoco.MjSpec:
    """The bench before compilation, to add elements to it."""
    free = joints_of(joint)
    if realisation not in REALISATIONS:
        raise unknown("realisation", realisation, REALISATIONS)
    parameters = parameters or Parameters()
    without = check_switches(without)
    spec = _spec(parameters, without, (BENCH_LEG,))
    spec.body("torso").pos[2] = parameters["bench_height"]
    spec.delete(spec.joint("float"))
    for name in JOINTS:
        if name not in free:
            _hold(spec, name, middle(parameters, name))
    for suffix in LEGS.values():
        if suffix != BENCH_LEG:
            spec.delete(spec.body(f"shoulder_hub{suffix}"))
    if realisation == "closed_loop":
        for name in free:
            if name != "shoulder":
                close_loop(spec, parameters, name, BENCH_LEG)
    add_sensor(spec)
    return spec


@cache
def _file() -> mujoco.MjSpec:
    """The MJCF as read; copy it before you change it."""
    return mujoco.MjSpec.from_file(str(model_path()))


def _spec(p: Parameters, without: tuple[str, ...], suffixes: tuple[str, ...]) -> mujoco.MjSpec:
    """The MJCF with the parameters in place of its nominal numbers, in the legs with `suffixes`."""
    spec, values = _file().copy(), p.switched_off(without)
    spec.option.gravity[2] = 0.0 - values["gravity"]
    if "contact" in without:
        spec.option.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONTACT
    spec.geom("torso").mass = p["torso_mass"]
    for suffix in suffixes:
        for geom, row in _MASSES.items():
            spec.geom(geom + suffix).mass = p[row]
        for joint in JOINTS:
            _motor(spec, p, joint, suffix)
            _friction(spec, values, joint, suffix, "load_friction" not in without and "friction" not in without)
            _ends(spec, p, joint, suffix, "end_stops" not in without)
            _backlash(spec, values[f"{joint}.backlash"], joint, suffix)
            if joint != "shoulder":
                _pins(spec, p, joint, suffix)
    return spec


_MASSES = {
    "shoulder_bracket": "shoulder_mass",
    "thigh": "thigh_mass",
    "shank": "shank_mass",
    "foot": "foot_mass",
    "thigh_actuator": "actuator_mass",
    "shank_actuator": "actuator_mass",
}


def _motor(spec: mujoco.MjSpec, p: Parameters, joint: str, suffix: str) -> None:
    constants = motor(p, joint)
    actuator = spec.actuator(joint + suffix)
    actuator.set_to_dcmotor(motorconst=[constants.constant] * 2, resistance=constants.resistance)
    actuator.gear[0] = constants.gear
    actuator.armature = constants.inertia


def _friction(spec: mujoco.MjSpec, p: Mapping[str, float], joint: str, suffix: str, loaded: bool) -> None:
    drive = spec.joint(joint + suffix) if joint == "shoulder" else spec.tendon(joint + suffix)
    angle = spec.tendon(f"{joint}_angle{suffix}")
    # Without any loss MuJoCo makes no friction row, and the board would have none to write the loaded friction into.
    drive.frictionloss = max(p[f"{joint}.coulomb"], LEAST if loaded else 0.0)
    angle.frictionloss = p[f"{joint}.bearing_coulomb"]
    for element, viscous in ((drive, "viscous"), (angle, "bearing_viscous")):
        element.damping[0] = p[f"{joint}.{viscous}"]


def _ends(spec: mujoco.MjSpec, p: Parameters, joint: str, suffix: str, on: bool) -> None:
    end_angles(p, joint)  # raises where the stroke does not fit the pins
    if joint == "shoulder":
        element, limits = spec.joint(joint + suffix), np.rad2deg(stroke(p, joint))  # the MJCF's compiler is in degrees
    else:
        element, limits = spec.tendon(joint + suffix), np.array(stroke(p, joint))
    element.range = limits
    element.limited = mujoco.mjtLimited.mjLIMITED_TRUE if on else mujoco.mjtLimited.mjLIMITED_FALSE


def _backlash(spec: mujoco.MjSpec, width: float, joint: str, suffix: str) -> None:
    """Set the range of the play hinge [rad], or weld the link to the drive without it."""
    play = spec.joint(f"{joint}_play{suffix}")
    if width > 0.0:
        play.range = np.rad2deg([-width / 2, width / 2])
        return
    # Without its play hinge the link is welded to the drive side, so the angle is the driven hinge alone.
    old = spec.tendon(f"{joint}_angle{suffix}")
    new = spec.add_tendon(name=f"{joint}_angle{suffix}_", frictionloss=old.frictionloss, damping=old.damping)
    new.solimp_friction, new.solref_friction = old.solimp_friction, old.solref_friction
    new.wrap_joint(joint + suffix, 1.0)
    spec.delete(old)
    new.name = f"{joint}_angle{suffix}"
    spec.delete(play)


def _pins(spec: mujoco.MjSpec, p: Parameters, joint: str, suffix: str) -> None:
    axis = spec.body(f"{joint}_lever{suffix}").pos  # in the frame that holds the base pin
    for pin, origin in (("base", axis), ("rod", np.zeros(3))):
        radius, angle = p[f"{joint}.{pin}_radius"], p[f"{joint}.{pin}_angle"]
        site = spec.site(f"{joint}_{pin}{suffix}")
        # y stays: the two actuators pass each other on the two sides of the thigh
        site.pos = np.array([origin[0] + radius * np.cos(angle), site.pos[1], origin[2] + radius * np.sin(angle)])


def _hold(spec: mujoco.MjSpec, joint: str, angle: float) -> None:
    """Fix a bench joint with its drive side at `angle` [rad]."""
    hinge = spec.joint(joint + BENCH_LEG)
    body = hinge.parent
    euler = body.alt.euler if body.alt.type == mujoco.mjtOrientation.mjORIENTATION_EULER else np.zeros(3)
    body.alt.type = mujoco.mjtOrientation.mjORIENTATION_EULER
    body.alt.euler = euler + np.rad2deg(angle) * hinge.axis
    spec.delete(spec.actuator(joint + BENCH_LEG))
    for find, names in ((spec.tendon, (joint, f"{joint}_angle")), (spec.joint, (joint, f"{joint}_play"))):
        for name in names:
            if (element := find(name + BENCH_LEG)) is not None:
                spec.delete(element)


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


def loop_positions(p: Parameters, joint: str, angle: float) -> tuple[float, float]:
    """Cylinder hinge [rad] and rod slide [m] at joint `angle` [rad]."""
    triangle = linkage(p, joint)
    base = p[f"{joint}.base_radius"] * np.exp(1j * p[f"{joint}.base_angle"])

    def reach(q: float) -> complex:
        # Angles are up positive and joints turn downwards: the rod pin stands at rod_angle - q.
        return p[f"{joint}.rod_radius"] * np.exp(1j * (p[f"{joint}.rod_angle"] - q)) - base

    rotation = -np.angle(reach(angle) / reach(0.0))
    return float(rotation), triangle.length(angle) - triangle.length(0.0)
