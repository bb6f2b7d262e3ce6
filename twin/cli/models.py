"""`qpal models`: several saved models on one record."""

from typing import Annotated

import typer

from sysid.base.errors import InputError
from sysid.formats import TABLE as FORMATS
from twin.cli import console, options
from twin.cli.output import run_folder
from twin.cli.run import Detrend, Resample

Files = Annotated[
    list[str],
    typer.Argument(
        metavar="MODEL... FILE", help=f"models as qpal identify writes them, then the record: {', '.join(FORMATS)}"
    ),
]


def models(
    files: Files,
    input: options.Input = None,
    output: options.Output = None,
    ts: options.Ts = None,
    time: options.Time = None,
    time_unit: options.TimeUnit = None,
    map: options.Map = None,
    range: options.Range = None,
    detrend: Detrend = "none",
    resample: Resample = False,
    out: options.Out = None,
    as_json: options.Json = False,
) -> None:
    """Compare saved models on one record.

    The report has their free runs in one figure, a table, and the best one.

    Limit: passes over the record. Progress: each part.
    """
    *paths, file = files
    if not paths:
        raise InputError(f"only {file} is given; give one or more models and then the record")
    from sysid.report import saved_models as report
    from sysid.report.page import write
    from sysid.workflow.model_run import run_models
    from sysid.workflow.saved import Reading, check_order

    check_order("models", paths, file)
    window = options.time_range(range)
    reading = Reading(file, input, output, ts, time, time_unit, map, window, detrend, resample)
    with run_folder(out, "models") as (folder, scratch), console.progress(2) as step:
        step(f"running {len(paths)} model(s) on {file}")
        result = run_models(paths, reading)
        step("drawing")
        write(scratch, report.models_page(result), result.as_dict())
    console.finish(folder, result.as_dict(), as_json, report.models_tables(result), report.models_sentences(result))
