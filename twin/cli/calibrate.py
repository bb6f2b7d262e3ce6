"""`qpal calibrate`: the twin's parameters from logs of the leg, or those of a user's MJCF from logs of its joints."""

import shlex
from dataclasses import replace
from pathlib import Path
from typing import Annotated

import typer

import twin
from twin.cli import console, options
from twin.cli.output import run_folder
from twin.hardware.potentiometer import SIDES
from twin.parameters import REALISATIONS

STEPS = 24  # of the progress bar; a search rarely has more
RIVALS = 24  # further ones with several logs: searches with a value of its own in each
JOINT = "thigh"  # where neither a joint nor a model is named


def calibrate(
    files: Annotated[list[str], typer.Argument(metavar="FILE...", help="logs of the joint to calibrate from")],
    joint: Annotated[str | None, options.name(f"which, {JOINT} if not given", twin.JOINTS)] = None,
    model: options.Model = None,
    actuator: options.Actuator = "",
    input: options.Input = None,
    output: options.Output = None,
    free: Annotated[
        str | None,
        typer.Option(
            metavar="A,B",
            help="parameters to calibrate; those that logs usually tell, if not given. With --model, of armature, "
            "damping, frictionloss, delay, bias (these are usual), kp, kv, gain, backlash",
        ),
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
    pot_side: Annotated[
        str | None, options.name("side of the backlash on which the potentiometer sits, link if not given", SIDES)
    ] = None,
    realisation: Annotated[
        str | None, options.name("how the linear actuators are modelled, tendon if not given", REALISATIONS)
    ] = None,
    params: options.Params = None,
    map: options.Map = None,
    seed: Annotated[int, options.whole_number("N", "of the drawn starts")] = 0,
    seconds: options.Budget = None,
    out: options.Out = None,
    as_json: options.Json = False,
) -> int:
    """Fit parameters of the leg, or of a robot's MJCF, to logs.

    They are written, with intervals, as a file for --params, or as an MJCF and ranges for randomisation.

    Limit: 2 descents of at most 30 steps each. Progress: each step. Budget: --seconds.
    """
    limit = options.budget(seconds)
    options.check_sides(
        model,
        {"--actuator": actuator, "--input": input, "--output": output},
        {
            "--joint": joint,
            "--fix": fix,
            "--by-run": by_run,
            "--without": without,
            "--pot-side": pot_side,
            "--realisation": realisation,
            "--params": params,
        },
    )
    if model is not None:
        columns = {"input": input, "output": output, "mapping": map}
        kinds = None if free is None else options.names(free)
        held = options.names(hold_out)
        rest = options.of_robot(model, actuator, input, output, map)
        return _robot(
            model, options.names(actuator), files, held, columns, kinds, options.seed(seed), limit, out, as_json, rest
        )
    named = joint or twin.Log.load(files[0], map).joint
    assumed = named not in twin.JOINTS and joint is None
    joint = JOINT if assumed else named
    from sysid.report.page import write
    from twin.calibrate import advice
    from twin.calibrate.calibration import calibrate as run
    from twin.report import calibrate as report

    held_out = options.names(hold_out)
    logs = {file: twin.Log.load(file, map, joint) for file in (*files, *held_out)}
    steps = STEPS + RIVALS * (len(files) > 1)
    with run_folder(out, "calibrate") as (folder, scratch), console.progress(steps, lines=not as_json) as step:
        result = run(
            [logs[file] for file in files],
            joint,
            options.parameters(params),
            None if free is None else options.names(free),
            options.names(fix),
            [logs[file] for file in held_out],
            options.names(without),
            pot_side or "link",
            realisation or "tendon",
            seed=options.seed(seed),
            labels=[Path(file).name for file in (*files, *held_out)],
            progress=step,
            seconds=limit,
            by_run=options.names(by_run),
        )
        given = {
            "--joint": joint,
            "--params": params,
            "--free": free,
            "--hold-out": hold_out,
            "--without": without,
            "--pot-side": pot_side,
            "--realisation": realisation,
            "--map": map,
        }
        command = shlex.join(["qpal", "calibrate", *files, *options.given(given)])
        result = replace(result, provenance={**result.provenance, "command": command})
        target = folder / f"{joint}.toml"
        summary = {"file": str(target), **result.as_dict()}
        use = f"Next: qpal simulate --joint {joint} --params {target}, or qpal compare LOG --params {target}"
        if result.typical:
            own = folder / advice.file_of_log(result, 0)
            use = f"Next, each log has a file: qpal compare {shlex.quote(files[0])} --joint {joint} --params {own}"
        page = report.page(result, result.next_step() or report.next_step(result) or use)
        if assumed and page.answer is not None:
            other = _of_any_motor(files, map)
            said = f"No --joint is given, so the leg's {joint} was taken; any other motor: {other}."
            page = replace(page, answer=replace(page.answer, sentence=f"{said} {page.answer.sentence}"))
        write(scratch, page, summary)
        advice.write(result, scratch / target.name)
    sentences = [*page.verdict, *report.undetermined_sentences(result), f"Parameters: {target}"]
    console.finish(folder, summary, as_json, report.tables(result), sentences, page.answer)
    return 0 if result.converged and not advice.useless(result) else 1


def _of_any_motor(files: list[str], map: str | None) -> str:
    """The command that identifies a motor which is no joint of the leg."""
    return shlex.join(["qpal", "identify", *files, *options.given({"--map": map}), "--structure", "actuated_joint"])


def _robot(
    model: str,
    actuators: tuple[str, ...],
    files: list[str],
    held_out: tuple[str, ...],
    columns: dict[str, str | None],
    kinds: tuple[str, ...] | None,
    seed: int,
    seconds: float,
    out: str | None,
    as_json: bool,
    rest: list[str],
) -> int:
    """Calibrate joints of the MJCF `model`; `rest` are the words of the command beside its logs."""
    from sysid.report.page import write
    from twin.mjcf import advice, logs, robot, writing
    from twin.mjcf.calibration import calibrate as run
    from twin.mjcf.parameters import USUAL
    from twin.report import mjcf as report

    rig = robot.read(model, actuators)
    records = {file: logs.read(file, rig, **columns) for file in (*files, *held_out)}
    with run_folder(out, "calibrate") as (folder, scratch), console.progress(STEPS, lines=not as_json) as step:
        result = run(
            rig,
            [records[file] for file in files],
            [records[file] for file in held_out],
            USUAL if kinds is None else kinds,
            seed,
            progress=step,
            seconds=seconds,
        )
        written = writing.write(result, scratch)
        next_step = advice.next_step(result, files, held_out, rest, seed, folder)
        summary = {"files": [str(folder / name) for name in written], "next": next_step, **result.as_dict()}
        page = report.page(result, next_step)
        write(scratch, page, summary)
    console.finish(folder, summary, as_json, report.tables(result), page.verdict, page.answer)
    return 0 if result.optimum.stop.converged and result.usable else 1
