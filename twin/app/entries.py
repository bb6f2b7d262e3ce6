"""What a session's files hold: entries, records and free runs.

Entries are checked field by field on opening; a field that is not known is an error. Records and free runs are files
that a page opens at once, without reading a log again.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal, Self
from zipfile import ZipFile

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, FiniteFloat, ValidationError, model_validator

from sysid.base.errors import InputError, readable_values
from sysid.base.files import atomic_file, check_regular_file
from sysid.data.preparation import Preparation
from sysid.data.record import IOData
from sysid.formats import TABLE
from sysid.structures import TABLE as STRUCTURES
from sysid.structures import Recipe

Name = Annotated[str, Field(min_length=1, max_length=200)]
Number = FiniteFloat
Positive = Annotated[FiniteFloat, Field(gt=0)]
DATA_ID = r"^d[1-9][0-9]{0,5}$"
MODEL_ID = r"^m[1-9][0-9]{0,5}$"
STUDY_ID = r"^s[1-9][0-9]{0,5}$"
LOG = "log"  # name of a record's file in its folder, in front of the suffix
LARGEST = 512 * 2**20  # [byte] of a request: a log of some million samples as text
SMALL = 4 * 2**20  # [byte] of an entry: 500 columns of 100 letters, and a note for each
MOST = 64 * 2**20  # [byte] of a model's file: a report with plotly is 8 MiB, a table of a network's weights less
WORD = 200  # letters of a name in a record
COLUMNS = ("input", "output", "time", "columns")  # of a record: they must stay the names of its file
FIELDS = ("u_name", "y_name", "u_unit", "y_unit")  # of a record, kept as texts


class Entry(BaseModel):
    """A part of a session."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    @model_validator(mode="before")
    @classmethod
    def _readable(cls, fields: Any) -> Any:
        """Another person may have written the session: its texts act on no reader; columns are told by their names."""
        if not isinstance(fields, dict):
            return fields
        return {name: value if name in COLUMNS else readable_values(value) for name, value in fields.items()}

    @classmethod
    def from_form(cls, fields: Mapping[str, Any]) -> Self:
        """The entry from what a person chose; raises InputError for what is out of its limits."""
        try:
            return cls.model_validate(fields)
        except ValidationError as error:
            raise InputError(complaint(error)) from None


class Twin(Entry):
    """An experiment on the twin."""

    joint: Literal["shoulder", "thigh", "shank"] = "thigh"
    excitation: Annotated[str, Field(max_length=40)] = "aprbs"
    duration: Annotated[Positive, Field(le=36000)] = 60.0
    Ts: Positive = 0.1
    seed: Annotated[int, Field(ge=0)] = 1
    without: tuple[str, ...] = ()


class Prepare(Entry):
    """The fields of `sysid.data.preparation.Preparation`."""

    start: Number | None = None
    stop: Number | None = None
    missing: str = "mark"
    resample: Positive | None = None
    low: Positive | None = None
    high: Positive | None = None
    detrend: str | None = None

    def preparation(self) -> Preparation:
        """The same as steps; raises InputError for values that make no sense together."""
        return Preparation(self.start, self.stop, self.missing, self.resample, (self.low, self.high), self.detrend)


class Finding(Entry):
    """A line of the advice on a record."""

    sentence: str
    action: str
    severity: Literal["fine", "note", "warning"]


class Data(Entry):
    """A record: the file it is read from, its columns where a person chose them, and what is done before a fit.

    `columns` are those of the file, `notes` what was assumed on reading; `problem` is why it could not be read.
    """

    name: Name
    suffix: Annotated[str, Field(max_length=20)]
    input: str | None = None
    output: str | None = None
    time: str | None = None
    Ts: Positive | None = None
    twin: Twin | None = None
    joint: Literal["", "shoulder", "thigh", "shank"] = ""
    prepare: Prepare = Prepare()
    columns: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()
    problem: str = ""
    advice: tuple[Finding, ...] | None = None

    @property
    def file(self) -> str:
        """The file's name in the folder of the record; raises InputError for a suffix that no format has."""
        if self.suffix not in TABLE:
            raise InputError(f"a log ends in {self.suffix!r}; it must be one of {', '.join(TABLE)}")
        return f"{LOG}{self.suffix}"


class Setting(Entry):
    """A structure with its settings and how it is fitted."""

    structure: Annotated[str, Field(max_length=40)] = "hammerstein_wiener"
    settings: dict[str, int | float | str | None] = {}
    starts: Annotated[int, Field(ge=1, le=1000)] = 5
    seed: Annotated[int, Field(ge=0)] = 0
    split: Annotated[float, Field(gt=0, lt=1)] = 0.5

    def recipe(self) -> Recipe:
        """The recipe; raises InputError for a structure or a setting that does not exist."""
        if self.structure not in STRUCTURES:
            raise InputError(f"structure is {self.structure!r}; choose one of {', '.join(STRUCTURES)}")
        kind = STRUCTURES[self.structure]
        for name in self.settings:
            if name not in kind.options():
                raise InputError(f"{self.structure} has no setting {name!r}; it has {', '.join(kind.options())}")
        return kind(**self.settings)


class Model(Entry):
    """A fitted model: the record and the settings that gave it, and what the board shows.

    A fit [%] is None where the free run left every bound. `joint` says whether MJCF has elements for it, `whole` that
    all of the record was fitted and there is no fit to unseen data.
    """

    name: Name
    data: Annotated[str, Field(pattern=DATA_ID)]
    prepare: Prepare
    setting: Setting
    fit_estimation: Number | None
    fit_validation: Number | None
    d: int
    N: int
    seconds: float
    converged: bool
    joint: bool = False
    whole: bool = False
    notes: tuple[str, ...] = ()


class Study(Entry):
    """A record beside the twin, or the twin's parameters from a record."""

    kind: Literal["compare", "calibrate"]
    data: Annotated[str, Field(pattern=DATA_ID)]
    joint: Literal["shoulder", "thigh", "shank"]
    sentences: tuple[str, ...] = ()
    seconds: float = 0.0


class Head(Entry):
    """The session itself."""

    format: Literal["qpal session"] = "qpal session"
    version: Literal[1] = 1
    shown: str | None = None
    setting: Setting = Setting()
    twin: Twin = Twin()


def complaint(error: ValidationError) -> str:
    """The first complaint of pydantic's ValidationError in words."""
    first = error.errors()[0]
    place = ".".join(str(part) for part in first["loc"]) or "the file"
    value = first.get("input")
    text = "" if isinstance(value, (dict, list)) else f" is {str(value)[:60]!r}"
    return f"{place}{text}: {first['msg'][0].lower()}{first['msg'][1:]}"


@dataclass(frozen=True)
class Runs:
    """What a model gives under the input that it was fitted and validated with.

    t [s] from the start of the log, measured y and free run (N,) on the scale of the log, and the time `border` [s]
    at which validation begins.
    """

    t: np.ndarray
    y: np.ndarray
    run: np.ndarray
    border: float
    name: str
    unit: str


def save_record(data: IOData, path: Path) -> None:
    """Write a record of one input and one output."""
    missing = np.zeros(0, dtype=bool) if data.missing is None else data.missing
    words = {name: np.array(str(getattr(data, name))) for name in FIELDS}
    _write(path, u=data.u, y=data.y, Ts=np.array(data.Ts), missing=missing, **words)


def load_record(path: Path) -> IOData:
    """Read what `save_record` wrote; raises InputError for a file that is missing or damaged."""
    arrays = _read(path)
    try:
        missing = arrays["missing"] if arrays["missing"].size else None
        words: dict[str, Any] = {name: str(arrays[name])[:WORD] for name in FIELDS}
        return IOData(arrays["u"], arrays["y"], float(arrays["Ts"]), missing=missing, **words)
    except (KeyError, TypeError, ValueError) as error:
        raise InputError(f"{path.name} is damaged ({error}); add the log again") from None


def save_runs(evaluation: Any, start: float, path: Path) -> None:
    """Write the free runs of an evaluation whose record begins `start` [s] after that of the log."""
    estimation, parts = evaluation.estimation, [(evaluation.estimation, evaluation.estimation_output)]
    parts += [(evaluation.validation, evaluation.validation_output)] if evaluation.unseen else []
    offset = estimation.y_offset[0]
    y = np.concatenate([np.where(part.observed[:, 0], part.y[:, 0], np.nan) for part, _ in parts]) + offset
    run = np.concatenate([np.ravel(output) for _, output in parts]) + offset
    t = start + np.arange(len(y)) * estimation.Ts
    words = {"name": np.array(estimation.y_name), "unit": np.array(estimation.y_unit)}
    _write(path, t=t, y=y, run=run, border=np.array(start + (estimation.N - 0.5) * estimation.Ts), **words)


def load_runs(path: Path) -> Runs:
    """Read what `save_runs` wrote; raises InputError for a file that is missing or damaged."""
    arrays = _read(path)
    try:
        t, y, run = (np.asarray(arrays[name], dtype=float) for name in ("t", "y", "run"))
        if not (t.ndim == 1 and t.shape == y.shape == run.shape):
            raise ValueError("the signals differ in length")
        if not (np.isfinite(t).all() and np.isfinite(y).any()):
            raise ValueError("the signals have no samples")
        name, unit = (str(arrays[word])[:WORD] for word in ("name", "unit"))
        return Runs(t, y, run, float(arrays["border"]), name, unit)
    except (KeyError, TypeError, ValueError) as error:
        raise InputError(f"{path.name} is damaged ({error}); fit the model again") from None


def _write(path: Path, **arrays: np.ndarray) -> None:
    with atomic_file(path) as temporary:
        np.savez(temporary, **arrays)  # type: ignore[arg-type]


def _read(path: Path) -> dict[str, np.ndarray]:
    """The arrays of an archive, which are at most `LARGEST` bytes: a packed file can be a thousandth of its content."""
    try:
        with ZipFile(check_regular_file(path)) as packed:
            if sum(member.file_size for member in packed.infolist()) > LARGEST:
                raise ValueError(f"its content is larger than {LARGEST // 2**20} MiB")
        with np.load(path, allow_pickle=False) as file:
            arrays = {name: file[name] for name in file.files}
            # numpy gives other members as bytes
            if not all(isinstance(array, np.ndarray) for array in arrays.values()):
                raise ValueError("one of its members is no array")
            return arrays
    except Exception as error:  # a damaged file fails in many ways inside numpy and zipfile
        raise InputError(f"{path.name} cannot be read ({error}); add the log, or fit the model, again") from None
