"""`qpal identify`: fit a model to recorded files."""

import shlex
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from sysid import structures
from sysid.base.errors import InputError, unknown
from sysid.data.preparation import MISSING
from sysid.data.preprocess import DETREND, ZERO
from sysid.solver import searches
from twin.cli import console, options, recipes
from twin.cli.output import run_folder

if TYPE_CHECKING:
    from sysid.data.frequency import FrequencyData
    from sysid.workflow.identification import Auto
    from sysid.workflow.setting import Held, Setting

AUTO = "auto"
STARTS = 5
SHARES = (0.03, 0.92, 0.05)  # of the time: reading, fitting, drawing
ROUNDS = 6  # of a structure search, about
SECONDS = 110.0  # `sysid.selection.table.SECONDS`, whose import would cost the help text its speed


_SHOWN = ("input", "output", "ts", "time", "map", "range", "validation", "structure", "orders", "starts", "split")


@options.shows(*_SHOWN, "resample", "start", "out", "as_json", more=recipes.settings_of)
@recipes.takes_recipes
def identify(
    files: options.RecordFiles,
    input: options.Input = None,
    output: options.Output = None,
    ts: options.Ts = None,
    time: options.Time = None,
    time_unit: options.TimeUnit = None,
    map: options.Map = None,
    range: options.Range = None,
    validation: Annotated[
        list[str] | None,
        typer.Option(metavar="FILE", help="records for validation; all of the others is for the fit then (repeatable)"),
    ] = None,
    missing: Annotated[str, options.name("outputs without a value, such as empty cells", MISSING)] = "mark",
    resample: Annotated[float | None, options.number("S", "new sampling time in seconds")] = None,
    filter: Annotated[
        str | None, typer.Option(metavar="LOW:HIGH", help="frequencies to keep, in Hz; either may be left out")
    ] = None,
    structure: Annotated[
        str | None,
        options.name(f"structure of the model; auto searches for one [{recipes.DEFAULT}]", [*structures.TABLE, AUTO]),
    ] = None,
    fix: Annotated[
        list[str] | None,
        typer.Option(metavar="ROLE.NAME=VALUE", help="hold a parameter; ROLE alone: a block, at --from (repeatable)"),
    ] = None,
    bound: Annotated[
        list[str] | None, typer.Option(metavar="ROLE.NAME=LOW:HIGH", help="bounds of a parameter (repeatable)")
    ] = None,
    start: Annotated[
        str | None,
        typer.Option(
            "--from", metavar="MODEL.json", help="continue from a saved model, or give a linear one static maps"
        ),
    ] = None,
    search: Annotated[str, options.name("search method", searches.TABLE)] = "auto",
    split: Annotated[
        float | None, options.number("PART", "share of the record used as estimation data, from its start [0.5]")
    ] = None,
    detrend: Annotated[
        str | None, options.name("what to remove [none: the zero of the output is a parameter]", DETREND)
    ] = None,
    zero: Annotated[
        str | None, options.name("zero of the signals: their mean, or the level before the first movement", ZERO)
    ] = None,
    starts: Annotated[int | None, options.whole_number("N", f"number of starting points [{STARTS}]")] = None,
    seed: Annotated[int, options.whole_number("N", "seed of the random starting points")] = 0,
    knots: Annotated[
        int | None, options.whole_number("N", "break points of a piecewise linear map; 0: ten free ones [50]")
    ] = None,
    resume: Annotated[
        str | None, typer.Option(metavar="FILE", help="journal of --structure auto; a stopped search continues from it")
    ] = None,
    seconds: Annotated[
        float | None,
        options.number("S", f"budget of the search, which ends with the best so far [none; auto {SECONDS:g}]"),
    ] = None,
    scheduler: options.Scheduler = None,
    trials: Annotated[
        float | None,
        options.number("S", "seconds in which next steps are tried; 0: none [as long as the fit, at least 2]"),
    ] = None,
    out: options.Out = None,
    as_json: options.Json = False,
    **settings: Any,
) -> None:
    """Fit a model to recorded files and write a report.

    Columns and units are detected where that is beyond doubt; qpal info FILE shows how a file is read.

    Limit: starts, and iterations of each. Progress: each search. Budget: --seconds; 110 s for --structure auto.
    """
    if structure != AUTO and start is None:
        _compile_ahead(structure or recipes.DEFAULT, settings)
    response = _frequency_data(files, ts, is_record=ts is not None and input is not None and output is not None)
    if response is not None:
        of_records = (
            {"input": input, "output": output, "time": time, "time-unit": time_unit, "map": map, "range": range}
            | {"validation": validation, "resample": resample, "filter": filter, "split": split, "detrend": detrend}
            | {
                "zero": zero,
                "starts": starts,
                "resume": resume,
                "seconds": seconds,
                "trials": trials,
                "scheduler": scheduler,
            }
        )
        _refuse_options_of_records(files, of_records)
        structure = structure or "process"
    constraints = _constraints(fix or (), bound or (), start)
    steps = (search, starts, options.seed(seed), knots)
    if trials is not None and not trials >= 0.0:
        raise InputError(f"--trials is {trials:g}; give seconds, 0 to try nothing, or leave it out")
    setting = _setting(structure, settings, steps, constraints, resume, seconds, scheduler)
    if response is not None:
        _identify_response(files[0], response, setting, out, as_json)
        return
    from sysid.data.preparation import Preparation
    from sysid.report import identify as report
    from sysid.report.page import write
    from sysid.workflow.identification import identify_file
    from sysid.workflow.plan import paths_from
    from sysid.workflow.saved import MODEL_FILE, export

    preparation = Preparation(missing=missing, resample=resample, filter=options.band(filter))
    with (
        console.goes_on(resume),
        run_folder(out, "identify") as (folder, scratch),
        console.progress(3, SHARES, not as_json) as step,
    ):
        step(f"reading {', '.join(files)}")
        rounds = console.Rounds(step, ROUNDS, getattr(setting, "seconds", 0.0))

        def fitting() -> None:
            step("fitting")
            if structure == AUTO:
                rounds.begin()

        result = identify_file(
            files,
            setting,
            input,
            output,
            ts,
            time,
            split,
            _detrend(detrend, zero),
            fitting,
            candidate=rounds,
            mapping=map,
            range=options.time_range(range),
            time_unit=time_unit,
            progress=console.Searches(step),
            validation=paths_from(validation or ()),
            preparation=preparation,
            trials=trials,
        )
        step("drawing")
        exports = export(result.evaluation, scratch, result.record.signals)
        page = report.page(result, exports, shlex.quote(str(folder / MODEL_FILE[0])))
        write(scratch, page, result.as_dict())
    tables, sentences = report.terminal_tables(result), report.terminal_sentences(result)
    console.finish(folder, result.as_dict(), as_json, tables, sentences, page.answer)


def _compile_ahead(structure: str, settings: dict[str, Any]) -> None:
    """What the structure needs is compiled while the rest of the program is loaded, a second and more of a core."""
    from sysid.block.ahead import compile_ahead

    with suppress(InputError):  # said where the setting is made
        compile_ahead(recipes.recipe(structure, settings).blocks_to_compile())


def _frequency_data(files: Sequence[str], ts: float | None, is_record: bool) -> "FrequencyData | None":
    """The frequency response in the first file, None for records; raises InputError for more files than that one.

    A file that only seems to be a response is a record where the options say that it `is_record`.
    """
    from sysid.workflow.frequency import read_frequency

    data = read_frequency(files[0], ts, is_record)
    if data is not None and len(files) > 1:
        raise InputError(f"{files[0]} holds a frequency response, and {len(files)} files are given; give one")
    return data


def _refuse_options_of_records(files: Sequence[str], given: dict[str, Any]) -> None:
    """Raises InputError for options that a frequency response has no use for."""
    if named := [f"--{name}" for name, value in given.items() if value is not None]:
        what = "is an option of records" if len(named) == 1 else "are options of records"
        raise InputError(f"{files[0]} holds a frequency response, and {', '.join(named)} {what}; leave that out")


def _identify_response(file: str, data: "FrequencyData", setting: Any, out: str | None, as_json: bool) -> None:
    """Fit a frequency response and write its report."""
    from sysid.report import frequency as report
    from sysid.report.page import write
    from sysid.workflow.frequency import identify_frequency
    from sysid.workflow.saved import MODEL_FILE

    with run_folder(out, "identify") as (folder, scratch), console.progress(2, (0.7, 0.3), not as_json) as step:
        step("fitting")
        result = identify_frequency(file, data, setting)
        step("drawing")
        result.result.fit.save(scratch / MODEL_FILE[0])
        page = report.page(result, [MODEL_FILE], shlex.quote(str(folder / MODEL_FILE[0])))
        write(scratch, page, result.as_dict())
    console.finish(folder, result.as_dict(), as_json, [], report.sentences(result), page.answer)


def _detrend(detrend: str | None, zero: str | None) -> str | None:
    """What to remove, of two options that say it; --zero names the level, --detrend also lines and nothing."""
    if zero is not None and zero not in ZERO:
        raise unknown("zero", zero, ZERO)
    if detrend is not None and zero is not None and detrend != zero:
        raise InputError(f"--detrend is {detrend} and --zero is {zero}; leave one of the two out")
    return detrend or zero


def _constraints(fix: Sequence[str], bound: Sequence[str], start: str | None) -> "Held":
    from sysid.workflow.setting import Held, read_start

    start_fit = None if start is None else read_start(start)
    return Held(
        options.fixed_parameters(fix),
        options.parameter_bounds(bound),
        start_fit,
        None if start is None else Path(start),
    )


def _setting(
    structure: str | None,
    settings: dict[str, Any],
    steps: tuple[str, int | None, int, int | None],
    constraints: "Held",
    resume: str | None,
    seconds: float | None,
    scheduler: str | None,
) -> "Setting | Auto":
    """How to fit, or how to search a structure; raises InputError for options that do not go together."""
    from sysid.estimation.objective import Objective
    from sysid.workflow.identification import Auto
    from sysid.workflow.setting import Setting

    search, starts, seed, knots = steps
    limit = options.budget(seconds)
    count = STARTS if starts is None else starts
    if structure == AUTO:
        recipes.refuse_settings(settings, AUTO)
        if constraints:
            raise InputError(
                f"--fix, --bound and --from are of one structure, and --structure {AUTO} searches it; leave them out "
                "or name a structure"
            )
        if knots is not None:
            raise InputError(f"--knots is of one structure, and --structure {AUTO} searches it; leave --knots out")
        journal = None if resume is None else Path(resume)
        return Auto(search, count, seed, journal, scheduler, SECONDS if seconds is None else seconds)
    verb_text = f"--structure {structure or recipes.DEFAULT}; only --structure {AUTO}"
    if resume is not None:
        raise InputError(f"--resume is given with {verb_text} keeps a journal")
    if scheduler is not None:
        raise InputError(f"--scheduler is given with {verb_text} has jobs for it")
    count_of_knots = Objective.knots if knots is None else knots
    if constraints.start is None:
        recipe = recipes.recipe(structure or recipes.DEFAULT, settings)
        return Setting(recipe, search, count, seed, constraints, limit, count_of_knots)
    if starts is not None:
        raise InputError("--starts and --from are given; a saved fit is the only start: leave one of the two out")
    structure = structure or constraints.start.model.structure
    recipe = recipes.recipe(structure, settings, constraints.start)
    return Setting(recipe, search, 1, seed, constraints, limit, count_of_knots)
