"""`qpal rig`: a real joint on a cable, or the twin in its place."""

import os
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from sysid.base.errors import InputError, unknown
from twin.cli import console, options
from twin.cli.options import Verb
from twin.cli.output import check_writable_file, run_folder
from twin.cli.results import note_result
from twin.parameters import JOINTS

if TYPE_CHECKING:
    from twin.rig.calibration import Calibration
    from twin.rig.emulator import Emulator
    from twin.rig.link import Link
    from twin.rig.run import Recording

EMULATED = ("twin",)
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
    with _rig(port, emulate, JOINTS[1], seed) as (link, _):
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

    _check_new(rig)
    with _rig(port, emulate, joint, seed) as (link, emulator):
        start = _first(link, joint, channel, supply, largest, emulator)
        _ask(f"The {joint} will move a little, both ways. Keep clear of it.", yes)
        result = find_wiring(link, start, _speaker(as_json))
        calibrations.write(result, rig)
    note_result(rig)
    _say(result.model_dump(), as_json, f"Written: {rig}", f"Next: qpal rig zero --rig {rig}")


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

    known = calibrations.read(rig)
    with _rig(port or known.port, emulate, known.joint, seed) as (link, emulator):
        _ask(f"The {known.joint} will run slowly into both of its ends. Keep clear of it.", yes)
        ends = find_ends(link, known, _speaker(as_json))
        angles = [
            _angle(given, name, counts, emulator)
            for given, name, counts in ((low, "low", ends.low), (high, "high", ends.high))
        ]
        result = _zeroed(known, ends, angles[0], angles[1])
        calibrations.write(result, rig)
    note_result(rig)
    _say(result.model_dump(), as_json, f"Written: {rig}", f"Next: qpal rig auto {known.joint} --rig {rig}")


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
    check_written(Path(log))
    check_writable_file(Path(log))
    known = _known(rig, emulate)
    joint = joint if known is None else known.joint
    if known is not None:
        check_input(given, known)
    with _rig(port or (known.port if known else None), emulate, joint, seed, speed) as (link, emulator):
        calibration = known or _emulated(link, joint, emulator)
        levels = check_input(given, calibration)
        setup = calibration.setup(link.identity.full, calibration.patience(levels, given.Ts))
        _ask(
            f"The {joint} will move for {len(levels) * given.Ts:.0f} s. Keep clear of it, and a hand on the switch.",
            yes,
        )
        with (
            _room(Path(log), LINE * len(levels)),
            console.progress(1, lines=not as_json, known=True) as step,
        ):
            step(f"playing {design}")
            recording = play(link, setup, levels, given.Ts, lambda share: step.part(share, f"playing {design}"))
        result = log_of(recording, calibration, link, design)
        if len(recording.counts):
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
    known = _known(rig, emulate)
    if known is not None and known.joint != joint:
        raise InputError(
            f"{rig} is of the {known.joint}, not the {joint}; give another --rig, or wire this joint first"
        )
    with (
        run_folder(out, "rig") as (folder, scratch),
        _rig(port or (known.port if known else None), emulate, joint, seed) as (link, emulator),
    ):
        _ask(f"The {joint} will move, with pauses, for up to {budget / 60:.0f} min of rig time. Keep clear of it.", yes)
        with console.progress(1 + 3 * experiments, lines=not as_json) as step:
            step("wiring and ends" if known is None else "first experiment")
            calibration = known or _emulated(link, joint, emulator)
            result = campaign(
                link,
                calibration,
                seed,
                experiments,
                budget,
                step=step,
                share=lambda share: step.part(share, "playing"),
                keep=lambda number, log: log.save(scratch / f"experiment-{number}.csv"),
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


@contextmanager
def _rig(
    port: str | None, emulate: str | None, joint: str, seed: int, speed: float | None = None
) -> "Iterator[tuple[Link, Emulator | None]]":
    """The line to a rig, and the rig itself where it is emulated."""
    from twin.rig.link import Link

    if emulate is None:
        if port is None:
            raise InputError("no port is given; see qpal rig find, then give --port, or --emulate twin without a rig")
        with Link(port) as link:
            yield link, None
        return
    if emulate not in EMULATED:
        raise unknown("emulated rig", emulate, EMULATED)
    if speed is not None and not 0.0 < speed < 1e6:
        raise InputError(f"--speed is {speed:g}; give a positive number, or leave it out")
    from twin.rig.emulator import Emulator

    with Emulator(joint, options.seed(seed), speed=speed) as emulator, Link(emulator.port) as link:
        yield link, emulator


def _known(rig: str, emulate: str | None) -> "Calibration | None":
    """The calibration in the file; None for an emulated rig without one, which is then wired and zeroed first."""
    from twin.rig import calibration as calibrations

    if emulate is not None and not Path(rig).exists():
        return None
    return calibrations.read(rig)


def _first(
    link: "Link", joint: str, channel: int | None, supply: float, largest: float | None, emulator: "Emulator | None"
) -> "Calibration":
    """What is known of a joint before its wiring is found."""
    from twin.rig.calibration import of_joint

    if joint not in JOINTS:
        raise unknown("joint", joint, JOINTS)
    number = JOINTS.index(joint) if channel is None else channel
    linearity = 0.0 if emulator is None else emulator.linearity
    return of_joint(link.port, joint, number, supply, supply if largest is None else largest, linearity)


def _emulated(link: "Link", joint: str, emulator: "Emulator | None") -> "Calibration":
    """The calibration of an emulated rig, found as on a real one."""
    from twin.rig.wiring import find_ends, find_wiring

    assert emulator is not None
    wired = find_wiring(link, _first(link, joint, None, emulator.supply, None, emulator), lambda sentence: None)
    ends = find_ends(link, wired, lambda sentence: None)
    return _zeroed(wired, ends, *(_angle(None, "", counts, emulator) for counts in (ends.low, ends.high)))


def _zeroed(known: "Calibration", ends: Any, low: float, high: float) -> "Calibration":
    from twin.rig.wiring import zero as zeroed

    return zeroed(known, ends, low, high)


def _angle(given: float | None, end: str, counts: float, emulator: "Emulator | None") -> float:
    """The angle [rad] of an end: given in degrees, known to an emulated rig, or asked for."""
    from math import radians

    if given is None and emulator is not None:
        return emulator.plant.angle_of(counts)
    if given is None:
        if not sys.stdin.isatty():
            raise InputError(f"the angle of the {end} end is not given; give --low and --high in degrees")
        given = typer.prompt(f"Angle at the end of {end} counts [deg]", type=float)
    return radians(given)


def _ask(sentence: str, yes: bool) -> None:
    """Ask before something moves. Raises InputError for no, and where nobody can be asked."""
    if yes:
        return
    if not sys.stdin.isatty():
        raise InputError(f"{sentence} To confirm where nobody can be asked, give --yes")
    if not typer.confirm(f"{sentence} Go on?"):
        raise InputError("nothing was moved")


def _check_new(path: str) -> None:
    """Raises InputError before the work where the calibration cannot be written."""
    if Path(path).suffix != ".toml":
        raise InputError(f"--rig is {path}; a calibration is a TOML file: end its name in .toml")
    check_writable_file(Path(path))


@contextmanager
def _room(path: Path, size: int) -> Iterator[None]:
    """Room on the disk for a file of `size` bytes beside `path`, held while the rig moves."""
    from sysid.base.locks import temporary_name

    held = temporary_name(path)
    try:
        with held.open("wb") as file:
            if hasattr(os, "posix_fallocate"):
                os.posix_fallocate(file.fileno(), 0, size)
    except OSError as error:
        held.unlink(missing_ok=True)
        raise InputError(
            f"{path}: no room for the log of about {size / 1e6:.1f} MB ({error.strerror}); nothing was moved"
        ) from None
    try:
        yield
    finally:
        held.unlink(missing_ok=True)


def _end(recording: "Recording", meta: Any, log: str, as_json: bool) -> None:
    """What the run has left, in words; exit status 1, or 130 after Ctrl-C, where it ended early."""
    n = len(recording.counts)
    written = f"the first {n} samples are in {log}" if n else "no sample was recorded"
    if recording.interrupted:
        raise console.Interruption(f"the drive is off; {written}")
    summary = {"log": log, "samples": n, "lost": len(recording.lost), "rig": meta["rig"], "notes": meta["notes"]}
    _say(summary, as_json, *(f"Note: {note}." for note in meta["notes"]), f"Log: {log}", f"Next: qpal identify {log}")
    if recording.reason:
        print(f"qpal: the run ended early: {recording.reason}; the drive is off, {written}", file=sys.stderr)
        raise typer.Exit(1)


def _speaker(as_json: bool) -> Callable[[str], None]:
    return (lambda sentence: None) if as_json else print


def _say(summary: dict[str, Any], as_json: bool, *sentences: str) -> None:
    from sysid.report.page import to_json

    if as_json:
        sys.stdout.write(to_json(summary))
    else:
        print("\n".join(sentences))
