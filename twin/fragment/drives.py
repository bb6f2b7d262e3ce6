"""What moves a joint of a MuJoCo model of the user's beside the identified motor: its actuators and tendons."""

import xml.etree.ElementTree as ET
from pathlib import Path

import mujoco
import numpy as np

from sysid.base.errors import InputError

# Transmissions with a length that joints change; a force at a site moves whatever carries it.
_DRIVES = {int(getattr(mujoco.mjtTrn, f"mjTRN_{name}")) for name in ("JOINT", "JOINTINPARENT", "TENDON", "SLIDERCRANK")}


def own_actuators(model: mujoco.MjModel, joint: str, source: Path) -> list[int]:
    """The actuators of the joint alone, which the identified motor replaces.

    Raises InputError for one that moves it together with other joints, through a tendon or a crank: the record of one
    joint does not tell what it does at the others.
    """
    moved = np.flatnonzero(_lengthened(model, joint, "actuator_length"))
    own = []
    for k in (int(k) for k in moved if model.actuator_trntype[k] in _DRIVES):
        others = _others(model, joint, k)
        if others:
            raise InputError(
                f"{source}: the actuator {model.actuator(k).name!r} moves {joint!r} together with {', '.join(others)}, "
                "and the identified motor moves it alone; take it out, or give each joint an actuator of its own"
            )
        own.append(k)
    return own


def forces_beside(model: mujoco.MjModel, joint: str) -> list[str]:
    """A sentence for each tendon that goes on acting on the joint with a force of its own."""
    said = []
    for k in np.flatnonzero(_lengthened(model, joint, "ten_length")):
        kinds = {"stiffness": model.tendon_stiffness, "damping": model.tendon_damping}
        kinds |= {"friction": model.tendon_frictionloss, "a limit": model.tendon_limited}
        forces = [name for name, values in kinds.items() if np.any(values[k])]
        if forces:
            said.append(
                f"tendon {model.tendon(k).name!r} stays and acts on {joint!r} with {' and '.join(forces)}, which the "
                "identified joint holds too if the tendon was there when the log was recorded"
            )
    return said


def take_out_actuators(
    root: ET.Element, model: mujoco.MjModel, joint: str, own: list[int], source: Path
) -> tuple[str, ET.Element, int]:
    """Remove the joint's `own` actuators; the name for its motor, its section and the place of the first of them.

    The name is that of a single one, so that sensors find it; the place is the end where there is none. Raises
    InputError where one of them is not found in this file.
    """
    names = [model.actuator(k).name for k in own]
    found = [
        (section, element)
        for section in root.findall("actuator")
        for element in section
        if joint in (element.get("joint"), element.get("jointinparent")) or (element.get("name") or None) in names
    ]
    if len(found) != len(own):
        raise InputError(
            f"{source}: {len(own)} actuators move {joint!r} and {len(found)} of them stand in this file by name or "
            "joint; name each of them, in this file"
        )
    first = [(section, list(section).index(element)) for section, element in found[:1]]
    for holder, element in found:
        holder.remove(element)
    if not first:
        section = root.find("actuator")
        section = ET.SubElement(root, "actuator") if section is None else section
        first = [(section, len(section))]
    return names[0] if len(names) == 1 and names[0] else joint, *first[0]


def _others(model: mujoco.MjModel, joint: str, actuator: int) -> list[str]:
    """The other hinges and slides that an actuator moves."""
    names = [model.joint(k).name for k in range(model.njnt) if model.jnt_type[k] >= int(mujoco.mjtJoint.mjJNT_SLIDE)]
    return [n for n in names if n != joint and _lengthened(model, n, "actuator_length")[actuator]]


def _lengthened(model: mujoco.MjModel, joint: str, which: str) -> np.ndarray:
    """Which of the lengths (n,) of actuators or tendons change when a joint turns a little; at a dead centre by more
    than rounding, too."""
    data, place, lengths = mujoco.MjData(model), model.joint(joint).qposadr[0], list[np.ndarray]()
    for step in (0.0, 1e-3):
        mujoco.mj_resetData(model, data)
        data.qpos[place] += step
        mujoco.mj_fwdPosition(model, data)
        lengths.append(getattr(data, which).copy())
    return np.asarray(np.abs(lengths[1] - lengths[0]) > 1e-9)
