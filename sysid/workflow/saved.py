"""A model as files, and a saved model with a record to run it on: same channels, same units, same sampling time."""

import shlex
from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import isfinite
from pathlib import Path

import numpy as np

from sysid.base.errors import InputError
from sysid.base.quantities import display_quantity, percent, unit_of_channel
from sysid.base.rates import drift_note, same_rate
from sysid.channels.column import label
from sysid.channels.mapping import Range
from sysid.channels.signals import Signals
from sysid.data.preprocess import DETREND, detrend, resample
from sysid.data.record import IOData
from sysid.data.table import Table
from sysid.diagnosis.residuals import poor
from sysid.estimation.free_run import beyond
from sysid.estimation.joint_parts import is_joint, motor_of
from sysid.estimation.result import Fit
from sysid.export import c as export_c
from sysid.export import python as export_python
from sysid.fitting import load, save
from sysid.formats import TABLE, read_table
from sysid.joint.course import output_falls
from sysid.nlarx.result import NlarxFit
from sysid.structures import TABLE as STRUCTURES
from sysid.workflow.record import Record, read_record, with_places, without_wraps
from sysid.workflow.remarks import WRONG
from sysid.workflow.results import Evaluation

MODEL_FILE = ("model.json", "the fit for sysid.load, qpal run and qpal export; it runs on raw records")
AnyFit = Fit | NlarxFit
_OUTSIDE = 0.05  # of the estimation data's range, by which an input may leave it before a sentence says so


@dataclass(frozen=True)
class Exports:
    """Names and contents of the files, and why others are missing."""

    files: tuple[tuple[str, str], ...] = ()
    notes: tuple[str, ...] = ()


def export(evaluation: Evaluation, folder: Path, signals: Signals | None = None) -> Exports:
    """model.json, model.c with model.h, and model.py in `folder`; the model knows the columns of `signals`.

    The code uses the levels of the record, means included.
    """
    fit = _with_warnings(evaluation)
    if signals is not None and fit.origin is not None:
        inputs, outputs = (tuple(signal.column for signal in role) for role in (signals.input, signals.output))
        fit = replace(fit, origin=replace(fit.origin, inputs=inputs, outputs=outputs))
    try:
        save(fit, folder / "model.json")
        export_c.write(fit, folder / "model.c")
        export_python.write(fit, folder / "model.py")
    except InputError as error:
        return Exports(notes=(f"no model files: {error}",))
    return Exports(
        (
            MODEL_FILE,
            ("model.h", "C99: structs of state and parameters, on the scales of the recorded input and output"),
            ("model.c", "its functions"),
            ("model.py", "the same in Python; imports only math"),
        ),
        ()
        if fit.u_offset is not None
        else ("model.c and model.py take signals that are prepared as those of the fit: no offset undoes that",),
    )


UNFIT = "do NOT use this model: "  # a warning of a saved fit that begins so is repeated wherever it is used


def unfit(fit: AnyFit) -> bool:
    """Whether the fit's own file says that it is not to be used."""
    return any(warning.startswith(UNFIT) for warning in fit.warnings)


def _with_warnings(evaluation: Evaluation) -> Fit | NlarxFit:
    """The fit with what was said of it: the percentage, so that `qpal run` repeats it to the last digit, and a warning.

    The record does not travel with the file; whoever takes the model from there would not know.
    """
    fit, estimation_fit = evaluation.fit, evaluation.estimation_fit
    reasons = (
        [f"the {evaluation.judged} fits the validation data to {percent(evaluation.judged_fit)}"]
        if poor(evaluation.judged_fit, evaluation.tests)
        else []
    )
    reasons += [note for note in evaluation.notes if WRONG in note and note not in fit.warnings]
    if reasons:
        fit = replace(fit, warnings=(f"{UNFIT}{'; '.join(reasons)}", *fit.warnings))
    if fit.origin is None or not isfinite(estimation_fit):
        return fit
    return replace(fit, origin=replace(fit.origin, fit=estimation_fit))


@dataclass(frozen=True)
class Saved:
    """A fit and the file that it came from; `name` is that of the file, or its number where two are alike."""

    path: Path
    fit: AnyFit
    name: str

    @property
    def estimation(self) -> float | None:
        """Fit [%] on the estimation data; None if the file does not hold it."""
        return None if self.fit.origin is None else self.fit.origin.fit

    def as_dict(self) -> dict:
        """What a summary says of the model."""
        fit = self.fit
        return {
            "file": str(self.path),
            "structure": fit.model.structure,
            "orders": orders(fit),
            "parameters": fit.criteria.d,
            "Ts": fit.Ts,
            "offsets": None if fit.u_offset is None else {"u": fit.u_offset.tolist(), "y": offset_of(fit.y_offset)},
            "estimation": None if fit.origin is None else vars(fit.origin),
        }


def offset_of(offset: np.ndarray | None) -> list[float] | None:
    """Offsets as a list; None if they are unknown."""
    return None if offset is None else offset.tolist()


def orders(fit: AnyFit) -> dict[str, int]:
    """Orders by name, of the first linear block of a chain; none for a chain without one."""
    if isinstance(fit, NlarxFit):
        return {"na": fit.model.na, "nb": fit.model.nb, "nk": fit.model.nk, "units": fit.network.units}
    return fit.model.dynamics[0][1].orders if fit.model.dynamics else {}


def load_models(paths: list[str]) -> list[Saved]:
    """The fits in these files, each under a name of its own; raises InputError for a file that holds none."""
    names = [Path(path).stem for path in paths]
    if len(set(names)) < len(names):  # runs/a/model.json and runs/b/model.json
        names = [str(Path(path).with_suffix("")) for path in paths]
    if len(set(names)) < len(names):
        names = [f"{name} ({k})" for k, name in enumerate(names, 1)]
    return [Saved(Path(path), load(path), name) for path, name in zip(paths, names, strict=True)]


def check_order(models: list[str], record: str) -> None:
    """Raises InputError, with the command as it is meant, where a log stands among the models and a model last."""
    paths = [*models, record]
    logs = [path for path in paths if Path(path).suffix.lower() in TABLE and Path(path).suffix.lower() != ".json"]
    models_first = [path for path in paths if path not in logs]
    if (
        len(logs) == 1
        and logs[0] != record
        and models_first
        and all(Path(path).suffix.lower() == ".json" for path in models_first)
    ):
        raise InputError(
            f"{logs[0]} is a log by its suffix, and the log stands last, after the models: "
            f"{shlex.join(['qpal', 'run', *models_first, logs[0]])}"
        )


@dataclass(frozen=True)
class Reading:
    """How a record is read, as `sysid.workflow.record.read_record` takes it; and what is done to it then.

    `detrend` is for models of an earlier version, which do not hold their offsets; `resampled` brings a record to the
    sampling time of the model.
    """

    path: str
    input: str | None = None
    output: str | None = None
    Ts: float | None = None
    time: str | None = None
    time_unit: str | None = None
    mapping: str | None = None
    range: Range = Range()  # noqa: RUF009 - it is frozen
    detrend: str = "none"
    resampled: bool = False

    def record(self, table: Table | None = None) -> Record:
        """The record as the file has it, or its `table` where that is read already."""
        file = self.path if table is None else table
        return read_record(file, self.input, self.output, self.Ts, self.time, self.mapping, self.range, self.time_unit)

    def named_by(self, fits: Sequence[AnyFit]) -> tuple["Reading", Table | None]:
        """The same, with the columns by the names that the fits know, where none is named; and the table, if read.

        Only columns that the file has, and only where all fits that find theirs mean the same; of a file without the
        outputs the inputs alone.
        """
        if self.input is not None or self.output is not None or self.mapping is not None:
            return self, None
        table = read_table(self.path)
        found = {_known_columns(fit, table) for fit in fits} - {("", "")}
        u, y = found.pop() if len(found) == 1 else ("", "")
        return replace(self, input=u or None, output=y or None), table


def _known_columns(fit: AnyFit, table: Table) -> tuple[str, str]:
    """The columns "a,b" of a table that were input and output of a fit's record, "" for those that it lacks.

    By the columns of the fit's file; where the file of the model is older and does not hold them, by name without unit.
    """
    if fit.origin is None:
        return "", ""
    roles = (("input", fit.origin.inputs, fit.origin.u_name), ("output", fit.origin.outputs, fit.origin.y_name))
    found = []
    for role, columns, name in roles:
        alike = [column for column in table.names if label(column, role, table.units.get(column, "")) == name]
        columns = columns or (tuple(alike) if len(alike) == 1 else ())
        is_plain = len(columns) == 1 or not any("," in column for column in columns)
        found.append(",".join(columns) if is_plain and columns and set(columns) <= set(table.names) else "")
    return found[0], found[1]


def data_for(fit: AnyFit, record: Record, reading: Reading) -> tuple[IOData, tuple[str, ...]]:
    """The record as the model takes it, and sentences on what was done to it and on what is not known.

    Raises InputError, with the file's name and what to do, for another sampling time, unit or number of channels.
    """
    if reading.detrend not in DETREND:
        raise InputError(f"--detrend is {reading.detrend!r}; give {' or '.join(DETREND)}")
    recipe = STRUCTURES.get(fit.model.structure)
    if recipe is not None and recipe.moves:
        record = with_places(record)
    if recipe is not None and recipe.zero:  # its angles count on over turns
        record = without_wraps(record)
    data, notes = record.data, list(record.notes)
    _check_channels(fit, record)
    _check_units(fit, record)
    if same_rate(data.Ts, fit.Ts):
        note = drift_note(data.Ts, fit.Ts, data.N)
        data, notes = replace(data, Ts=fit.Ts), [*notes, *([note] if note else [])]
    else:
        if not reading.resampled:
            raise InputError(
                f"{record.path}: the record is sampled every {data.Ts:g} s and the model every {fit.Ts:g} s; add "
                "--resample to bring the record to the model's sampling time, or identify a model at the record's"
            )
        resampled = resample(data, fit.Ts, "held")
        data = resampled.data
        notes.append(resampled.sentence)
    if reading.detrend != "none":
        data = detrend(data, reading.detrend)
        notes.append("means removed from the record")
    if fit.u_offset is None:
        advice = "" if reading.detrend != "none" else "; prepare the record alike, with --detrend mean or linear"
        notes.append(
            "the model's file has no offsets (a line or what is slow was removed from its estimation data, or an "
            f"earlier version saved it), so it runs on the record as it is{advice}"
        )
    return data, tuple(notes)


def _check_channels(fit: AnyFit, record: Record) -> None:
    counts = (1, 1) if isinstance(fit, NlarxFit) else fit.model.channels
    for role, n, values in (("input", counts[0], record.data.u), ("output", counts[1], record.data.y)):
        if values.shape[1] != n:
            raise InputError(
                f"{record.path}: {values.shape[1]} {role}(s) are read and the model has {n}; name as many columns with "
                f"--{role}, or in a mapping with --map"
            )


def _check_units(fit: AnyFit, record: Record) -> None:
    """A model in volts per degree on a record in radians gives numbers without any meaning."""
    difference = None if fit.origin is None else fit.origin.other_unit(record.data)
    if difference is not None:
        role, record_unit, model_unit = difference
        raise InputError(
            f"{record.path}: the {role} is in {record_unit} and the model's in {model_unit}; choose the column with "
            f"--{role}, or name "
            f"its unit in a mapping, see qpal info {record.path} --write-map MAP.toml"
        )


def remarks(fit: AnyFit, data: IOData, run: np.ndarray, from_rest: bool = False, counts: bool = True) -> list[str]:
    """What a reader of this free run (N, ny) should know: inputs beyond the estimation data's, runs that leave it.

    `from_rest`: it is that of a record without outputs. Of a run that does not count only whether it is finite.
    """
    levelled, sentences = fit.own_level(data), []
    low, high = fit.u_span
    if high > low:
        margin = _OUTSIDE * (high - low)
        share_outside = float(np.mean((levelled.u < low - margin) | (levelled.u > high + margin)))
        if share_outside:
            shift = 0.0 if fit.u_offset is None or len(fit.u_offset) > 1 else float(fit.u_offset[0])
            q = display_quantity("", data.u_unit)
            first, last = ((end + shift) * q.factor for end in (low, high))
            sentences.append(
                f"{100 * share_outside:.1f} % of the input's samples lie outside {first:.4g} to "
                f"{f'{last:.4g} {q.unit}'.rstrip()}, which the estimation data cover: the model extrapolates there"
            )
    if not counts:
        return [*sentences, *filter(None, [beyond(run, fit.remedy)])]
    if isinstance(fit, Fit) or from_rest:
        sentences += _beyond_outputs(fit, data, run)
    trouble = beyond(run, fit.remedy, "the run from rest") if from_rest else fit.divergence(data)
    if isinstance(fit, NlarxFit):
        trouble = trouble or (None if from_rest else fit.excursion(data))
    else:
        sentences += fit.model.remarks(fit.theta, levelled.u)
    return [*sentences, trouble] if trouble else sentences


def _beyond_outputs(fit: AnyFit, data: IOData, run: np.ndarray) -> list[str]:
    """A sentence where a run leaves the range of the estimation data's output, with the stop that a joint lacks."""
    low, high = fit.y_span
    if data.y.shape[1] > 1 or not high > low or not np.isfinite(run).all():
        return []
    unit, shift = display_quantity(data.y_name, data.y_unit), 0.0 if fit.y_offset is None else float(fit.y_offset[0])
    least, most = float(run.min()) - shift, float(run.max()) - shift
    margin = _OUTSIDE * (high - low)
    sides = [name for name, gap in (("lower", low - least), ("upper", most - high)) if gap > margin]
    if not sides:
        return []
    a, b, c, d = (f"{unit.factor * (value + shift):.4g}" for value in (least, most, low, high))
    sentence = f"the run goes from {a} to {b} {unit.unit}".rstrip()
    first = int(np.argmax((run < low + shift - margin) | (run > high + shift + margin)))
    sentence += f" and the estimation data from {c} to {d} {unit.unit}".rstrip()
    sentence += f": the model extrapolates there, from sample {first} on"
    if not isinstance(fit, Fit) or not is_joint(fit.model):
        return [sentence]
    of_motor = {"lower": "upper", "upper": "lower"} if output_falls(fit) else {}
    missing = [name for name in sides if of_motor.get(name, name) not in motor_of(fit.model).ends]
    lack = f"; it knows no {' and no '.join(missing)} end stop, at which the joint may stand" if missing else ""
    return [sentence + lack]


def fell(estimation_percent: float | None, record_percent: float, most: float = 10.0) -> str | None:
    """A sentence where the fit [%] is far below that of the estimation data; None where it is not, or not known."""
    if estimation_percent is None or not np.isfinite(record_percent) or estimation_percent - record_percent <= most:
        return None
    return (
        f"the fit on the estimation data was {percent(estimation_percent)}: this record shows what those data did "
        "not, or the two "
        "do not come from the same plant"
    )


def one_output(data: IOData, j: int) -> IOData:
    """The record with output j alone, for a figure."""
    missing = None if data.missing is None else data.missing[:, j]
    name = data.y_name if data.y.shape[1] == 1 else f"{data.y_name or 'y'} {j + 1}"
    unit = unit_of_channel(data.y_unit, j)
    return replace(data, y=data.y[:, j], missing=missing, y_name=name, y_unit=unit, y_offset=data.y_offset[j])
