"""`qpal info`: the twin's parameters, their sources, and the true properties of each joint."""

from pathlib import Path
from typing import Annotated

import typer

import twin
from twin.cli import console, options
from twin.cli.output import check_writable_file, run_folder


def info(
    joint: Annotated[str | None, options.name("one joint; all joints if not given", twin.JOINTS)] = None,
    ts: Annotated[float, options.number("S", "sampling time of the truth in seconds")] = 0.1,
    params: options.Params = None,
    write_params: Annotated[
        str | None, typer.Option(metavar="FILE", help="write all parameters to a .toml or .json file for editing")
    ] = None,
    signatures: Annotated[
        bool,
        typer.Option(
            "--signatures", help="show the effect and measured size of each imperfection; takes ten seconds more"
        ),
    ] = False,
    out: options.Out = None,
    as_json: options.Json = False,
) -> None:
    """Show the twin's parameters with their sources, and the true values that an identification should find."""
    from sysid.report.page import write
    from twin import parameter_file
    from twin.report import info as report
    from twin.report import signatures as drawn
    from twin.signatures import TABLE as SIGNATURES
    from twin.signatures import signatures as measured
    from twin.studies.information import inform

    parameters = options.parameters(params) or twin.Parameters()
    target = None if write_params is None else Path(write_params)
    if target is not None:
        parameter_file.check_suffix(target)
    with (
        run_folder(out, "info") as (folder, scratch),
        console.progress(2 + len(SIGNATURES) * signatures) as step,
    ):
        inside = target is not None and target.parent.resolve() == folder.resolve()
        if target is not None and not inside:
            check_writable_file(target)
        step("linearising the joints")
        result = inform(joint, ts, parameters, params)
        found = measured(parameters, lambda name: step(f"signature of {name}")) if signatures else ()
        step("drawing")
        summary = result.as_dict() | ({"signatures": [one.as_dict() for one in found]} if found else {})
        write(scratch, report.page(result, [drawn.section(found)] if found else []), summary)
        if target is not None:
            parameter_file.write(parameters, scratch / target.name if inside else target, all=True)
    said = report.verdict(result) + ([] if target is None else [f"Parameters: {target}"])
    *tables, made_with = report.terminal_tables(result)
    tables += [drawn.sizes(found)] if found else []
    console.finish(folder, summary, as_json, [*tables, made_with], said)
