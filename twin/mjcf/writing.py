"""A calibrated robot as files: the MJCF with its values, what changed in it, and ranges for randomisation."""

import difflib
import json
import math
from pathlib import Path

import mujoco
import numpy as np

from sysid.base.errors import InputError
from sysid.base.files import write_text
from twin.mjcf.calibration import RobotCalibration
from twin.mjcf.robot import Robot

FIELDS = ("dof_armature", "dof_damping", "dof_frictionloss", "actuator_gainprm", "actuator_biasprm")


def patched(result: RobotCalibration) -> str:
    """The robot's MJCF with the calibrated values, as MuJoCo writes it, in one file; assets by their full paths.

    The joints get armature, damping and frictionloss, the actuators gains, `delay` with its history, and the encoder's
    offset as a constant force (it controls what the encoder reads). The offset of the reading and a backlash, which act
    on what is read, are <numeric> elements NAME_bias and NAME_backlash. What is not determined stays as it was. Raises
    InputError where the text does not load as the calibrated model.
    """
    spec, model = result.robot.spec.copy(), result.rig.model(result.numbers)
    values = result.numbers[None]
    names = {parameter.free.name for parameter in result.rig.parameters}
    delays = result.rig.of_kind("delay", values)[0]
    for k, drive in enumerate(result.robot.drives):
        joint, actuator = spec.joint(drive.joint), spec.actuator(drive.name)
        joint.armature, joint.frictionloss = model.dof_armature[drive.dof], model.dof_frictionloss[drive.dof]
        joint.damping[0] = model.dof_damping[drive.dof]
        actuator.gainprm, actuator.biasprm = model.actuator_gainprm[drive.index], model.actuator_biasprm[drive.index]
        if "delay" in names:
            actuator.delay, actuator.interp = delays[k], 1  # linear, as the mean over a step is
            actuator.nsample = math.ceil(delays[k] / model.opt.timestep) + 2 if delays[k] > 0.0 else 0
        for kind in ("bias", "backlash"):
            if f"{drive.name}.{kind}" in names:
                spec.add_numeric(name=f"{drive.name}_{kind}", data=[result.rig.of_kind(kind, values)[0, k]], size=1)
    text = _text(spec, result.robot)
    _check(text, result, model)
    return text


def difference(result: RobotCalibration, text: str) -> str:
    """What differs in the patched MJCF from the robot's own, both as MuJoCo writes them, as a unified diff."""
    name = result.robot.path.name
    old, new = (each.splitlines(keepends=True) for each in (_text(result.robot.spec.copy(), result.robot), text))
    return "".join(difflib.unified_diff(old, new, f"{name} (as it was)", f"{name} (calibrated)"))


def ranges(result: RobotCalibration) -> str:
    """Ranges for randomisation as TOML: mean, standard deviation and interval of each determined value, and covariance.

    One that is not determined has the model's value, and the interval that the logs leave.
    """
    name = result.robot.path.name
    lines = [
        f"# Calibrated parameters of {name}, for the randomisation of a simulation, in SI units.",
        "# Each is normal with mean and std; draw them together from the covariance (rows in the order of names).",
        f"# determined = false: the logs do not tell it, and value is that of {name}. From low to high is what was",
        "# plausible before and the logs do not rule out: an assumption, not a measurement.",
    ]
    for value, parameter in zip(result.values, result.parameters, strict=True):
        drive = None if parameter.drive is None else result.robot.drives[parameter.drive]
        lines += ["", "[[parameter]]", f"name = {json.dumps(value.name)}", f'kind = "{parameter.kind.name}"']
        if drive is not None:
            lines += [f"actuator = {json.dumps(drive.name)}", f"joint = {json.dumps(drive.joint)}"]
        numbers = {"mean": value.value, "std": value.std} if value.determined else {"value": value.value}
        numbers |= {"low": value.low, "high": value.high}
        lines += [f'unit = "{value.unit}"', *(f"{key} = {number!r}" for key, number in numbers.items())]
        lines.append(f"determined = {str(value.determined).lower()}")
    rows = ",\n".join(f"  [{', '.join(repr(float(v)) for v in row)}]" for row in result.covariance)
    first = "\n[joint]\nnames = " + json.dumps([value.name for value in result.determined])
    return "\n".join([*lines, first, f"covariance = [\n{rows},\n]"]) + "\n"


def file_name(robot: Robot) -> str:
    """Of the calibrated MJCF; another one than the robot's, which may stand in the same folder."""
    return f"{robot.path.stem}-calibrated.xml"


def write(result: RobotCalibration, folder: Path) -> list[str]:
    """Write ranges.toml, and the calibrated MJCF with its difference where the model may be used; the names written."""
    files = {"ranges.toml": ranges(result)}
    if result.usable:
        text = patched(result)
        files |= {file_name(result.robot): text, "changes.diff": difference(result, text)}
    for name, content in files.items():
        write_text(folder / name, content)
    return list(files)


def _text(spec: mujoco.MjSpec, robot: Robot) -> str:
    """The spec as MJCF that loads from any folder: its folders of assets are full paths."""
    folder = robot.path.resolve().parent
    spec.meshdir, spec.texturedir = (str(folder / part) for part in (spec.meshdir, spec.texturedir))
    spec.compile()
    return spec.to_xml()


def _check(text: str, result: RobotCalibration, calibrated: mujoco.MjModel) -> None:
    """Raises InputError where MuJoCo does not read the calibrated numbers from the text, to the digits of the text."""
    try:
        model = mujoco.MjModel.from_xml_string(text)
    except ValueError as error:
        raise InputError(
            f"{result.robot.path}: its calibrated form does not load ({str(error).splitlines()[0]}); set the values of "
            "ranges.toml by hand"
        ) from None
    for drive in result.robot.drives:
        joint, actuator = model.joint(drive.joint), model.actuator(drive.name)
        place = {"dof": int(joint.dofadr[0]), "actuator": actuator.id}
        source = {"dof": drive.dof, "actuator": drive.index}
        for name in FIELDS:
            kind = name.partition("_")[0]
            new, old = getattr(model, name)[place[kind]], getattr(calibrated, name)[source[kind]]
            if not np.allclose(new, old, rtol=1e-4, atol=1e-9):
                raise InputError(
                    f"{result.robot.path}: {name} of {drive.name} is {new} where {old} was calibrated; set the values "
                    "of ranges.toml by hand"
                )
