"""`qpal design`: the next experiment on a joint, from a first log."""

from typing import Annotated

import typer

from sysid.base.errors import InputError
from twin.cli import console, options
from twin.cli.output import run_folder

TARGETS = ("ends", "breakaway", "backlash")  # `sysid.joint.design.TARGETS`, whose import would slow the help text down

SHARES = (0.05, 0.85, 0.1)  # of the time: reading, fitting and designing, drawing


def design(
    file: options.RecordFile,
    targets: Annotated[
        str, typer.Option("--for", metavar="A,B", help=f"what the experiment shall show, of {', '.join(TARGETS)}")
    ] = ",".join(TARGETS),
    volts: Annotated[float | None, options.number("V", "largest input; that of the log if not given")] = None,
    strike: Annotated[
        float | None,
        options.number("SPEED", "largest speed, also at an end, in the unit of the output's column per second"),
    ] = None,
    sample: Annotated[
        float | None,
        options.number("S", "sampling time of the next record [s]; by the lag and delay of the joint if not given"),
    ] = None,
    to_stops: Annotated[
        bool, typer.Option("--to-stops", help="the joint has a stop each way and may run into it, seen before or not")
    ] = False,
    for_use: Annotated[
        str | None,
        typer.Option(
            "--for-use", metavar="FILE", help="the input that the joint will get: what shrinks its error there"
        ),
    ] = None,
    input: options.Input = None,
    output: options.Output = None,
    ts: options.Ts = None,
    time: options.Time = None,
    time_unit: options.TimeUnit = None,
    map: options.Map = None,
    range: options.Range = None,
    seed: Annotated[int, options.whole_number("N", "seed of the drawn levels")] = 0,
    seconds: options.Budget = None,
    out: options.Out = None,
    as_json: options.Json = False,
) -> None:
    """Design the next experiment on an actuated joint.

    design.csv has the input and the predicted output.

    Limit: the searches of a joint. Progress: each search. Budget: --seconds.
    """
    names = options.names(targets)
    for name in names:
        if name not in TARGETS:
            raise InputError(f"--for has {name!r}; give some of {', '.join(TARGETS)}")
    limit = options.budget(seconds)
    from sysid.report import design as report
    from sysid.report.page import write
    from sysid.workflow.design import propose, write_input

    with run_folder(out, "design") as (folder, scratch), console.progress(3, SHARES, not as_json) as step:
        step(f"reading {file}")
        result = propose(
            file,
            names,
            volts,
            strike,
            options.seed(seed),
            sample,
            to_stops,
            for_use,
            lambda: step("fitting the joint and designing"),
            console.Searches(step),
            limit,
            input=input,
            output=output,
            Ts=ts,
            time=time,
            time_unit=time_unit,
            mapping=map,
            range=options.time_range(range),
        )
        step("drawing")
        write_input(result, scratch / "design.csv")
        target = str(folder / "design.csv")
        page = report.page(result, target)
        write(scratch, page, result.as_dict())
    tables, sentences = report.tables(result), report.sentences(result, target)[1:]  # the answer says the first
    console.finish(folder, result.as_dict(), as_json, tables, sentences, page.answer)
