"""`qpal rig`: a real joint on a cable, or the twin in its place."""

import sys
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from sysid.base.errors import InputError
from twin.cli import console, options
from twin.cli.cable import (
    EMULATED,
    angle_of_end,
    ask,
    check_new_file,
    emulated_calibration,
    first_calibration,
    kept_logs,
    known_calibration,
    rig_on,
    room_for,
)
from twin.cli.options import Verb
from twin.cli.output import check_writable_file, run_folder
from twin.cli.results import note_result
from twin.cli.stopping import hold_requests
from twin.parameters import JOINTS

if TYPE_CHECKING:
    from twin.rig.run import Recording

FILE = "rig.toml"  # `twin.rig.calibration.DEFAULT`, whose import would slow the help text down
LINE = 120  # [bytes] a row of a log takes at the most

Emulate = Annotated[
    str | None,
    typer.Option("--emulate", metavar="NAME", help=f"a rig without hardware, instead of a port: {', '.join(EMULATED)}"),
]
Seed = Annotated[int, options.whole_number("N", "of the emulated leg, its wiring and its noise")]
Port = Annotated[
    str | None,
    typer.Option("--port", metavar="PORT", help="serial port, if not that of --rig; see qpal rig find"),
]
RigFile = Annotated[str, typer.Option("--rig", metavar="FILE.toml", help="how the joint is wired, and its limits")]
Yes = Annotated[bool, typer.Option("--yes", help="move without asking first")]
Speed = Annotated[
    float | None, options.number("X", "seconds of the emulated leg in a second; as many as go if not given")
]


def build() -> typer.Typer:
    """The verbs of `qpal rig`."""
    app = typer.Typer(
        name="rig",
        help="Play inputs on a real joint.\n\nThe joint hangs on a board with the rig's firmware, or is emulated.",
        no_args_is_help=True,
        rich_markup_mode=None,
    )
    for name, verb in VERBS.items():
        app.command(name=name, cls=Verb)(verb)
    return app


def find(
    port: Port = None,
    emulate: Emulate = None,
    seed: Seed = 0,
    as_json: options.Json = False,
) -> None:
    """List the serial ports, or ask who is on one.

    Limit: 4 s for an answer.
    """
    from twin.rig.link import ports

    if port is None and emulate is None:
        found = ports()
        sentences = [f"{name}: {text}" for name, text in found] or ["no serial port; connect the board's USB cable"]
        _say({"ports": [{"port": name, "description": text} for name, text in found]}, as_json, *sentences)
        return
    with rig_on(port, emulate, JOINTS[1], seed) as (link, _):
        who = link.identity
        summary = {"port": link.port, "firmware": f"{who.name} {who.firmware}", "joints": who.joints, "full": who.full}
        _say(summary, as_json, f"{link.port}: {who.name} {who.firmware}, {who.joints} joints, readings to {who.full}")


def wire(
    joint: Annotated[str, typer.Argument(metavar="JOINT", help=f"name of the joint in logs: {', '.join(JOINTS)}")],
    port: Port = None,
    channel: Annotated[
        int | None, options.whole_number("N", "joint number on the board; 0, 1, 2 for the names above if not given")
    ] = None,
    supply: Annotated[float, options.number("V", "voltage of the supply")] = 12.0,
    largest: Annotated[float | None, options.number("V", "largest input; the supply if not given")] = None,
    rig: RigFile = FILE,
    emulate: Emulate = None,
    seed: Seed = 0,
    yes: Yes = False,
    as_json: options.Json = False,
) -> None:
    """Check how a joint is wired, by small pulses.

    The sensor has to read; pulses grow until the joint moves, which tells the direction of its motor.

    Limit: 18 pulses. Progress: each pulse.
    """
    from twin.rig import calibration as calibrations
    from twin.rig.wiring import find_wiring

    check_new_file(rig)
    with rig_on(port, emulate, joint, seed) as (link, emulator):
        start = first_calibration(link, joint, channel, supply, largest, emulator)
        ask(f"The {joint} will move a little, both ways. Keep clear of it.", yes)
        result = find_wiring(link, start, _speaker(as_json))
        calibrations.write(result, rig)
    note_result(rig)
    _say(result.model_dump(), as_json, f"Written: {rig}", f"Next: qpal rig zero{_again(rig, emulate, seed)}")


def zero(
    low: Annotated[float | None, options.number("DEG", "angle at the end of low counts; asked for if missing")] = None,
    high: Annotated[float | None, options.number("DEG", "angle at the end of high counts")] = None,
    port: Port = None,
    rig: RigFile = FILE,
    emulate: Emulate = None,
    seed: Seed = 0,
    yes: Yes = False,
    as_json: options.Json = False,
) -> None:
    """Find the ends of a joint, and give their readings angles.

    The joint runs slowly into both ends. An emulated rig knows its angles.

    Limit: two runs of 90 s. Progress: each end.
    """
    from twin.rig import calibration as calibrations
    from twin.rig.wiring import find_ends
    from twin.rig.wiring import zero as zeroed

    known = calibrations.read(rig)
    if emulate is None and None in (low, high) and not sys.stdin.isatty():
        raise InputError("the angles of the ends are not given; give --low and --high in degrees")
    with rig_on(port or known.port, emulate, known.joint, seed) as (link, emulator):
        ask(f"The {known.joint} will run slowly into both of its ends. Keep clear of it.", yes)
        angles = {"low": low, "high": high}
        ends = find_ends(
            link, known, _speaker(as_json), lambda end, counts: angle_of_end(angles[end], end, counts, emulator)
        )
        result = zeroed(known, ends)
        calibrations.write(result, rig)
    note_result(rig)
    _say(
        result.model_dump(),
        as_json,
        f"Written: {rig}",
        f"Next: qpal rig auto {known.joint}{_again(rig, emulate, seed)}",
    )


def run(
    design: Annotated[str, typer.Argument(metavar="DESIGN.csv", help="time and voltage, as qpal design writes it")],
    log: Annotated[str, typer.Option("--log", metavar="OUT.csv", help="the log")] = "log.csv",
    port: Port = None,
    rig: RigFile = FILE,
    emulate: Emulate = None,
    joint: Annotated[str, options.name("joint of an emulated rig without --rig", JOINTS)] = "thigh",
    seed: Seed = 0,
    speed: Speed = None,
    yes: Yes = False,
    as_json: options.Json = False,
) -> None:
    """Play an input on a joint and write its log.

    Ctrl-C, a fault and a pulled cable turn the drive off; the log up to there is written. Exit status 1 if the run
    ended early.

    Limit: 65,535 samples. Progress: the run.
    """
    from sysid.formats import check_written
    from twin.rig.run import check_input, log_of, play, read_input

    given = read_input(design)
    if Path(log).exists():
        raise InputError(f"{log} is there already, and a record cannot be made again; give another --log")
    check_written(Path(log))
    check_writable_file(Path(log))
    known = known_calibration(rig, emulate)
    joint = joint if known is None else known.joint
    if known is not None:
        check_input(given, known)
    with rig_on(port or (known.port if known else None), emulate, joint, seed, speed) as (link, emulator):
        calibration = known or emulated_calibration(link, joint, emulator)
        levels = check_input(given, calibration)
        setup = calibration.setup(link.identity.full, calibration.patience(levels, given.Ts))
        ask(
            f"The {joint} will move for {len(levels) * given.Ts:.0f} s. Keep clear of it, and a hand on the switch.",
            yes,
        )
        with (
            room_for(Path(log), LINE * len(levels)),
            console.progress(1, lines=not as_json, known=True) as step,
        ):
            step(f"playing {design}")
            recording = play(link, setup, levels, given.Ts, lambda share: step.part(share, f"playing {design}"))
        result = log_of(recording, calibration, link, design)
        if len(recording.counts):
            with hold_requests():
                result.save(log)
                note_result(log)
    _end(recording, result.meta, log, as_json)


def auto(
    joint: Annotated[str, typer.Argument(metavar="JOINT", help=f"the joint: {', '.join(JOINTS)}")],
    experiments: Annotated[int, options.whole_number("N", "experiments, at most")] = 3,
    budget: Annotated[float, options.number("S", "rig time of all of them, at most")] = 600.0,
    port: Port = None,
    rig: RigFile = FILE,
    emulate: Emulate = None,
    seed: Seed = 0,
    yes: Yes = False,
    out: options.Out = None,
    as_json: options.Json = False,
) -> None:
    """Go round from experiment to values until every value is determined.

    A first sweep, its identification, an experiment designed for what is not determined yet, and so on. The folder
    has the log of each experiment, the values with intervals, and how they shrank.

    Limit: --experiments. Progress: each part. Budget: --budget.
    """
    from sysid.report.page import write
    from twin.report import rig as report
    from twin.rig.auto import TS, campaign

    if experiments < 1 or not 0.0 < budget < 1e6:
        raise InputError(f"--experiments is {experiments} and --budget {budget:g}; give positive numbers")
    known = known_calibration(rig, emulate)
    if known is not None and known.joint != joint:
        raise InputError(
            f"{rig} is of the {known.joint}, not the {joint}; give another --rig, or wire this joint first"
        )
    with (
        run_folder(out, "rig") as (folder, scratch),
        kept_logs(folder, scratch) as keep,
        rig_on(port or (known.port if known else None), emulate, joint, seed) as (link, emulator),
    ):
        ask(f"The {joint} will move, with pauses, for up to {budget / 60:.0f} min of rig time. Keep clear of it.", yes)
        with console.progress(1 + 3 * experiments, lines=not as_json) as step:
            step("wiring and ends" if known is None else "first experiment")
            calibration = known or emulated_calibration(link, joint, emulator)
            result = campaign(
                link,
                calibration,
                seed,
                experiments,
                budget,
                step=step,
                share=lambda share: step.part(share, "playing"),
                keep=keep,
            )
            if emulator is not None:
                result = result.with_truth(emulator.truth(TS))
        if not result.rounds:
            raise InputError(f"{result.stopped}; nothing was identified")
        write(scratch, report.page(result), result.as_dict())
    console.finish(folder, result.as_dict(), as_json, report.tables(result), report.sentences(result))
    if result.open:
        raise typer.Exit(1)


VERBS: dict[str, Callable[..., None]] = {"find": find, "wire": wire, "zero": zero, "run": run, "auto": auto}


def _end(recording: "Recording", meta: Any, log: str, as_json: bool) -> None:
    """What the run has left, in words; exit status 1, or 130 after Ctrl-C, where it ended early."""
    n = len(recording.counts)
    written = f"the first {n} samples are in {log}" if n else "no sample was recorded"
    if recording.interrupted:
        raise console.Interruption(f"the drive is off; {written}")
    summary = {"log": log, "samples": n, "lost": len(recording.lost), "rig": meta["rig"], "notes": meta["notes"]}
    _say(summary, as_json, *(f"Note: {note}." for note in meta["notes"]), f"Log: {log}")
    if recording.reason:
        print(f"qpal: the run ended early: {recording.reason}; the drive is off, {written}", file=sys.stderr)
        raise typer.Exit(1)
    if not as_json:
        print(f"Next: qpal identify {log} --structure actuated_joint")


def _again(rig: str, emulate: str | None, seed: int) -> str:
    """The options with which the next verb finds the same rig."""
    return f" --rig {rig}" + ("" if emulate is None else f" --emulate {emulate} --seed {seed}")


def _speaker(as_json: bool) -> Callable[[str], None]:
    return (lambda sentence: None) if as_json else print


def _say(summary: dict[str, Any], as_json: bool, *sentences: str) -> None:
    from sysid.report.page import to_json

    if as_json:
        sys.stdout.write(to_json(summary))
    else:
        print("\n".join(sentences))
