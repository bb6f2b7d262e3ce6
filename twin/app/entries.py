"""What a session's files hold: entries, which are checked field by field on opening; an unknown field is an error."""

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, Self

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, FiniteFloat, ValidationError, model_validator

from sysid.base.errors import InputError, readable_values
from sysid.data.preparation import Preparation
from sysid.formats import TABLE
from sysid.structures import TABLE as STRUCTURES
from sysid.structures import Recipe

if TYPE_CHECKING:
    from sysid.workflow.setting import Setting as FitSetting
    from sysid.workflow.sources import Auto

Name = Annotated[str, Field(min_length=1, max_length=200)]
Number = FiniteFloat
Positive = Annotated[FiniteFloat, Field(gt=0)]
DATA_ID = r"^d[1-9][0-9]{0,5}$"
MODEL_ID = r"^m[1-9][0-9]{0,5}$"
STUDY_ID = r"^s[1-9][0-9]{0,5}$"
DataId = Annotated[str, Field(pattern=DATA_ID)]
LOG = "log"  # name of a record's file in its folder, in front of the suffix
LARGEST = 512 * 2**20  # [byte] of a request: a log of some million samples as text
SMALL = 4 * 2**20  # [byte] of an entry: 500 columns of 100 letters, and a note for each
MOST = 64 * 2**20  # [byte] of a model's file: a report with plotly is 8 MiB, a table of a network's weights less
AUTO = "auto"  # in place of a structure: the search for one
SEARCHED = 110.0  # [s] of that search, as `sysid.selection.table.SECONDS`, whose import takes seconds
COLUMNS = ("input", "output", "time", "columns")  # of a record: they must stay the names of its file


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
    """A structure with its settings and how it is fitted, or `AUTO` for the search of one within `seconds`.

    `fixed` are values of parameters and `bounds` their ends, None for an open one; `start` is the model of the session
    from which the search begins.
    """

    structure: Annotated[str, Field(max_length=40)] = "hammerstein_wiener"
    settings: dict[str, int | float | str | None] = {}
    starts: Annotated[int, Field(ge=1, le=1000)] = 5
    seed: Annotated[int, Field(ge=0)] = 0
    split: Annotated[float, Field(gt=0, lt=1)] = 0.5
    seconds: Annotated[Positive, Field(le=86400)] = SEARCHED
    fixed: dict[Name, Number] = {}
    bounds: dict[Name, tuple[Number | None, Number | None]] = {}
    start: Annotated[str, Field(pattern=MODEL_ID)] | None = None

    def recipe(self) -> Recipe:
        """The recipe; raises InputError for a structure or a setting that does not exist."""
        if self.structure not in STRUCTURES:
            raise InputError(f"structure is {self.structure!r}; choose one of {', '.join(STRUCTURES)}")
        kind = STRUCTURES[self.structure]
        for name in self.settings:
            if name not in kind.options():
                raise InputError(f"{self.structure} has no setting {name!r}; it has {', '.join(kind.options())}")
        return kind(**self.settings)

    def title(self) -> str:
        """The structure with its settings; raises InputError as `recipe` does."""
        return "search for a structure" if self.structure == AUTO else str(self.recipe())

    def wanted(self, start: Path | None = None) -> "FitSetting | Auto":
        """What `sysid.workflow.identification.identify_file` fits; `start` is the saved model of `self.start`."""
        from sysid.workflow.setting import Held, read_start
        from sysid.workflow.setting import Setting as FitSetting
        from sysid.workflow.sources import Auto

        if self.structure == AUTO:
            return Auto(starts=self.starts, seed=self.seed, seconds=self.seconds)
        ends = {
            name: (-np.inf if low is None else low, np.inf if high is None else high)
            for name, (low, high) in self.bounds.items()
        }
        fit = None if start is None else read_start(str(start))
        held = Held(tuple(self.fixed.items()), tuple(ends.items()), fit, start)
        return FitSetting(self.recipe(), starts=1 if fit else self.starts, seed=self.seed, held=held)


class Step(Entry):
    """What to do after a fit: `why`, and where the app can do it, `words` for it with what it brings, and the fit."""

    why: str
    words: str = ""
    setting: Setting | None = None


class Verdict(Entry):
    """The first screen of a result: a large number, what it is of, one word and one sentence."""

    number: str = ""
    of: str = ""
    word: Literal["good", "usable", "poor"] | None = None
    sentence: str = ""


class Model(Entry):
    """A fitted model: the record and the settings that gave it, and what the board shows.

    A fit [%] is None where the free run left every bound. `joint` says whether MJCF has elements for it, `whole` that
    all of the record was fitted and there is no fit to unseen data. `further` are records of the same fit beside
    `data`, `validation` those that judge it. `asked` is AUTO where a search chose the structure of `setting`.
    """

    name: Name
    data: DataId
    further: tuple[DataId, ...] = ()
    validation: tuple[DataId, ...] = ()
    prepare: Prepare
    setting: Setting
    asked: str = ""
    fit_estimation: Number | None
    fit_validation: Number | None
    d: int
    N: int
    seconds: float
    converged: bool
    joint: bool = False
    whole: bool = False
    verdict: Verdict = Verdict()
    steps: tuple[Step, ...] = ()
    notes: tuple[str, ...] = ()

    @property
    def records(self) -> tuple[str, ...]:
        """The records of the fit and of its validation, in this order."""
        return (self.data, *self.further, *self.validation)


class Study(Entry):
    """A record beside the twin, the twin's parameters from records, or a `model` on a record (kind "run")."""

    kind: Literal["compare", "calibrate", "run"]
    data: DataId
    joint: Literal["", "shoulder", "thigh", "shank"] = ""
    model: str = ""
    verdict: Verdict = Verdict()
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
