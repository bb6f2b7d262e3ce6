"""From a recorded file to an evaluated model: what `qpal identify` does."""

import os
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import sysid
from sysid.base.errors import InputError, unknown
from sysid.base.versions import versions
from sysid.data.preprocess import quick_start
from sysid.data.record import IOData
from sysid.diagnosis.advice import Advice
from sysid.selection.select import Selection, Space, select
from sysid.workflow.evaluation import Evaluation, Setting, check_parts, evaluate, evaluate_fit
from sysid.workflow.record import Record, read_record


@dataclass(frozen=True)
class Auto:
    """A search over structures instead of one setting: `journal` keeps finished candidates through a kill."""

    search: str = "auto"
    starts: int = 5
    seed: int = 0
    journal: Path | None = None

    def __post_init__(self) -> None:
        if self.search not in sysid.solver.searches.TABLE:
            raise unknown("search", self.search, sysid.solver.searches.TABLE)


@dataclass(frozen=True)
class Identification:
    """The record, what it says about itself, how it was prepared, and the model with its tests.

    `selection` is the structure search that the model came from, None where the structure was given.
    """

    record: Record
    split: float
    detrend: str
    evaluation: Evaluation
    advice: tuple[Advice, ...] = ()
    selection: Selection | None = None

    def as_dict(self) -> dict[str, Any]:
        """The summary of `qpal identify`, ready for JSON."""
        return {
            "read": {**self.record.as_dict(), "split": self.split, "detrend": self.detrend},
            **self.evaluation.as_dict(),
            "selection": self.selection.as_dict() if self.selection else None,
            "advice": [vars(a) for a in self.advice],
            "versions": versions(),
        }


def identify_file(
    path: str | os.PathLike[str],
    setting: Setting | Auto,
    input: str | None = None,
    output: str | None = None,
    Ts: float | None = None,
    time: str | None = None,
    split: float = 0.5,
    detrend: str | None = None,
    fitting: Callable[[], None] = lambda: None,
    candidate: Callable[[int, int, str], None] | None = None,
) -> Identification:
    """Reads the file, prepares both parts and fits `setting` to the first; `fitting` is called before the fit.

    A structure search sees the first part alone, as every fit does; `candidate(done, total, name)` hears its progress.
    `detrend` is "mean" if None is given, but "none" of a structure whose signals count from zero (`Recipe.zero`).
    Every InputError names the file, also where the identifier itself finds that the record will not do.
    """
    detrend = setting.recipe.detrend(detrend) if isinstance(setting, Setting) else detrend or "mean"
    record = read_record(path, input, output, Ts, time)
    try:
        estimation, validation = quick_start(record.data, split, detrend)
        check_parts(estimation, validation)
        advice = sysid.advise(record.data)
        fitting()
        if isinstance(setting, Auto):
            selection, evaluation = _search(setting, estimation, validation, candidate)
        else:
            selection, evaluation = None, evaluate(setting, estimation, validation)
    except InputError as error:
        raise InputError(f"{record.path}: {error}") from None
    detrend = "none" if evaluation.setting.recipe.zero else detrend
    return Identification(record, split, detrend, evaluation, advice, selection)


def _search(
    auto: Auto, estimation: IOData, validation: IOData, candidate: Callable[[int, int, str], None] | None
) -> tuple[Selection, Evaluation]:
    """The search on `estimation`, and its chosen fit, as it is, evaluated on `validation`."""
    space = Space(starts=auto.starts)
    found = select(estimation, space, auto.search, auto.seed, journal=auto.journal, progress=candidate)
    recipe = found.chosen.candidate
    setting = Setting(recipe, auto.search, auto.starts, auto.seed)
    parts = recipe.scale(estimation), recipe.scale(validation)
    if recipe.grown:  # the search tried the plain one
        return found, evaluate(setting, *parts)
    return found, evaluate_fit(setting, found.fit, *parts)
