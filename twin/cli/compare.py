"""`qpal compare`: a log beside the twin, a saved model, a second log or a user's MJCF."""

import shlex
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

import twin
from sysid.base.errors import InputError
from twin.cli import console, options
from twin.cli.output import run_folder
from twin.hardware.potentiometer import SIDES
from twin.parameters import REALISATIONS

if TYPE_CHECKING:
    from twin.compare.comparison import Comparison

LEAST = 50  # samples of a log beside a robot, however few --seconds are
PARTS = ("delay", "sign", "gear", "offset")


def compare(
    file: Annotated[str, typer.Argument(metavar="FILE", help="log of the joint, of the rig or of qpal simulate")],
    joint: Annotated[str | None, options.name("joint of the log, if the log does not name it", twin.JOINTS)] = None,
    against: Annotated[
        str | None,
        typer.Option(
            metavar="FILE", help="a saved model (.json) or a second log of the same input, instead of the twin"
        ),
    ] = None,
    model: options.Model = None,
    actuator: options.Actuator = "",
    input: options.Input = None,
    output: options.Output = None,
    align: Annotated[
        str, typer.Option(metavar="A,B", help=f"what of the alignment to apply to the twin, of {', '.join(PARTS)}")
    ] = "",
    seconds: Annotated[
        float, options.number("S", "length of the record, from its start, on which effects are moved in the twin")
    ] = 60.0,
    without: Annotated[str, typer.Option(metavar="A,B", help="imperfections of the twin to leave out")] = "",
    pot_side: Annotated[
        str | None, options.name("side of the backlash on which the twin's potentiometer sits", SIDES)
    ] = None,
    realisation: Annotated[
        str | None, options.name("how the twin's linear actuators are modelled", REALISATIONS)
    ] = None,
    params: options.Params = None,
    map: options.Map = None,
    out: options.Out = None,
    as_json: options.Json = False,
) -> None:
    """Show where a log departs from the twin, and why.

    The report says how much of the difference each physical effect explains.

    With --against: from a saved model, or from a second log of the same input. With --model: from a robot's MJCF, with
    the kinds of its parameters in place of effects.

    Limit: the log, of which effects are moved on the first --seconds. Progress: each part.
    """
    options.check_sides(
        model,
        {"--actuator": actuator, "--input": input, "--output": output},
        {
            "--joint": joint,
            "--against": against,
            "--align": align,
            "--without": without,
            "--params": params,
            "--pot-side": pot_side,
            "--realisation": realisation,
        },
    )
    if not 0 < seconds < float("inf"):
        raise InputError(f"--seconds is {seconds:g}; give a positive number of seconds")
    if model is not None:
        _with_robot(file, model, actuator, input, output, map, seconds, out, as_json)
        return
    parameters = options.parameters(params)
    _check_options(against, align, without, params, pot_side, realisation)
    if against is not None and joint is None and _is_of_another_plant(file, against, map):
        from twin.cli.run import run as run_saved

        run_saved([against, file], map=map, out=out, as_json=as_json)
        return
    from sysid.report.page import write
    from twin.report import compare as report

    with run_folder(out, "compare") as (folder, scratch), console.progress(6, lines=not as_json) as step:
        step(f"reading {file}")
        log = twin.Log.load(file, map)
        joint_name = _joint(file, log, joint)
        if against is None:
            from twin.compare.alignment import parts
            from twin.compare.comparison import compare as run

            result = run(
                log,
                joint_name,
                parameters,
                parts(options.names(align)),
                options.names(without),
                pot_side or str(log.meta.get("pot_side", "link")),
                realisation or "tendon",
                seconds,
                tell=step,
            )
        else:
            result = _compare_with(log, joint_name, against, map, step)
        step("drawing")
        # the next command reads the log in the same way
        command = shlex.join([file, *options.given({"--map": map, "--params": params})])
        page, summary = report.page(result, command), {"file": file, **result.as_dict()}
        write(scratch, page, summary)
    sentences = [text for text in page.verdict if not text.startswith("Next:")]  # the answer has it
    console.finish(folder, summary, as_json, report.tables(result), sentences, page.answer)


def _with_robot(
    file: str,
    model: str,
    actuator: str,
    input: str | None,
    output: str | None,
    map: str | None,
    seconds: float,
    out: str | None,
    as_json: bool,
) -> None:
    """The log `file` beside joints of the MJCF `model`, over its first `seconds`."""
    from sysid.report.page import write
    from twin.mjcf import advice, logs, robot
    from twin.mjcf.comparison import compare as run
    from twin.report import mjcf_comparison as report

    rig = robot.read(model, options.names(actuator))
    log = logs.read(file, rig, input, output, map)
    log = replace(log.part(rows=slice(max(round(seconds / log.Ts), LEAST))), units=log.units)
    with run_folder(out, "compare") as (folder, scratch), console.progress(12, lines=not as_json) as step:
        result = run(rig, log, progress=step)
        step("drawing")
        following = advice.after_comparison(result, file, options.of_robot(model, actuator, input, output, map))
        summary = {"file": file, "next": following, **result.as_dict()}
        page = report.page(result, following)
        write(scratch, page, summary)
    console.finish(folder, summary, as_json, report.tables(result), page.verdict, page.answer)


def _check_options(against: str | None, align: str, *of_twin: str | None) -> None:
    """Raises InputError for options of the twin that --against leaves without meaning."""
    if against is None:
        return
    names = ("--align", "--without", "--params", "--pot-side", "--realisation")
    for name, value in zip(names, (align, *of_twin), strict=True):
        if value:
            raise InputError(f"{name} belongs to the twin and --against {against} is given; leave one of the two out")


def _is_of_another_plant(file: str, against: str, map: str | None) -> bool:
    """Whether a log beside a saved model names no joint of the leg, as that of any other plant."""
    if Path(against).suffix.lower() != ".json":
        return False
    try:
        return twin.Log.load(file, map).joint == ""
    except InputError:  # in other units than a leg's; a file that cannot be read is refused by the run too
        return True


def _joint(file: str, log: twin.Log, joint: str | None) -> str:
    """The joint to compare; raises InputError where log and option do not say it, or say two."""
    if joint is not None and joint not in twin.JOINTS:
        from sysid.base.errors import unknown

        raise unknown("joint", joint, twin.JOINTS)
    if log.joint in ("", twin.parameters.LEG):
        if joint is None:
            raise InputError(
                f"{file} does not name one joint; give --joint ({', '.join(twin.JOINTS)}); a log of another "
                "plant is compared with its own model: qpal run MODEL FILE"
            )
        return joint
    if joint is not None and joint != log.joint:
        raise InputError(f"{file} is a log of the {log.joint} and --joint is {joint}; leave --joint out")
    return log.joint


def _compare_with(log: twin.Log, joint: str, against: str, map: str | None, step: console.Steps) -> "Comparison":
    from twin.compare.comparison import compare_log, compare_model

    name = Path(against).name
    if Path(against).suffix.lower() == ".json":
        import sysid

        return compare_model(log, joint, sysid.load(against), name, step)
    return compare_log(log, options.second_log(against, map), joint, name, step)
