"""`qpal calibrate`: the twin's parameters from logs of the leg."""

import shlex
from pathlib import Path
from typing import Annotated

import typer

import twin
from twin.cli import console, options
from twin.cli.output import run_folder
from twin.hardware.potentiometer import SIDES
from twin.parameters import REALISATIONS

STEPS = 24  # of the progress bar; a search rarely has more


def calibrate(
    files: Annotated[list[str], typer.Argument(metavar="FILE...", help="logs of the joint to calibrate from")],
    joint: Annotated[str, options.name("which", twin.JOINTS)] = "thigh",
    free: Annotated[
        str | None,
        typer.Option(metavar="A,B", help="parameters to calibrate; those that logs usually tell, if not given"),
    ] = None,
    fix: Annotated[str, typer.Option(metavar="A,B", help="parameters whose values are known")] = "",
    by_run: Annotated[
        str, typer.Option(metavar="A,B", help="parameters, or the sensor's zero, with a value of their own in each log")
    ] = "",
    hold_out: Annotated[
        str, typer.Option(metavar="FILE,FILE", help="logs that are not used, to score the calibrated twin")
    ] = "",
    without: Annotated[
        str, typer.Option(metavar="A,B", help=f"imperfections to leave out, of {', '.join(twin.IMPERFECTIONS)}")
    ] = "",
    pot_side: Annotated[str, options.name("side of the backlash on which the potentiometer sits", SIDES)] = "link",
    realisation: Annotated[str, options.name("how the linear actuators are modelled", REALISATIONS)] = "tendon",
    params: options.Params = None,
    map: options.Map = None,
    seed: Annotated[int, options.whole_number("N", "of the drawn starts")] = 0,
    seconds: options.Budget = None,
    out: options.Out = None,
    as_json: options.Json = False,
) -> int:
    """Fit the twin's parameters to logs of the leg.

    They are written, with intervals, as a file for --params.

    Limit: 2 descents of at most 30 steps each. Progress: each step. Budget: --seconds.
    """
    limit = options.budget(seconds)
    from sysid.report.page import write
    from twin.calibrate import advice
    from twin.calibrate.calibration import calibrate as run
    from twin.report import calibrate as report

    held_out = options.names(hold_out)
    logs = {file: twin.Log.load(file, map, joint) for file in (*files, *held_out)}
    with run_folder(out, "calibrate") as (folder, scratch), console.progress(STEPS, lines=not as_json) as step:
        result = run(
            [logs[file] for file in files],
            joint,
            options.parameters(params),
            None if free is None else options.names(free),
            options.names(fix),
            [logs[file] for file in held_out],
            options.names(without),
            pot_side,
            realisation,
            seed=options.seed(seed),
            labels=[Path(file).name for file in (*files, *held_out)],
            progress=step,
            seconds=limit,
            by_run=options.names(by_run),
        )
        target = folder / f"{joint}.toml"
        summary = {"file": str(target), **result.as_dict()}
        write(scratch, report.page(result), summary)
        advice.write(result, scratch / target.name)
    sentences = [*report.sentences(result), *report.undetermined_sentences(result), f"Parameters: {target}"]
    next_step = advice.next_step(result, shlex.join(files)) or (
        f"Next: qpal simulate --joint {joint} --params {target}, or qpal compare LOG --params {target}"
    )
    sentences += [] if result.differing else [next_step]  # a value that differs between logs comes first
    console.finish(folder, summary, as_json, report.tables(result), sentences)
    return 0 if result.converged and not advice.useless(result) else 1
