"""`qpal identify`: fit a model to a recorded file."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from sysid import structures
from sysid.base.errors import InputError
from sysid.data.preprocess import DETREND
from sysid.solver import searches
from twin.cli import console, options, recipes
from twin.cli.output import run_folder

if TYPE_CHECKING:
    from sysid.workflow.evaluation import Setting
    from sysid.workflow.identification import Auto

AUTO = "auto"
SHARES = (0.03, 0.92, 0.05)  # of the time: reading, fitting, drawing
ROUNDS = 6  # of a structure search, about
SECONDS = 110.0  # `sysid.selection.select.SECONDS`, whose import would cost the help text its speed


@recipes.takes_recipes
def identify(
    file: options.RecordFile,
    input: options.Input = None,
    output: options.Output = None,
    ts: options.Ts = None,
    time: options.Time = None,
    time_unit: options.TimeUnit = None,
    map: options.Map = None,
    range: options.Range = None,
    structure: Annotated[
        str, options.name("structure of the model; auto searches for one", [*structures.TABLE, AUTO])
    ] = recipes.DEFAULT,
    search: Annotated[str, options.name("search method", searches.TABLE)] = "auto",
    split: Annotated[
        float, options.number("PART", "share of the record used as estimation data, from its start")
    ] = 0.5,
    detrend: Annotated[
        str | None, options.name(f"what to remove [mean; none of {recipes.counted_from_zero()}]", DETREND)
    ] = None,
    starts: Annotated[int, options.whole("N", "number of starting points")] = 5,
    seed: Annotated[int, options.whole("N", "seed of the random starting points")] = 0,
    resume: Annotated[
        str | None, typer.Option(metavar="FILE", help="journal of --structure auto; a stopped search continues from it")
    ] = None,
    seconds: Annotated[float | None, options.number("S", f"budget of --structure auto [{SECONDS:g}]")] = None,
    scheduler: options.Scheduler = None,
    out: options.Out = None,
    as_json: options.Json = False,
    **settings: Any,
) -> None:
    """Fit a model to a recorded file and write a report.

    Columns and units are detected where that is beyond doubt; qpal info FILE shows how a file is read.
    """
    setting = _setting(structure, settings, search, starts, options.seed(seed), resume, seconds, scheduler)
    from sysid.report import identify as report
    from sysid.report.page import write
    from sysid.workflow.exports import export
    from sysid.workflow.identification import identify_file

    with run_folder(out, "identify") as (folder, scratch), console.progress(3, SHARES, not as_json) as step:
        step(f"reading {file}")
        rounds = console.Rounds(step, ROUNDS, getattr(setting, "seconds", 0.0))

        def fitting() -> None:
            step("fitting")
            if structure == AUTO:
                rounds.begin()

        try:
            result = identify_file(
                file,
                setting,
                input,
                output,
                ts,
                time,
                split,
                detrend,
                fitting,
                candidate=rounds,
                mapping=map,
                range=options.time_range(range),
                time_unit=time_unit,
                progress=console.Searches(step),
            )
        except KeyboardInterrupt:
            if resume is None:
                raise
            raise console.Stopped(f"run it again with --resume {resume} to continue from there") from None
        step("drawing")
        exports = export(result.evaluation, scratch)
        write(scratch, report.page(result, exports), result.as_dict())
    console.finish(folder, result.as_dict(), as_json, report.terminal_tables(result), report.terminal_sentences(result))


def _setting(
    structure: str,
    settings: dict[str, Any],
    search: str,
    starts: int,
    seed: int,
    resume: str | None,
    seconds: float | None,
    scheduler: str | None,
) -> "Setting | Auto":
    from sysid.workflow.evaluation import Setting
    from sysid.workflow.identification import Auto

    if structure == AUTO:
        recipes.none_given(settings, AUTO)
        journal = None if resume is None else Path(resume)
        return Auto(search, starts, seed, journal, scheduler, SECONDS if seconds is None else seconds)
    if resume is not None:
        raise InputError(f"--resume is given with --structure {structure}; only --structure {AUTO} keeps a journal")
    if seconds is not None:
        raise InputError(f"--seconds is given with --structure {structure}; only --structure {AUTO} has a budget")
    if scheduler is not None:
        raise InputError(f"--scheduler is given with --structure {structure}; only --structure {AUTO} has jobs for it")
    return Setting(recipes.recipe(structure, settings), search, starts, seed)
