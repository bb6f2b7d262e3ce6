"""`qpal export`: a fitted model as C, Python or MJCF."""

from pathlib import Path
from typing import Annotated

import typer

from sysid.base.errors import InputError
from twin.cli import console, options
from twin.cli.output import run_folder

Model = Annotated[
    str, typer.Argument(metavar="MODEL", help="model.json of a fit, or, for --mjcf, a log that a joint is fitted to")
]


def export(
    model: Model,
    mjcf: Annotated[bool, typer.Option("--mjcf", help="an actuated joint as elements of a MuJoCo model")] = False,
    c: Annotated[bool, typer.Option("--c", help="C99 source")] = False,
    python: Annotated[bool, typer.Option("--python", help="a Python module that imports only math")] = False,
    name: Annotated[str, typer.Option(metavar="NAME", help="name of the joint or of the exported functions")] = "joint",
    into: Annotated[
        str | None, typer.Option(metavar="FILE.xml", help="your MuJoCo model; its hinge NAME takes the joint's place")
    ] = None,
    torque_per_volt: Annotated[
        float | None,
        options.number("NM/V", "torque at the joint per volt of the standing motor, from its data sheet [1]"),
    ] = None,
    link_inertia: Annotated[
        float, options.number("KGM2", "inertia of your model's link about the joint, which the fitted lag holds too")
    ] = 0.0,
    input: options.Input = None,
    output: options.Output = None,
    ts: options.Ts = None,
    time: options.Time = None,
    map: options.Map = None,
    out: options.Out = None,
    as_json: options.Json = False,
) -> None:
    """Write a fitted model as C99, as Python, or as MJCF that is checked in MuJoCo against the fit."""
    asked = [way for way, given in (("mjcf", mjcf or into is not None), ("c", c), ("python", python)) if given]
    if not asked:
        raise InputError("nothing to export to; add --mjcf, --c or --python")
    from sysid.report.page import write
    from twin.report import export as report
    from twin.studies.write_back import read_model, write_back

    with run_folder(out, "export") as (folder, scratch), console.progress(3) as step:
        step(f"reading {model}")
        source = read_model(model, input, output, ts, time, map, fitted=asked == ["mjcf"])
        step("exporting")
        inside = None if into is None else Path(into)
        result = write_back(source, asked, name, torque_per_volt, link_inertia, inside, scratch)
        step("drawing")
        write(scratch, report.page(result), result.as_dict())
    console.finish(folder, result.as_dict(), as_json, report.tables(result), report.sentences(result))
