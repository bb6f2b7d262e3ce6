"""`qpal simulate`: an excitation experiment on the twin."""

from pathlib import Path
from typing import Annotated

import typer

import twin
from sysid import excitations, formats
from sysid.base.errors import InputError
from twin.cli import console, options
from twin.cli.output import check_writable_file, run_folder
from twin.cli.results import note_result
from twin.hardware.actuator import MODES
from twin.hardware.potentiometer import SIDES
from twin.parameters import LEG, REALISATIONS

STROKE = ("stays inside its stroke (inside)", "reaches both ends with a margin (ends)")


# What a log fixes that drives the twin.
FIXED = ("excitation", "duration", "ts", "settings", "stroke")


def simulate(
    context: typer.Context,
    joint: Annotated[str, options.name("which", (*twin.JOINTS, LEG))] = "thigh",
    excitation: Annotated[str, options.name("input signal", excitations.TABLE)] = "sweep",
    duration: Annotated[float, options.number("S", "length of the record in seconds")] = 250.0,
    ts: Annotated[float, options.number("S", "sampling time in seconds")] = 0.1,
    seed: Annotated[int, options.whole_number("N", "of excitation and noise")] = 1,
    mode: Annotated[str, options.name("what the input is", MODES)] = "voltage",
    settings: Annotated[
        str, typer.Option("--set", metavar="A=1,B=2", help="settings of the excitation, for example amplitude=6")
    ] = "",
    stroke: Annotated[
        str | None, typer.Option(metavar="NAME", help=f"change the settings so that the joint {' or '.join(STROKE)}")
    ] = None,
    without: Annotated[
        str, typer.Option(metavar="A,B", help=f"imperfections to leave out, of {', '.join(twin.IMPERFECTIONS)}")
    ] = "",
    pot_side: Annotated[str, options.name("side of the backlash on which the potentiometer sits", SIDES)] = "link",
    realisation: Annotated[str, options.name("how the linear actuators are modelled", REALISATIONS)] = "tendon",
    params: options.Params = None,
    input_log: Annotated[
        str | None,
        typer.Option(
            metavar="FILE", help="log whose input drives the twin, from its first angle, at its sampling time and mode"
        ),
    ] = None,
    map: options.Map = None,
    log: Annotated[
        str | None,
        typer.Option(metavar="FILE", help=f"the log: {', '.join(formats.WRITTEN)}; DIR/log.csv if not given"),
    ] = None,
    out: options.Out = None,
    as_json: options.Json = False,
) -> None:
    """Simulate an experiment on the twin and write its log.

    The excitation is of one joint, or of all three.

    Limit: 10^9 steps of the plant, 11.6 days at 1 ms. Progress: the experiment.
    """
    from sysid.report.page import write
    from twin.report import simulate as report
    from twin.studies.simulation import follow
    from twin.studies.simulation import simulate as run

    parameters = options.parameters(params)
    if input_log is not None:
        driver = twin.Log.load(input_log, map)
        options_given = _options_given(context)
        follower = _follower(
            input_log, driver, options_given, joint, mode, options.names(without), pot_side, realisation
        )
        joint, description = follower.joint, f"the input of {input_log}"
    else:
        if map is not None:
            raise InputError("--map is given without --input-log; give the log that it reads, or leave --map out")
        experiment = twin.Experiment(
            joint,
            excitation,
            duration,
            ts,
            options.seed(seed),
            options.names(without),
            parameters,
            options.settings(settings),
            mode,
            pot_side,
            realisation,
        )
        if stroke is not None:
            from twin.design import fit_stroke

            experiment = fit_stroke(experiment, stroke)
        description = f"{duration:g} s of {excitation}"
    with run_folder(out, "simulate") as (folder, scratch), console.progress(2, lines=not as_json) as step:
        target = Path(log) if log is not None else folder / "log.csv"
        inside = target.parent.resolve() == folder.resolve()
        formats.check_written(target)
        if not inside:
            check_writable_file(target)
        step(f"{joint}: {description}")
        result = run(experiment) if input_log is None else follow(follower, parameters, options.seed(seed))
        summary = {"file": str(target), **result.as_dict()}
        step("drawing")
        write(scratch, report.page(result), summary)
        result.log.save(scratch / target.name if inside else target)
        if not inside:
            note_result(target)
    console.finish(folder, summary, as_json, report.tables(result), [f"Log: {target}"])


def _options_given(context: typer.Context) -> set[str]:
    """Names of the options that a person gave; raises InputError for one that an input log fixes."""
    sources = {name: context.get_parameter_source(name) for name in context.params}
    names = {name for name, source in sources.items() if source is not None and source.name == "COMMANDLINE"}
    for parameter in context.command.params:
        if parameter.name in FIXED and parameter.name in names:
            raise InputError(
                f"{parameter.opts[0]} is given with --input-log, whose input and sampling time drive the twin; leave "
                "one of the two out"
            )
    return names


def _follower(
    path: str,
    log: twin.Log,
    options_given: set[str],
    joint: str,
    mode: str,
    without: tuple[str, ...],
    pot_side: str,
    realisation: str,
) -> "twin.Follower":
    """The twin under the input of a log; raises InputError where options and log do not agree."""
    if "mode" in options_given and mode != log.mode:
        raise InputError(f"--mode is {mode} and {path} is a log in {log.mode} mode; leave --mode out")
    joint_name = log.joint if "joint" not in options_given and log.joint in twin.JOINTS else joint
    if joint_name not in twin.JOINTS:
        raise InputError(f"--joint is {joint_name} and a log drives one joint; choose one of {', '.join(twin.JOINTS)}")
    return twin.Follower(log, joint_name, without, pot_side, realisation)
