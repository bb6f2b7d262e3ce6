"""`qpal run`: a saved model on a new record."""

from typing import Annotated

import typer

from sysid.data.preprocess import DETREND
from twin.cli import console, options
from twin.cli.output import run_folder

ModelFile = Annotated[str, typer.Argument(metavar="MODEL", help="model.json of a fit, as qpal identify writes it")]
Detrend = Annotated[
    str, options.name("what to remove from the record, for a model whose file holds no offsets [none]", DETREND)
]
Resample = Annotated[bool, typer.Option("--resample", help="bring the record to the model's sampling time")]


def run(
    model: ModelFile,
    file: options.RecordFile,
    horizon: Annotated[
        int | None, options.whole_number("K", "predict K samples ahead from measured outputs too, beside the free run")
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
    """Run a saved model on a new record.

    The report has its free run and its fit; simulated.csv has the outputs. A file with inputs alone is run from rest.

    The record stays raw: the model knows the offsets that were removed from its estimation data.

    Limit: passes over the record. Progress: each part.
    """
    from sysid.report import saved_models as report
    from sysid.report.page import write
    from sysid.workflow.model_run import run_file, write_outputs
    from sysid.workflow.saved import Reading, check_order

    check_order("run", [model], file)
    window = options.time_range(range)
    reading = Reading(file, input, output, ts, time, time_unit, map, window, detrend, resample)
    with run_folder(out, "run") as (folder, scratch), console.progress(3) as step:
        step(f"reading {file}")
        result = run_file(model, reading, horizon, lambda: step("running the model"))
        step("drawing")
        write_outputs(result, scratch / "simulated.csv")
        write(scratch, report.run_page(result), result.as_dict())
    console.finish(folder, result.as_dict(), as_json, report.run_tables(result), report.run_sentences(result))
