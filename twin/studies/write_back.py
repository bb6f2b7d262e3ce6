"""A fitted model written back: as code, FMU, ONNX or a linear model, or as MJCF that is checked in MuJoCo."""

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from sysid.base.errors import InputError
from sysid.base.files import versions, write_text
from sysid.data.record import LARGEST, IOData
from sysid.estimation.free_run import FAR, beyond, quiet
from sysid.estimation.joint_parts import is_joint, motor_of
from sysid.estimation.result import Fit
from sysid.excitations.aprbs import Aprbs
from sysid.export import c, fmu, matlab, mjcf, modelica, onnx, python
from sysid.fitting import load
from sysid.joint.posterior import fit_joint
from sysid.linear import linearize
from sysid.linear.linearize import Tangent
from sysid.nlarx.result import NlarxFit
from sysid.workflow.record import read_record
from twin.fragment.into import put_into
from twin.fragment.rollout import Check, check

PARTS = ("stribeck", "plays")  # of a joint, those that MJCF has elements for
SHOWN_BY = {"stribeck": ".stick", "plays": ".width"}  # parameters
CLOSE = 0.005  # of the stroke: RMS up to which fragment and fit count as the same
LEAST = 50  # samples of a record on which a fragment is checked
TURNS = 40  # of a drawn input: crossings of the stroke, about


@dataclass(frozen=True)
class Source:
    """A fit, the record that MJCF is checked on, and where both come from.

    A drawn record is at absolute levels, as the exported files take it.
    """

    fit: Fit | NlarxFit
    data: IOData
    said: str
    recorded: bool = False
    trouble: str | None = None  # of its free run


@dataclass(frozen=True)
class WrittenModel:
    """What was written: file names with what they are, the fragment with its check, and the model it was put into."""

    source: Source
    files: tuple[tuple[str, str], ...]
    fragment: mjcf.Fragment | None = None
    check: Check | None = None
    into: str | None = None
    changes: tuple[str, ...] = ()
    torque_per_volt: float | None = None
    tangent: Tangent | None = None

    @property
    def close(self) -> bool:
        """Whether the fragment does what the fit does."""
        return self.check is None or self.check.share <= CLOSE

    def as_dict(self) -> dict[str, Any]:
        """The summary of `qpal export`, ready for JSON."""
        summary: dict[str, Any] = {"source": self.source.said, "files": [name for name, _ in self.files]}
        if self.fragment is not None and self.check is not None:
            summary |= {
                "mjcf": self.fragment.model(),
                "left_out": list(self.fragment.left_out),
                "difference_rms_percent_of_stroke": 100 * self.check.share,
                "difference_worst_percent_of_stroke": 100 * self.check.worst,
                "into": self.into,
                "changes": list(self.changes),
            }
        if self.tangent is not None:
            summary["tangent"] = self.tangent.as_dict()
        summary["warnings"] = [*([self.source.trouble] if self.source.trouble else []), *self.source.fit.warnings]
        return summary | {"offsets": _offsets(self.source.fit), "versions": versions()}


def _offsets(fit: Fit | NlarxFit) -> dict[str, list[float]] | None:
    """What the files take off the input and put on the output; None if the fit does not know."""
    if fit.u_offset is None or fit.y_offset is None:
        return None
    return {"u": fit.u_offset.tolist(), "y": fit.y_offset.tolist()}


def read_model(
    path: str,
    input: str | None = None,
    output: str | None = None,
    Ts: float | None = None,
    time: str | None = None,
    mapping: str | None = None,
    fitted: bool = True,
) -> Source:
    """The saved fit at `path` with a drawn input, or, if `fitted`, the joint of the log at `path`.

    A joint that is fitted here has only parts with MJCF elements. Raises InputError for a file that is neither.
    """
    try:
        fit = load(path)
    except InputError as error:
        if not fitted or not Path(path).exists():
            raise
        load_error = error
    else:
        data, run = _drive_record(fit)
        low, high = fit.y_span
        far = FAR * max(abs(low), abs(high)) or np.inf
        trouble = beyond(run, fit.remedy, "under a drawn input of the size of the fit's the free run", far)
        return Source(fit, data, f"the fit in {path}", trouble=trouble)
    try:
        data = read_record(path, input, output, Ts, time, mapping).data
    except InputError as error:
        if Path(path).suffix.lower() == ".json":
            raise InputError(f"{path} is neither a saved fit ({load_error}) nor a log ({error})") from None
        raise
    return Source(_exported_joint(data), data, f"a joint fitted to {path}", True)


def _exported_joint(data: IOData) -> Fit:
    """The joint with those of `PARTS` that the record shows: an element for what is not there is worse than none."""
    joint = fit_joint(data, parts=PARTS)
    shown = tuple(part for part in PARTS if any(SHOWN_BY[part] in name for name in joint.shown))
    return joint.fit if shown == PARTS else fit_joint(data, parts=shown).fit


def _drive_record(fit: Fit | NlarxFit) -> tuple[IOData, np.ndarray]:
    """A drawn input, which takes a joint across its stroke many times, with what is finite of the fit's free run.

    And that free run (N, ny) as it is, counted from the offsets.
    """
    was = fit.origin
    names = {} if was is None else {k: getattr(was, k) for k in ("u_name", "y_name", "u_unit", "y_unit")}
    if isinstance(fit, NlarxFit) or not is_joint(fit.model):
        low, high = fit.u_span if fit.u_span[1] > fit.u_span[0] else (-1.0, 1.0)
        n_in = 1 if isinstance(fit, NlarxFit) else fit.model.channels[0]
        u = np.repeat(np.random.default_rng(0).uniform(low, high, (12, n_in)), 20, axis=0)
        y = fit.simulate(u).reshape(len(u), -1)
        u0, y0 = (0.0 if offset is None else offset for offset in (fit.u_offset, fit.y_offset))
        return IOData(u + u0, np.where(np.abs(y) < LARGEST, y, 0.0) + y0, fit.Ts, **names), y
    motor = motor_of(fit.model)
    motor_values = fit.model.part(fit.theta, motor)
    value = {name: motor.value(motor_values, name) for name in ("gain", "rise", "fall", "stick", "lower", "upper")}
    stroke = value["upper"] - value["lower"]
    if not np.isfinite(stroke):  # a joint without stops, or with one
        stroke = 1.0
    crossing = 50  # samples
    reach = stroke / (crossing * value["gain"]) if value["gain"] > 0.0 else max(map(abs, fit.u_span))
    amplitude = max(value["rise"], value["fall"]) + value["stick"] + reach
    signal = Aprbs(amplitude, hold_min=0.2 * crossing * fit.Ts, hold_max=2 * crossing * fit.Ts)
    u = signal.generate(TURNS * crossing, fit.Ts, np.random.default_rng(0))
    with quiet():
        run = fit.model.simulate(fit.theta, u[:, None]).ravel()
    stay = len(u) if motor.stops is True else max(_stay(run, _span(fit)), 2)
    return IOData(u[:stay], run[:stay], fit.Ts, **names), run


def _span(fit: Fit) -> float:
    """The way of the joint in units of the output: what its map covers, or a motor's unit where there is no map."""
    values = dict(zip(fit.model.names, fit.theta, strict=True))
    return abs(values.get("map.high", 1.0) - values.get("map.low", 0.0))


def _stay(y: np.ndarray, span: float) -> int:
    """Samples before a joint that nothing stops has gone its whole way from where it began, or is lost."""
    beyond_span = ~(np.abs(y - y[0]) < span)
    return int(np.argmax(beyond_span)) if beyond_span.any() else len(y)


WAYS = ("c", "fmu", "python", "matlab", "onnx", "modelica", "control", "mjcf")
JOINT = "joint"  # the hinge of an MJCF that is given no name


def model_name(fit: Fit | NlarxFit) -> str:
    """A name for the functions of a model, from its structure."""
    name = re.sub(r"\W", "_", fit.model.structure, flags=re.ASCII)
    return name if name[0].isalpha() else f"model_{name}"


def _check_ways(source: Source, ways: Sequence[str], name: str | None, at: float | None) -> None:
    """Raises InputError, with the reason and with the ways that are possible, before any file is written."""
    reasons = {way: _refusal(source, way, name, at) for way in ways}
    if not any(reasons.values()):
        return
    reasons |= {way: _refusal(source, way, name, None) for way in WAYS if way not in reasons}
    sentence = "; ".join(f"--{way}: {reasons[way]}" for way in ways if reasons[way])
    fine = [f"--{way}" for way in WAYS if not reasons[way]]
    raise InputError(f"{sentence} (nothing is written; possible: {', '.join(fine)})" if fine else sentence)


def _refusal(source: Source, way: str, name: str | None, at: float | None) -> str:
    """Why the fit cannot be written in this way; empty if it can."""
    fit = source.fit
    try:
        if way == "control":
            linearize.tangent_at(fit, at)
        elif way == "mjcf":
            _check_mjcf(source, name or JOINT)
        elif way == "python":
            python.source(fit)
        elif way == "onnx":
            onnx.model(fit)
        else:
            {"matlab": matlab, "modelica": modelica}.get(way, c).source(fit, name or model_name(fit))
    except InputError as error:
        return str(error)
    return ""


def _check_mjcf(source: Source, name: str) -> None:
    """Raises InputError, with the reason, for a fit that MJCF has no elements for."""
    fit = source.fit
    if source.data.N < LEAST:
        raise InputError(
            "this joint has no stop that keeps a drawn input in its range; fit one to a log that meets both ends, or "
            "give the log itself: qpal export LOG --mjcf"
        )
    if isinstance(fit, NlarxFit):
        raise InputError("a nonlinear ARX model has no motor, so it has no MJCF; fit an actuated_joint")
    if is_joint(fit.model) and any(offset is not None and offset.any() for offset in (fit.u_offset, fit.y_offset)):
        raise InputError(
            "this joint was fitted to a record without its means, and MJCF counts from zero volts and the sensor's "
            "zero; fit it with --detrend none"
        )
    mjcf.fragment(fit, name, 1.0, 0.0)


def write_back(
    source: Source,
    ways: Sequence[str],
    name: str | None,
    torque_per_volt: float | None,
    link_inertia: float,
    into: Path | None,
    folder: Path,
    at: float | None = None,
    single: bool = False,
    fmi: str = fmu.VERSIONS[0],
) -> WrittenModel:
    """Write the fit to `folder` in each of `ways`, names of `WAYS`; see `sysid.export`.

    `name` is that of the joint in MJCF and of the functions and files, by default "joint" and the model's structure.
    `at` is the input of the linear model, see `sysid.linear.linearize`; `single` asks for C in single precision, `fmi`
    is the version of the FMU.
    """
    files = []
    scale = 1.0 if torque_per_volt is None else torque_per_volt
    fit = source.fit
    _check_ways(source, ways, name, at)
    joint, name = name or JOINT, name or model_name(fit)
    if "c" in ways:
        c.write(fit, folder / f"{name}.c", single)
        files.append((f"{name}.h", "C99: a state struct, a struct of parameters, and what works on them"))
        files.append((f"{name}.c", f"its functions, in {'single' if single else 'double'} precision"))
    if "fmu" in ways:
        unit = fmu.write(fit, folder / f"{name}.fmu", fmi)
        binary = f"with a binary for {unit.platform}" if unit.platform else "source only: there is no C compiler here"
        files.append((unit.path.name, f"FMI {fmi}, co-simulation and model exchange, {binary}"))
    if "python" in ways:
        files.append((python.write(fit, folder / f"{name}.py").name, "Python that imports only math"))
    if "matlab" in ways:
        files.append((matlab.write(fit, folder / f"{name}.m").name, "a MATLAB function, which GNU Octave runs too"))
    if "onnx" in ways:
        graph = onnx.write(fit, folder / f"{name}.onnx").name
        files.append((graph, "ONNX: u and the state in, y and the state out, over any number of samples"))
    if "modelica" in ways:
        files.append((modelica.write(fit, folder / f"{name}.mo").name, "a Modelica model that needs no library"))
    tangent = None
    if "control" in ways:
        tangent = linearize.tangent_at(fit, at)
        write_text(folder / f"{name}_control.py", linearize.tangent_source(tangent, fit.model.structure))
        files.append((f"{name}_control.py", "the linear model at an operating point, as a control.TransferFunction"))
    if "mjcf" not in ways:
        return WrittenModel(source, tuple(files), tangent=tangent)
    assert isinstance(fit, Fit)
    fragment = mjcf.fragment(fit, joint, scale, link_inertia)
    write_text(folder / f"{joint}.xml", fragment.model())
    files.append((f"{joint}.xml", "MJCF that loads as it is, with a light link in place of yours"))
    changes = tuple[str, ...]()
    if into is not None:
        model_path = folder / into.name if into.name != f"{joint}.xml" else folder / f"with-{into.name}"
        text, changes = put_into(fragment, into)
        write_text(model_path, text)
        files.append((model_path.name, f"{into.name} with the joint put in"))
    fragment_check = check(mjcf.fragment(fit, joint, scale), fit, source.data)
    place = None if into is None else str(into)
    return WrittenModel(source, tuple(files), fragment, fragment_check, place, changes, torque_per_volt, tangent)
