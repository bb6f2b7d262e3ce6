"""`qpal export`: a fitted model as C, FMU, Python, MATLAB, ONNX, Modelica, MJCF or a linear model."""

from pathlib import Path
from typing import Annotated

import typer

from sysid.base.errors import InputError
from twin.cli import console, options
from twin.cli.output import run_folder

Model = Annotated[
    str, typer.Argument(metavar="MODEL", help="model.json of a fit, or, for --mjcf, a log that a joint is fitted to")
]

FMI = {"3": "3.0", "2": "2.0"}


def export(
    model: Model,
    mjcf: Annotated[bool, typer.Option("--mjcf", help="an actuated joint as elements of a MuJoCo model")] = False,
    c: Annotated[bool, typer.Option("--c", help="C99: NAME.h and NAME.c")] = False,
    single: Annotated[bool, typer.Option("--single", help="the C of --c in single precision")] = False,
    fmu: Annotated[bool, typer.Option("--fmu", help="an FMU for Simulink, Modelica tools, FMPy and others")] = False,
    fmi: Annotated[str, typer.Option(metavar="3|2", help="version of --fmu: FMI 3.0 or 2.0")] = "3",
    python: Annotated[bool, typer.Option("--python", help="a Python module that imports only math")] = False,
    matlab: Annotated[bool, typer.Option("--matlab", help="a MATLAB function file, which GNU Octave runs too")] = False,
    onnx: Annotated[bool, typer.Option("--onnx", help="an ONNX graph, for onnxruntime and others")] = False,
    modelica: Annotated[bool, typer.Option("--modelica", help="a Modelica model that needs no library")] = False,
    control: Annotated[
        bool, typer.Option("--control", help="a Python file with the linear model as a control.TransferFunction")
    ] = False,
    at: Annotated[
        float | None,
        options.number(
            "U", "input of the operating point of --control; the middle of the estimation data if not given"
        ),
    ] = None,
    name: Annotated[
        str | None,
        typer.Option(metavar="NAME", help="name of the functions (the model's structure if not given) or of the joint"),
    ] = None,
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

    The code is C99, an FMU, Python, MATLAB, ONNX or Modelica; the MJCF is checked against the fit.

    The files take and give the units in their header (SI), at the levels of the record.

    Limit: a pass; of a log a joint grows first: identify --seconds and export its model where that is long.
    Progress: each part.
    """
    flags = {"mjcf": mjcf or into is not None, "c": c, "fmu": fmu, "python": python, "matlab": matlab}
    flags |= {"onnx": onnx, "modelica": modelica, "control": control}
    ways = [way for way, flag in flags.items() if flag]
    if not ways:
        raise InputError(
            "nothing to export to; add --mjcf, --c, --fmu, --python, --matlab, --onnx, --modelica or --control"
        )
    for option, given, way in (
        ("--at", at is not None, "control"),
        ("--single", single, "c"),
        ("--fmi", fmi != "3", "fmu"),
    ):
        if given and not flags[way]:
            raise InputError(f"{option} is given without --{way}; add --{way} or leave it out")
    if fmi not in FMI:
        raise InputError(f"--fmi is {fmi}; choose one of {', '.join(FMI)}")
    from sysid.report.answer import MOST
    from sysid.report.page import write
    from twin.report import export as report
    from twin.studies.write_back import read_model, write_back

    with run_folder(out, "export") as (folder, scratch), console.progress(3) as step:
        step(f"reading {model}")
        source = read_model(model, input, output, ts, time, map, fitted=ways == ["mjcf"])
        step("exporting")
        target = None if into is None else Path(into)
        result = write_back(source, ways, name, torque_per_volt, link_inertia, target, scratch, at, single, FMI[fmi])
        step("drawing")
        page = report.page(result, str(folder))
        write(scratch, page, result.as_dict())
    tables = report.tables(result) if len(result.files) > MOST else []  # else the answer has them
    first = "" if page.answer is None else page.answer.sentence  # which is said above
    sentences = [said for said in report.sentences(result) if said != first]
    console.finish(folder, result.as_dict(), as_json, tables, sentences, page.answer)
