"""From a recorded file to an evaluated model, as in `qpal identify`."""

import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from sysid.base.errors import InputError, unknown
from sysid.channels.mapping import Range
from sysid.channels.one_record import COLUMNS, as_one
from sysid.channels.reading import Mapping
from sysid.data.preparation import Preparation
from sysid.data.record import IOData
from sysid.data.table import Table
from sysid.data.trends import with_offsets
from sysid.diagnosis.advice import advise
from sysid.formats import read_table
from sysid.model.recipes import Several
from sysid.selection.select import select
from sysid.selection.space import Space
from sysid.selection.table import SECONDS, Selection
from sysid.solver.searches import TABLE as SEARCHES
from sysid.structures import TABLE as STRUCTURES
from sysid.workflow.evaluation import check_parts, evaluate, evaluate_fit, moves_in_one_part
from sysid.workflow.next_step import advice_after_fit, next_step
from sysid.workflow.plan import Plan, check_same_channels, merge_records, prepare_record
from sysid.workflow.record import Record, read_record, with_places, without_wraps
from sysid.workflow.results import Evaluation, Identification, named_channels, without_validation
from sysid.workflow.servo import with_servo, with_turn
from sysid.workflow.setting import Setting, in_unit_of

Paths = str | os.PathLike[str] | Sequence[str | os.PathLike[str]]


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
    output is a parameter of the structures. A saved start keeps its own zero. Every InputError names the file.
    """
    detrend = detrend or preparation.detrend
    detrend = setting.recipe.detrend(detrend) if isinstance(setting, Setting) else detrend or "none"
    _check_plan(setting, preparation, detrend, split, bool(validation))
    paths = (path,) if isinstance(path, str | os.PathLike) else tuple(path)

    def read(path: str | os.PathLike[str] | Table) -> Record:
        return read_record(path, input, output, Ts, time, mapping, range, time_unit, preparation.missing)

    _check_once(paths, validation)
    records, validation_records = _records(paths, read), _records(validation, read)
    check_channels(setting, records[0])
    name = records[0].path
    try:
        if isinstance(setting, Setting):
            recipe, records[0] = in_unit_of(records[0], setting.recipe)
            recipe, records[0] = with_servo(recipe, [*records, *validation_records])
            records[0] = with_turn(recipe, records[0])
            setting = replace(setting, recipe=recipe)
        if isinstance(setting, Setting) and setting.recipe.moves:
            records, validation_records = ([with_places(r) for r in rs] for rs in (records, validation_records))
        absolute = isinstance(setting, Auto) or bool(setting.recipe.zero)
        record = _merge_prepared(records, absolute, preparation)
        validation_record = _merge_prepared(validation_records, absolute, preparation) if validation_records else None
        if validation_record is not None:
            check_same_channels(record, validation_record)
            validation_record = replace(validation_record, data=replace(validation_record.data, Ts=record.data.Ts))
        plan = Plan(preparation, 0.5 if split is None else split, detrend, validation_record)
        estimation, validation_part = plan.parts(record.data)
        if validation_record is None and moves_in_one_part(estimation, validation_part):
            if split is not None:
                raise InputError(
                    f"with --split {split:g} the input moves in one of the two parts alone; choose another split, or "
                    "leave --split out: where the halves are so too, as in a step test, all is used for the fit"
                )
            if isinstance(setting, Auto):
                raise InputError(
                    "the input moves in one half of the record alone, and a structure search fits each half and judges "
                    "it by the other; name a structure, such as --structure output_error, or record again"
                )
            plan = replace(plan, whole=True)
            estimation, validation_part = plan.parts(record.data)
        start = setting.held.start if isinstance(setting, Setting) else None
        if start is not None and detrend == "none":
            zero = start.u_offset, start.y_offset
            estimation = with_offsets(estimation, *zero)
            validation_part = estimation if plan.whole else with_offsets(validation_part, *zero)
        check_parts(estimation, validation_part)
        findings = advise(record.data)
        fitting()
        if isinstance(setting, Auto):
            selection, evaluation = _search(setting, estimation, validation_part, candidate, progress)
        else:
            selection, evaluation = None, evaluate(setting, estimation, validation_part, progress)
    except InputError as error:
        raise InputError(f"{name}: {error}") from None
    if detrend == "linear" or (preparation.filter or (None,))[0]:
        # No offset undoes a line or a high-pass filter: a raw record has to be prepared alike.
        evaluation = replace(evaluation, fit=replace(evaluation.fit, u_offset=None, y_offset=None))
    evaluation = named_channels(without_validation(evaluation) if plan.whole else evaluation, record.signals)
    plan = replace(plan, detrend="none" if evaluation.setting.recipe.zero else detrend)
    first, *further_files = map(str, record.paths)
    structure_and_fit = evaluation.setting.recipe, evaluation.judged_fit
    advice = tuple(
        a.of_file(first, (*(() if a.command == ("design",) else further_files), *record.options))
        for a in (advice_after_fit(a, *structure_and_fit) for a in findings)
    )
    result = Identification(record, plan, evaluation, advice, selection)
    return replace(result, next=next_step(result))


def _records(paths: Sequence[str | os.PathLike[str]], read: Callable[..., Record]) -> list[Record]:
    """The record of each file, or that of all where each holds one signal of it."""
    if len(paths) < 2:
        return [read(path) for path in paths]
    first = read_table(paths[0])
    if len(first.names) > COLUMNS:  # one after the other: long records have no room beside each other
        return [read(first), *(read(path) for path in paths[1:])]
    tables = [first, *(read_table(path) for path in paths[1:])]
    if (table := as_one(tables)) is not None:
        return [replace(read(table), beside=tuple(Path(path) for path in paths[1:]))]
    return [read(table) for table in tables]


def _check_once(paths: Sequence[str | os.PathLike[str]], validation: Sequence[str | os.PathLike[str]]) -> None:
    """Raises InputError for a file that is given twice: it would count double, or be no unseen data."""
    places: set[str] = set()
    for path in (*paths, *validation):
        place = os.path.realpath(path)  # `Path.resolve` raises for a link to itself
        if place in places:
            raise InputError(f"{path} is given twice; name each file once, for the fit or with --validation")
        places.add(place)


def _merge_prepared(records: Sequence[Record], absolute: bool, preparation: Preparation) -> Record:
    """The records as they are fitted, as the experiments of one."""
    if absolute:  # a structure of absolute angles
        records = [without_wraps(record) for record in records]
    return merge_records([prepare_record(record, preparation) for record in records], absolute)


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
