"""From a recorded file to an evaluated model, as in `qpal identify`."""

import os
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

from sysid.base.errors import InputError, unknown
from sysid.channels.mapping import Range
from sysid.channels.reading import Mapping
from sysid.data.preprocess import quick_start
from sysid.data.record import IOData
from sysid.diagnosis.advice import advise
from sysid.selection.select import SECONDS, select
from sysid.selection.space import Space
from sysid.selection.table import Selection
from sysid.solver.searches import TABLE as SEARCHES
from sysid.workflow.angles import in_unit_of, without_wraps
from sysid.workflow.evaluation import Evaluation, Setting, check_parts, evaluate, evaluate_fit
from sysid.workflow.identified import Identification
from sysid.workflow.next_step import next_step
from sysid.workflow.record import read_record


@dataclass(frozen=True)
class Auto:
    """A search over structures instead of one setting; `journal` keeps finished candidates if the run is stopped.

    `seconds` is its budget. `scheduler` is the address of a Dask scheduler whose workers judge the candidates; local
    processes do if None.
    """

    search: str = "auto"
    starts: int = 5
    seed: int = 0
    journal: Path | None = None
    scheduler: str | None = None
    seconds: float = SECONDS

    def __post_init__(self) -> None:
        if not self.seconds > 0:
            raise InputError(f"--seconds is {self.seconds:g}; give a positive number of seconds")
        if self.search not in SEARCHES:
            raise unknown("search", self.search, SEARCHES)


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
    mapping: Mapping | None = None,
    range: Range = Range(),  # noqa: B008 - it is frozen
    time_unit: str | None = None,
    progress: Callable[[str], None] | None = None,
) -> Identification:
    """Reads the file, prepares both parts and fits `setting` to the first part; `fitting` is called before the fit.

    A structure search uses only the first part, as every fit does; `candidate(done, total, name)` receives its
    progress, and `progress` a text after each search of a fit. Settings in the unit of the output are in that of its
    column. An angle that wraps at a turn counts on over turns for structures of absolute signals and for a search.
    `detrend` None means "mean", or "none" for a structure with absolute signals (`Recipe.zero`). Every InputError names
    the file.
    """
    detrend = setting.recipe.detrend(detrend) if isinstance(setting, Setting) else detrend or "mean"
    record = read_record(path, input, output, Ts, time, mapping, range, time_unit)
    try:
        if isinstance(setting, Setting):
            recipe, record = in_unit_of(record, setting.recipe)
            setting = replace(setting, recipe=recipe)
        if isinstance(setting, Auto) or setting.recipe.zero:  # a structure of absolute angles
            record = without_wraps(record)
        estimation, validation = quick_start(record.data, split, detrend)
        check_parts(estimation, validation)
        advice = tuple(a.of_file(str(record.path), record.options) for a in advise(record.data))
        fitting()
        if isinstance(setting, Auto):
            selection, evaluation = _search(setting, estimation, validation, candidate, progress)
        else:
            selection, evaluation = None, evaluate(setting, estimation, validation, progress)
    except InputError as error:
        raise InputError(f"{record.path}: {error}") from None
    detrend = "none" if evaluation.setting.recipe.zero else detrend
    found = Identification(record, split, detrend, evaluation, advice, selection)
    return replace(found, next=next_step(found))


def _search(
    auto: Auto,
    estimation: IOData,
    validation: IOData,
    candidate: Callable[[int, int, str], None] | None,
    progress: Callable[[str], None] | None,
) -> tuple[Selection, Evaluation]:
    """The search on `estimation`, and its chosen fit evaluated on `validation` without refitting."""
    space = Space(starts=auto.starts)
    options = auto.search, auto.seed, None, auto.journal, candidate, auto.scheduler, auto.seconds
    found = select(estimation, space, *options)
    recipe = found.chosen.candidate
    setting = Setting(recipe, auto.search, auto.starts, auto.seed)
    parts = recipe.scale(estimation), recipe.scale(validation)
    if recipe.grown:  # the search tried the plain one
        return found, evaluate(setting, *parts, progress)
    return found, evaluate_fit(setting, found.fit, *parts)
