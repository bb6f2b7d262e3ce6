"""`qpal rig`: a real joint on a cable, or the twin in its place."""

import sys
from collections.abc import Callable
from pathlib import Path
from typing import Annotated

import typer

from sysid.base.errors import InputError
from twin.cli import bus as servos
from twin.cli import options
from twin.cli.cable import (
    FILE,
    Emulate,
    Port,
    RigFile,
    Seed,
    Servos,
    Yes,
    angle_of_end,
    ask,
    check_angles,
    check_known,
    check_new_file,
    check_replaced,
    first_calibration,
    rig_on,
    same_rig,
    say,
    speaker,
)
from twin.cli.flash import flash
from twin.cli.keeping import recover_logs
from twin.cli.options import Verb
from twin.cli.playing import auto, run
from twin.cli.results import note_result
from twin.parameters import JOINTS


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
    bus: Servos = None,
    emulate: Emulate = None,
    seed: Seed = 0,
    as_json: options.Json = False,
) -> None:
    """List the serial ports, or ask who is on one.

    Limit: 4 s for an answer; a minute for the servos of a bus.
    """
    from twin.rig.link import ports

    if name := servos.name_of(bus, emulate):
        summary, sentences = servos.find(name, port, emulate, seed)
        say(summary, as_json, *sentences)
        return
    if port is None and emulate is None:
        found = ports()
        sentences = [f"{name}: {text}" for name, text in found] or ["no serial port; connect the board's USB cable"]
        say({"ports": [{"port": name, "description": text} for name, text in found]}, as_json, *sentences)
        return
    with rig_on(port, emulate, JOINTS[1], seed) as (link, _):
        who = link.identity
        summary = {"port": link.port, "firmware": who.release, "joints": who.joints, "full": who.full}
        say(summary, as_json, f"{link.port}: {who.release}, {who.joints} joints, readings to {who.full}")


def wire(
    joint: Annotated[str, typer.Argument(metavar="JOINT", help=f"name of the joint in logs: {', '.join(JOINTS)}")],
    port: Port = None,
    channel: Annotated[
        int | None, options.whole_number("N", "joint number on the board; 0, 1, 2 for the names above if not given")
    ] = None,
    bus: Servos = None,
    id: Annotated[int, options.whole_number("N", "number of the servo on its bus")] = 1,
    supply: Annotated[float, options.number("V", "voltage of the supply")] = 12.0,
    supply_full: Annotated[
        float | None, options.number("V", "supply at which its pin reads 5 V; 18.5 by the divider of docs/rig.md")
    ] = None,
    largest: Annotated[float | None, options.number("V", "largest input; the supply if not given")] = None,
    rig: RigFile = FILE,
    emulate: Emulate = None,
    seed: Seed = 0,
    yes: Yes = False,
    as_json: options.Json = False,
) -> None:
    """Check how a joint is wired, by small pulses.

    The sensor has to read; pulses grow until the joint moves, which tells the direction of its motor. A servo on a bus
    is asked for its model, its limits and its gains, and does not move.

    Limit: 18 pulses. Progress: each pulse.
    """
    from twin.rig import calibration as calibrations
    from twin.rig.wiring import find_wiring

    check_new_file(rig)
    name = servos.name_of(bus, emulate)
    check_replaced(rig, joint, name)
    if name:
        wired = servos.wire(name, id, joint, rig, port, emulate, seed, speaker(as_json))
        say(wired, as_json, f"Written: {rig}", f"Next: qpal rig run GOALS.csv{same_rig(rig, emulate, seed)}")
        return
    with rig_on(port, emulate, joint, seed) as (link, emulator):
        start = first_calibration(link, joint, channel, supply, largest, emulator, supply_full)
        check_known(start, link, emulator)
        ask(f"The {joint} will move a little, both ways. Keep clear of it.", yes)
        result = find_wiring(link, start, speaker(as_json))
        calibrations.write(result, rig)
    note_result(rig)
    say(result.model_dump(), as_json, f"Written: {rig}", f"Next: qpal rig zero{same_rig(rig, emulate, seed)}")


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

    servos.refuse_zero(emulate, rig)
    known = calibrations.read(rig)
    check_new_file(rig)
    check_angles(low, high)
    if emulate is None and None in (low, high) and not sys.stdin.isatty():
        raise InputError("the angles of the ends are not given; give --low and --high in degrees")
    with rig_on(port or known.port, emulate, known.joint, seed) as (link, emulator):
        check_known(known, link, emulator)
        ask(f"The {known.joint} will run slowly into both of its ends. Keep clear of it.", yes)
        angles = {"low": low, "high": high}
        ends = find_ends(
            link, known, speaker(as_json), lambda end, counts: angle_of_end(angles[end], end, counts, emulator)
        )
        result = zeroed(known, ends)
        calibrations.write(result, rig)
    note_result(rig)
    say(
        result.model_dump(),
        as_json,
        f"Written: {rig}",
        f"Next: qpal rig auto {known.joint}{same_rig(rig, emulate, seed)}",
    )


def recover(
    folder: Annotated[str, typer.Argument(metavar="DIR", help="the folder of the log that was to be")] = ".",
    as_json: options.Json = False,
) -> None:
    """Make the logs of runs that were killed.

    While a run plays, its samples are in a journal beside its log. The next qpal rig run in that folder does the same.

    Limit: the journals of one folder.
    """
    if not Path(folder).is_dir():
        raise InputError(f"{folder} is no folder; give the one in which the run was to write its log")
    made = [str(path) for path in recover_logs(Path(folder))]
    say({"logs": made}, as_json, *([f"Next: qpal info {path}" for path in made] or [f"no run in {folder} was killed"]))


VERBS: dict[str, Callable[..., None]] = {
    "find": find,
    "flash": flash,
    "wire": wire,
    "zero": zero,
    "run": run,
    "auto": auto,
    "recover": recover,
}
