"""The MJCF fragment of an identified joint, put into a model of the user's."""

import xml.etree.ElementTree as ET
from copy import deepcopy
from pathlib import Path

import mujoco
import numpy as np

from sysid.base.errors import InputError, unknown
from sysid.base.files import check_regular_file
from sysid.export.mjcf import Fragment
from twin.fragment.drives import forces_beside, own_actuators, take_out_actuators
from twin.fragment.tree_changes import Snapshot

# What the elements cannot do without.
NEEDED = sum(
    int(getattr(mujoco.mjtDisableBit, f"mjDSBL_{name}"))
    for name in ("CONSTRAINT", "EQUALITY", "FRICTIONLOSS", "LIMIT", "SPRING", "ACTUATION")
)
SECTIONS = ("tendon", "equality", "actuator")
ANGLES = ("range", "springref")  # attributes of a hinge that follow the model's unit of angle
# Attributes of the user's joint that describe the same things as the fragment's, and would count twice.
REPLACED = ("armature", "damping", "frictionloss", "stiffness", "springref", "range", "limited")


def put_into(fragment: Fragment, source: Path) -> tuple[str, tuple[str, ...]]:
    """The MJCF at `source` with the fragment in place of the properties of its hinge `fragment.joint`, as text.

    The joint keeps its name, place and axis. Its own friction, damping, spring, armature and range are replaced, and
    the motor takes the place of its actuators. Keyframes keep every angle; the new motor has 0 V. The second value has
    a sentence for each change, and for each tendon that goes on acting on the joint. Raises InputError for a file that
    MuJoCo does not load, before or after, for another kind of joint, and for one that other joints' actuators move too.
    """
    root = _parse(source)
    before, model = Snapshot(root), mujoco.MjModel.from_xml_path(str(source))
    body, hinge = _hinge(root, fragment.joint, source)
    place = {name: value for name, value in hinge.attrib.items() if name not in REPLACED}
    axis = {name: place.get(name, first) for name, first in (("axis", "0 0 1"), ("pos", "0 0 0"))}
    degrees, index = _in_degrees(root), list(body).index(hinge)
    body.remove(hinge)
    for k, text in enumerate(fragment.joints):
        new = _element(text)
        _to_unit(new, degrees)
        new.attrib = {**new.attrib, **(place if k == 0 else {}), **axis}
        body.insert(index + k, new)
    _refuse_constraints(root, fragment.joint, source)
    own = own_actuators(model, fragment.joint, source)
    _keep_keyframes(root, model, fragment, own)
    motor, actuators, at = take_out_actuators(root, model, fragment.joint, own, source)
    if fragment.rotor:
        _section(root, "worldbody").append(_element(fragment.rotor))
    for name in SECTIONS:
        if content := getattr(fragment, name):
            new = _element(content)
            if name == "actuator":
                new.set("name", motor)
                actuators.insert(at, new)
                continue
            if name == "equality":
                _from_zero(new, float(place.get("ref", 0.0)) * (np.pi / 180.0 if degrees else 1.0))
            _section(root, name).append(new)
    ET.indent(root)
    _check_unchanged(_check_loads(root, source), fragment, motor, source)
    return ET.tostring(root, encoding="unicode") + "\n", (*before.changes(root), *forces_beside(model, fragment.joint))


def _parse(source: Path) -> ET.Element:
    check_regular_file(source)
    try:
        mujoco.MjModel.from_xml_path(str(source))
        return _element(source.read_text(encoding="utf-8"))
    except (ValueError, OSError, ET.ParseError, UnicodeDecodeError) as error:
        first = str(error).strip().splitlines()[0] if str(error).strip() else type(error).__name__
        raise InputError(f"{source}: MuJoCo does not load it ({first}); give the MJCF file of your model") from None


def _refuse_constraints(root: ET.Element, joint: str, source: Path) -> None:
    for section in root.findall("equality"):
        for constraint in section:
            if joint in (constraint.get("joint1"), constraint.get("joint2")):
                raise InputError(
                    f"{source}: an equality constraint {constraint.get('name', '')!r} acts on {joint!r}, which the "
                    "identified joint replaces; take it out of the model first"
                )


def _keep_keyframes(root: ET.Element, model: mujoco.MjModel, fragment: Fragment, own: list[int]) -> None:
    """Keyframes of the model with zeros for the joints that the fragment adds, and 0 V for its motor.

    Its rotor hangs on the world, behind all other joints, and begins where the fragment does.
    """
    joint, added = model.joint(fragment.joint), ["0"] * (len(fragment.joints) - 1)
    rotor = _element(fragment.rotor).iter("joint") if fragment.rotor else ()
    begins = [f"{fragment.start.get(each.get('name', ''), 0.0):.9g}" for each in rotor]
    for key in root.findall("keyframe/key"):
        for name, at, size in (("qpos", joint.qposadr[0], model.nq), ("qvel", joint.dofadr[0], model.nv)):
            values = key.get(name, "").split()
            if len(values) == size:
                last = begins if name == "qpos" else ["0"] * len(begins)
                key.set(name, " ".join([*values[: at + 1], *added, *values[at + 1 :], *last]))
        values = key.get("ctrl", "").split()
        if len(values) == model.nu:
            first = own[0] if own else model.nu
            rest = [value for k, value in enumerate(values) if k not in own]
            key.set("ctrl", " ".join([*rest[:first], "0", *rest[first:]]))


def _from_zero(equality: ET.Element, ref: float) -> None:
    """MuJoCo couples changes from qpos0, which is `ref` [rad] at the user's joint; the fit's angle counts from 0."""
    first, *rest = equality.attrib["polycoef"].split()
    equality.set("polycoef", " ".join([f"{float(first) - ref:.9g}", *rest]))


def _check_unchanged(model: mujoco.MjModel, fragment: Fragment, motor: str, source: Path) -> None:
    """Raises InputError where defaults or options of the user's model change what the elements do."""
    fragment_model = mujoco.MjModel.from_xml_string(fragment.model())
    flags = model.opt.disableflags & ~fragment_model.opt.disableflags & NEEDED
    differences = ["flags of <option> switch off constraints, limits, springs, friction or actuation"] if flags else []
    for name in dict.fromkeys((*fragment.reading, *(name for name in fragment.start if name != fragment.joint))):
        reference, element = fragment_model.joint(name), model.joint(name)
        for attribute in (
            "range",
            "frictionloss",
            "damping",
            "armature",
            "stiffness",
            "limited",
            "actfrclimited",
            "margin",
        ):
            if hasattr(reference, attribute) and not np.allclose(
                getattr(reference, attribute), getattr(element, attribute), rtol=1e-6, atol=1e-9
            ):
                differences.append(f"{attribute} of joint {name}")
    reference, element = fragment_model.actuator(fragment.joint), model.actuator(motor)
    for attribute in ("gear", "ctrllimited", "forcelimited", "gainprm", "biasprm", "dynprm"):
        if not np.allclose(getattr(reference, attribute), getattr(element, attribute), rtol=1e-6, atol=1e-9):
            differences.append(f"{attribute} of the motor")
    if fragment.equality and not (
        model.eq_active0[-1] and np.allclose(model.eq_solref[-1], fragment_model.eq_solref[-1])
    ):
        differences.append("the coupling of motor and joint")
    if differences:
        raise InputError(
            f"{source}: its defaults or options would change {', '.join(differences)}; put its elements into a default "
            "class of their own"
        )


def _check_loads(root: ET.Element, source: Path) -> mujoco.MjModel:
    """The model; raises InputError if MuJoCo does not load it beside `source`, where its meshes and parts are."""
    copy, folder = deepcopy(root), source.resolve().parent
    if copy.find("compiler") is None:
        copy.insert(0, ET.Element("compiler"))
    for compiler in copy.iter("compiler"):
        for name in ("meshdir", "texturedir", "assetdir"):
            if name in compiler.attrib or name == "assetdir":
                compiler.set(name, str(folder / compiler.get(name, "")))
    for part in copy.iter("include"):
        part.set("file", str(folder / part.get("file", "")))
    try:
        return mujoco.MjModel.from_xml_string(ET.tostring(copy, encoding="unicode"))
    except ValueError as error:
        raise InputError(f"{source}: with the joint put in, MuJoCo says: {str(error).splitlines()[0]}") from None


def _hinge(root: ET.Element, joint: str, source: Path) -> tuple[ET.Element, ET.Element]:
    hinges = [(body, element) for body in root.iter("body") for element in body.findall("joint")]
    by_name = {element.get("name", ""): (body, element) for body, element in hinges}
    if joint not in by_name:
        raise InputError(f"{source}: {unknown('joint', joint, [name for name in by_name if name])}")
    body, hinge = by_name[joint]
    if hinge.get("type", "hinge") != "hinge":
        raise InputError(f"{source}: joint {joint!r} is a {hinge.get('type')}; give a hinge")
    return body, hinge


def _in_degrees(root: ET.Element) -> bool:
    return all(compiler.get("angle", "degree") == "degree" for compiler in root.iter("compiler"))


def _to_unit(hinge: ET.Element, degrees: bool) -> None:
    for name in ANGLES:
        if degrees and name in hinge.attrib:
            hinge.set(name, " ".join(f"{np.rad2deg(float(value)):.9g}" for value in hinge.attrib[name].split()))


def _section(root: ET.Element, name: str) -> ET.Element:
    section = root.find(name)
    return section if section is not None else ET.SubElement(root, name)


def _element(text: str) -> ET.Element:
    return ET.fromstring(text, ET.XMLParser(target=ET.TreeBuilder(insert_comments=True)))
