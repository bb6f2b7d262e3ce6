"""A user's MJCF on a test stand: which joint each actuator moves, and a base that is held in the air."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import mujoco
import numpy as np

from sysid.base.checks import checked
from sysid.base.errors import InputError, unknown
from sysid.base.files import check_regular_file

LIFT = 100.0  # [m], by which a base that is held is raised, so that nothing touches the floor; gravity is the same
ROCK = 1e9  # [kg m^2, kg] no force of a robot moves it noticeably within a log
MOVES = {int(mujoco.mjtJoint.mjJNT_HINGE): "rad", int(mujoco.mjtJoint.mjJNT_SLIDE): "m"}
FILTERS = (int(mujoco.mjtDyn.mjDYN_FILTER), int(mujoco.mjtDyn.mjDYN_FILTEREXACT))


@dataclass(frozen=True)
class Drive:
    """An actuator and the joint that it moves, with their places in MuJoCo's arrays; `unit` is rad or m.

    `act` is the place of the state of a filtered command, -1 without one. `servo`: the force is kp (command - length)
    less kv times the velocity. `tree` is the kinematic tree: without contact, drives of different trees move alone.
    """

    name: str
    joint: str
    index: int
    ctrl: int
    act: int
    qpos: int
    dof: int
    unit: str
    servo: bool
    tree: int


@dataclass(frozen=True)
class Robot:
    """A model that MuJoCo has compiled from its `stand`, the drives to calibrate, and the `spec` as the file has it.

    `held` are the joints beside the drives that other actuators hold: the model gives them the inertia of a rock.
    """

    path: Path
    spec: mujoco.MjSpec
    model: mujoco.MjModel
    drives: tuple[Drive, ...]
    notes: tuple[str, ...]
    stand: mujoco.MjSpec
    held: tuple[str, ...] = ()

    @property
    def postures(self) -> dict[str, tuple[int, str]]:
        """Place in qpos and unit of each held joint of the model."""
        joints = [self.model.joint(k) for k in range(self.model.njnt)]
        return {j.name: (int(j.qposadr[0]), MOVES[int(j.type[0])]) for j in joints if j.name in self.held}

    @property
    def coupled(self) -> bool:
        """Whether tendons or equality constraints may connect trees of bodies."""
        return bool(self.model.neq or self.model.ntendon)


@checked(late=True)
def read(path: str | Path, names: Sequence[str]) -> Robot:
    """The MJCF at `path` with the actuators `names`; a free base is held where the file places it, in the air.

    Raises InputError for a file that is missing or that MuJoCo does not load, for an unknown actuator (all are listed),
    and for one that does not move a single hinge or slide.
    """
    path = Path(path)
    check_regular_file(path)
    if not path.is_file():
        raise InputError(f"{path} is no file; give the MJCF of your robot with --model")
    try:
        spec = mujoco.MjSpec.from_file(str(path))
        stand, notes = _on_stand(spec)
        model = stand.compile()
    except (ValueError, OSError, mujoco.FatalError) as error:
        first = next(iter(str(error).strip().splitlines()), type(error).__name__)
        raise InputError(f"{path}: MuJoCo does not load it ({first}); give the MJCF file of your robot") from None
    if not names:
        raise InputError(f"no actuator is named; give --actuator {','.join(_names(model)) or 'NAME'}, or some of these")
    drives = drives_of(path, model, names)
    held = _held(model, drives)
    for name in held:
        stand.joint(name).armature = ROCK
    return Robot(path, spec, stand.compile() if held else model, drives, notes, stand, held)


def drives_of(path: Path, model: mujoco.MjModel, names: Sequence[str]) -> tuple[Drive, ...]:
    """The drives of actuators `names` of the model from the file at `path`; raises InputError as `read` does."""
    drives = tuple(_drive(path, model, name) for name in names)
    for name in ("actuator", "joint"):
        chosen = [getattr(drive, "name" if name == "actuator" else "joint") for drive in drives]
        twice = next((each for each in chosen if chosen.count(each) > 1), None)
        if twice is not None:
            raise InputError(f"{path}: the {name} {twice!r} is named twice by --actuator; name one actuator a joint")
    return drives


def _held(model: mujoco.MjModel, drives: Sequence[Drive]) -> tuple[str, ...]:
    """Joints of the trees of the drives that an actuator without a log moves; passive joints are free."""
    trees, joints = {drive.tree for drive in drives}, {drive.joint for drive in drives}
    out = []
    for kind, (k, _) in zip(model.actuator_trntype, model.actuator_trnid, strict=True):
        joint_kinds = (mujoco.mjtTrn.mjTRN_JOINT, mujoco.mjtTrn.mjTRN_JOINTINPARENT)
        if mujoco.mjtTrn(int(kind)) not in joint_kinds or int(model.jnt_type[k]) not in MOVES:
            continue
        name, tree = model.joint(int(k)).name, int(model.dof_treeid[model.jnt_dofadr[k]])
        if name and name not in joints and tree in trees:
            out.append(name)
    return tuple(dict.fromkeys(out))


def _on_stand(spec: mujoco.MjSpec) -> tuple[mujoco.MjSpec, tuple[str, ...]]:
    """A copy whose free bodies are held in the air, and what was done; keyframes go, since they have other sizes."""
    stand = spec.copy()
    for key in list(stand.keys):
        stand.delete(key)
    joints = [joint for joint in stand.joints if joint.type == mujoco.mjtJoint.mjJNT_FREE]
    if not joints:
        return stand, ()
    names = [joint.parent.name or "without a name" for joint in joints]
    for joint in joints:
        joint.parent.pos = joint.parent.pos + np.array([0.0, 0.0, LIFT])
        stand.delete(joint)
    return stand, (f"The base (body {', '.join(names)}) is held in the air, as on a test stand.",)


def _names(model: mujoco.MjModel) -> list[str]:
    return [name for k in range(len(model.actuator_trntype)) if (name := model.actuator(k).name)]


def _drive(path: Path, model: mujoco.MjModel, name: str) -> Drive:
    names = _names(model)
    if name not in names:
        if not names:
            raise InputError(f"{path}: no actuator has a name; give each <actuator> element a name")
        raise InputError(f"{path}: {unknown('actuator', name, names)}")
    index = model.actuator(name).id
    kind = mujoco.mjtTrn(int(model.actuator_trntype[index]))
    joint = int(model.actuator_trnid[index, 0])
    if kind not in (mujoco.mjtTrn.mjTRN_JOINT, mujoco.mjtTrn.mjTRN_JOINTINPARENT):
        raise InputError(
            f"{path}: actuator {name!r} drives a {kind.name.removeprefix('mjTRN_').lower()}, and one of a hinge "
            "or a slide is needed; name another, or give it a joint"
        )
    if int(model.jnt_type[joint]) not in MOVES:
        raise InputError(
            f"{path}: actuator {name!r} drives the joint {model.joint(joint).name!r}, which is neither a hinge nor a "
            "slide; name another"
        )
    if model.actuator_ctrlnum[index] != 1:
        raise InputError(
            f"{path}: actuator {name!r} takes {model.actuator_ctrlnum[index]} commands, and one is needed; name another"
        )
    dof = int(model.jnt_dofadr[joint])
    filtered = int(model.actuator_dyntype[index]) in FILTERS
    gain, bias = model.actuator_gainprm[index], model.actuator_biasprm[index]
    affine = model.actuator_biastype[index] == mujoco.mjtBias.mjBIAS_AFFINE
    return Drive(
        name,
        model.joint(joint).name or f"joint {joint}",
        index,
        int(model.actuator_ctrladr[index]),
        int(model.actuator_actadr[index]) if filtered else -1,
        int(model.jnt_qposadr[joint]),
        dof,
        MOVES[int(model.jnt_type[joint])],
        bool(affine and gain[0] > 0.0 and np.isclose(bias[1], -gain[0])),
        int(model.dof_treeid[dof]),
    )
