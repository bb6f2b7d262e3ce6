"""`qpal export`: a fitted model as C, Python, MATLAB, MJCF or a linear model."""

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
    matlab: Annotated[bool, typer.Option("--matlab", help="a MATLAB function file, which GNU Octave runs too")] = False,
    control: Annotated[
        bool, typer.Option("--control", help="a Python file with the linear model as a control.TransferFunction")
    ] = False,
    at: Annotated[
        float | None,
        options.number(
            "U", "input of the operating point of --control; the middle of the estimation data if not given"
        ),
    ] = None,
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
    """Write a fitted model as code, linear model, or MJCF.

    The code is C99, Python or MATLAB; the MJCF is checked against the fit.

    The files take and give raw units: they remove the offsets that were removed before the fit.

    Limit: a pass; of a log a joint grows first: identify --seconds and export its model where that is long.
    Progress: each part.
    """
    flags = {"mjcf": mjcf or into is not None, "c": c, "python": python, "matlab": matlab, "control": control}
    ways = [way for way, flag in flags.items() if flag]
    if not ways:
        raise InputError("nothing to export to; add --mjcf, --c, --python, --matlab or --control")
    if at is not None and not control:
        raise InputError("--at is given without --control; add --control or leave it out")
    from sysid.report.page import write
    from twin.report import export as report
    from twin.studies.write_back import read_model, write_back

    with run_folder(out, "export") as (folder, scratch), console.progress(3) as step:
        step(f"reading {model}")
        source = read_model(model, input, output, ts, time, map, fitted=ways == ["mjcf"])
        step("exporting")
        target = None if into is None else Path(into)
        result = write_back(source, ways, name, torque_per_volt, link_inertia, target, scratch, at)
        step("drawing")
        write(scratch, report.page(result), result.as_dict())
    console.finish(folder, result.as_dict(), as_json, report.tables(result), report.sentences(result))
