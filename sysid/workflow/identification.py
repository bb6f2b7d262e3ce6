"""From a recorded file to an evaluated model, as in `qpal identify`."""

import os
from collections.abc import Callable, Sequence
from dataclasses import replace

from sysid.base.errors import InputError
from sysid.block.ahead import compile_ahead
from sysid.channels.mapping import Range
from sysid.channels.reading import Mapping
from sysid.data.preparation import Preparation
from sysid.data.record import IOData
from sysid.data.table import Table
from sysid.diagnosis.advice import Advice
from sysid.model.recipes import Several
from sysid.selection.select import select
from sysid.selection.space import Space
from sysid.selection.table import Selection
from sysid.structures import TABLE as STRUCTURES
from sysid.workflow.advice_after_fit import advice_after_fit
from sysid.workflow.evaluation import evaluate, evaluate_fit
from sysid.workflow.next_step import proposals
from sysid.workflow.record import Record, read_record
from sysid.workflow.results import Evaluation, Identification, named_channels, without_validation
from sysid.workflow.room import told_of_parts
from sysid.workflow.setting import Setting
from sysid.workflow.sources import Auto, Sources, named, records_of
from sysid.workflow.trials import tried

Paths = str | os.PathLike[str] | Sequence[str | os.PathLike[str]]


def identify_file(
    path: Paths,
    setting: Setting | Auto,
    input: str | None = None,
    output: str | None = None,
    Ts: float | None = None,
    time: str | None = None,
    split: float | None = None,
    detrend: str | None = None,
    fitting: Callable[[], None] = lambda: None,
    candidate: Callable[[int, int, str], None] | None = None,
    mapping: Mapping | None = None,
    range: Range = Range(),  # noqa: B008 - it is frozen
    time_unit: str | None = None,
    progress: Callable[[str], None] | None = None,
    validation: Sequence[str | os.PathLike[str]] = (),
    preparation: Preparation = Preparation(),  # noqa: B008 - it is frozen
    trials: float | None = 0.0,
) -> Identification:
    """Reads the file, prepares both parts and fits `setting` to the first part; `fitting` is called before the fit.

    Several paths are the experiments of one record. Where `validation` names files, they are the validation data and
    all of the others is for the fit; else the first `split` (None: 0.5) of each experiment is. A record whose input
    moves in one of these parts alone, as in a step test, is fitted as a whole where `split` is None, and nothing
    validates the model. `input` and `output` may name several columns, "a,b". A structure search uses only the first
    part, as every fit does; `candidate(done, total, name)` receives its progress, and `progress` a text after each
    search of a fit. Settings in the unit of the output are in that of its column. An angle that wraps at a turn counts
    on over turns for structures of absolute signals and
    for a search. `preparation` is done to every record. `detrend` None means what it says, else "none": the zero of the
    output is a parameter of the structures. A saved start keeps its own zero. `trials` is the budget [s] in which the
    next steps are tried, see `sysid.workflow.trials.tried`. Every InputError names the file.
    """
    if isinstance(setting, Setting):
        compile_ahead(setting.recipe.blocks_to_compile())
    detrend = detrend or preparation.detrend
    detrend = setting.recipe.detrend(detrend) if isinstance(setting, Setting) else detrend or "none"
    _check_plan(setting, preparation, detrend, split, bool(validation))
    paths = (path,) if isinstance(path, str | os.PathLike) else tuple(path)

    def read(path: str | os.PathLike[str] | Table) -> Record:
        return read_record(path, input, output, Ts, time, mapping, range, time_unit, preparation.missing)

    _check_once(paths, validation)
    sources = Sources(records_of(paths, read), records_of(validation, read), preparation)
    check_channels(setting, sources.records[0])
    prepared = sources.prepared(setting, split, detrend)
    fitting()
    parts, whole = prepared.parts, prepared.record.data
    with named(sources.records[0].path), told_of_parts(prepared.plan, parts[0], int(whole.observed.sum())):
        if isinstance(setting, Auto):
            selection, evaluation = _search(setting, *parts, candidate, progress)
        else:
            selection, evaluation = None, evaluate(prepared.setting, *parts, progress)
    record, plan = prepared.record, prepared.plan
    if detrend == "linear" or (preparation.filter or (None,))[0]:
        # No offset undoes a line or a high-pass filter: a raw record has to be prepared alike.
        evaluation = replace(evaluation, fit=replace(evaluation.fit, u_offset=None, y_offset=None))
    evaluation = named_channels(without_validation(evaluation) if plan.whole else evaluation, record.signals)
    plan = replace(plan, detrend="none" if evaluation.setting.recipe.zero else detrend)
    advice = tuple(_about(record, a, evaluation) for a in prepared.findings)
    asked = None if isinstance(setting, Auto) else setting
    result = Identification(record, plan, evaluation, advice, selection, asked=asked)

    def attempt(setting: Setting, split: float | None, detrend: str) -> Evaluation:
        part = sources.prepared(setting, split, setting.recipe.detrend(detrend), diagnose=False)
        found = evaluate(part.setting, *part.parts, progress)
        return without_validation(found) if part.plan.whole else found

    steps = tried(result, proposals(result), attempt, trials)
    return replace(result, next=next(iter(steps), None), also=steps[1] if len(steps) > 1 else None)


def _about(record: Record, advice: Advice, e: Evaluation) -> Advice:
    """The finding after a fit, with the record's files in its command."""
    first, *further_files = map(str, record.paths)
    further = advice_after_fit(advice, e.setting.recipe, e.judged_fit)
    return further.of_file(first, (*(() if further.command == ("design",) else further_files), *record.options))


def _check_once(paths: Sequence[str | os.PathLike[str]], validation: Sequence[str | os.PathLike[str]]) -> None:
    """Raises InputError for a file that is given twice: it would count double, or be no unseen data."""
    places: set[str] = set()
    for path in (*paths, *validation):
        place = os.path.realpath(path)  # `Path.resolve` raises for a link to itself
        if place in places:
            raise InputError(f"{path} is given twice; name each file once, for the fit or with --validation")
        places.add(place)


def check_channels(setting: Setting | Auto, record: Record) -> None:
    """Raises InputError if the record has several inputs or outputs and the structure takes one of each."""
    recipe = setting.recipe if isinstance(setting, Setting) else None
    nu, ny = record.data.u.shape[1], record.data.y.shape[1]
    if (nu, ny) == (1, 1) or isinstance(recipe, Several):
        return
    taker = "a structure search takes" if recipe is None else f"structure {recipe.name} takes"
    able = [name for name, kind in STRUCTURES.items() if issubclass(kind, Several)]
    raise InputError(
        f"{record.path}: {taker} one input and one output, and the record has {nu} and {ny}; name one column of each "
        f"with --input and --output, or give --structure {', '.join(able[:-1])} or {able[-1]}"
    )


def _check_plan(
    setting: Setting | Auto, preparation: Preparation, detrend: str, split: float | None, apart: bool
) -> None:
    """Raises InputError for choices that exclude each other, before any file is read."""
    if apart and split is not None:
        raise InputError(
            f"--split is {split:g} and --validation is given; all of the other files is for the fit then: leave one of "
            "the two out"
        )
    if isinstance(setting, Auto) and detrend == "linear":
        raise InputError(
            "--detrend is linear, and a structure search tries models of absolute signals too, to which lines cannot "
            "be given back; leave it out, or name a --structure"
        )
    if isinstance(setting, Setting) and setting.recipe.zero and preparation.filter[0] is not None:
        raise InputError(
            f"--filter removes what is slower than {preparation.filter[0]:g} Hz, and {setting.recipe.zero} of "
            f"structure {setting.recipe.name} count from zero; leave the lower end out"
        )


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
    selection = select(estimation, space, *options)
    recipe = selection.chosen.candidate
    setting = Setting(recipe, auto.search, auto.starts, auto.seed)
    parts = recipe.scale(estimation), recipe.scale(validation)
    if recipe.with_parts:  # the search tried the plain one
        return selection, evaluate(setting, *parts, progress)
    return selection, evaluate_fit(setting, selection.fit, *parts)
