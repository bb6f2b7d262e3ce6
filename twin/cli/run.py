"""`qpal run`: one or several saved models on a record."""

from dataclasses import replace
from typing import Annotated, Any

import typer

from sysid.base.errors import InputError
from sysid.data.preprocess import DETREND
from sysid.formats import TABLE as FORMATS
from twin.cli import console, options
from twin.cli.output import run_folder

Files = Annotated[
    list[str],
    typer.Argument(
        metavar="MODEL... FILE", help=f"models as qpal identify writes them, then the record: {', '.join(FORMATS)}"
    ),
]
Detrend = Annotated[
    str, options.name("what to remove from the record, for a model whose file holds no offsets [none]", DETREND)
]
Resample = Annotated[bool, typer.Option("--resample", help="bring the record to the model's sampling time")]


def run(
    files: Files,
    horizon: Annotated[
        int | None, options.whole_number("K", "of one model: predict K samples ahead from measured outputs too")
    ] = None,
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
    """Run one or several saved models on a record.

    The report has their free runs and fits, and of several models a table and the best one. simulated.csv has the
    outputs of one model; a file with inputs alone is run from rest.

    The record stays raw: the model knows the offsets that were removed from its estimation data.

    Limit: passes over the record. Progress: each part.
    """
    *models, file = files
    if not models:
        raise InputError(f"only {file} is given; give one or more models and then the record")
    if horizon is not None and len(models) > 1:
        raise InputError(f"--horizon is given with {len(models)} models; give it with one, or leave it out")
    from sysid.report import saved_models as report
    from sysid.report import saved_models_parts as parts
    from sysid.report.page import write
    from sysid.workflow.model_run import run_file, run_models, write_outputs
    from sysid.workflow.saved import Reading, check_order

    check_order(models, file)
    window = options.time_range(range)
    reading = Reading(file, input, output, ts, time, time_unit, map, window, detrend, resample)
    result: Any
    views: Any = (report.run_page, parts.run_tables, report.run_sentences)
    with run_folder(out, "run") as (folder, scratch), console.progress(3) as step:
        step(f"reading {file}")
        if len(models) > 1:
            result = run_models(models, reading)
            views = (report.models_page, parts.models_tables, report.models_sentences)
        else:
            result = run_file(models[0], reading, horizon, lambda: step("running the model"))
            write_outputs(result, scratch / "simulated.csv")
        step("drawing")
        make_page, tables, sentences = views
        page = make_page(result)
        write(scratch, page, result.as_dict())
    answer = replace(page.answer, values=None)  # the table below has all models or outputs
    console.finish(folder, result.as_dict(), as_json, tables(result), sentences(result), answer)
