"""What the verbs of `qpal rig` do where the rig is a servo on a bus."""

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from sysid.base.errors import InputError
from twin.cli import console, options
from twin.cli.cable import BUSES, FILE, ask, say
from twin.cli.keeping import kept_logs, write_campaign
from twin.cli.output import run_folder
from twin.cli.results import note_result
from twin.cli.stopping import hold_requests

if TYPE_CHECKING:
    from twin.log import Log
    from twin.rig.auto import Campaign
    from twin.rig.bus.emulator import Emulator
    from twin.rig.bus.line import Bus
    from twin.rig.bus.recording import Recording
    from twin.rig.bus.servo import Servo

ROW = 200  # [bytes] of a log, at the most


def name_of(bus: str | None, emulate: str | None, rig: str | None = None) -> str | None:
    """The family of servos that is meant by the options or by the rig's file; None for a board."""
    if emulate is not None:
        return emulate if emulate in BUSES else None
    if bus is not None or rig is None:
        return bus
    from twin.rig.bus.servo import is_servo, read

    return read(rig).bus if is_servo(rig) else None


def refuse_zero(emulate: str | None, rig: str) -> None:
    """Raises InputError where the rig is a servo, which has no zero to find."""
    if name_of(None, emulate, rig) is not None:
        raise InputError(
            "a servo knows its angle, and has no zero to find: set middle (its position at angle 0) and reversed in "
            f"{rig}; then qpal rig auto JOINT"
        )


@contextmanager
def bus_on(
    name: str, port: str | None, baud: int | None, emulate: str | None, seed: int, speed: float | None = None
) -> "Iterator[tuple[Bus, Emulator | None]]":
    """The line to a bus, and the servos themselves where they are emulated."""
    from twin.rig.bus.line import Bus, family_of

    family = family_of(name)
    if emulate is not None:
        from twin.rig.bus.emulator import Emulator

        if speed is not None and not 0.0 < speed < 1e6:
            raise InputError(f"--speed is {speed:g}; give a positive number, or leave it out")
        with Emulator(family, options.seed(seed), speed=speed) as emulator, emulator.bus() as bus:
            yield bus, emulator
        return
    if port is None:
        raise InputError("no port is given; see qpal rig find, then give --port, or --emulate without servos")
    with Bus(family, port, baud or family.bauds[0]) as bus:
        yield bus, None


def find(name: str, port: str | None, emulate: str | None, seed: int) -> tuple[dict[str, Any], list[str]]:
    """The servos on a bus, at the first of its usual rates at which any answers: a summary, and sentences."""
    from twin.rig.bus.line import family_of

    family = family_of(name)
    for baud in family.bauds if emulate is None else family.bauds[:1]:
        with bus_on(name, port, baud, emulate, seed) as (bus, _):
            found = bus.scan()
            where, rate = bus.port, bus.baud
        if found:
            break
    else:
        raise InputError(
            f"{where}: no {family.words} servo answers at {', '.join(map(str, family.bauds))} bit/s; check the supply "
            "of the servos and the wires of the bus"
        )
    servos, sentences = [], []
    for number, model in found.items():
        known = family.models.get(model or -1)
        what = known.name if known else f"model {model}, which the rig does not know"
        if model is None:
            what = "garbled: two servos seem to have this ID; connect one alone and give it another"
        servos.append({"id": number, "model": model, "name": known.name if known else None})
        sentences.append(f"{where}, {rate} bit/s, ID {number}: {what}")
    return {"port": where, "baud": rate, "servos": servos}, sentences


def wire(
    name: str,
    number: int,
    joint: str,
    rig: str,
    port: str | None,
    emulate: str | None,
    seed: int,
    say: Callable[[str], None],
) -> dict[str, Any]:
    """Write the file of a servo that rests; nothing moves."""
    from twin.rig.bus.line import Silent, family_of
    from twin.rig.bus.servo import wired, write

    family = family_of(name)
    trouble: InputError = InputError("")
    for baud in family.bauds if emulate is None else family.bauds[:1]:
        try:
            with bus_on(name, port, baud, emulate, seed) as (bus, _):
                servo, known = wired(bus, number, joint, say)
        except Silent as silent:
            trouble = silent
            continue
        write(servo, rig)
        note_result(rig)
        return {**servo.model_dump(), "loop": known.loop, "registers": dict(known.registers)}
    raise trouble


def run(
    name: str,
    goals: str,
    log: str,
    rig: str,
    port: str | None,
    emulate: str | None,
    joint: str,
    seed: int,
    speed: float | None,
    yes: bool,
    as_json: bool,
) -> None:
    """Play goals, write their log, and say how it went; an emulated servo also shows what was hidden in it."""
    from twin.rig.bus.recording import log_of, save
    from twin.rig.bus.run import check_goals, play, read_goals
    from twin.rig.bus.servo import wired
    from twin.rig.room import room_for

    given = read_goals(goals)
    known = _known(rig, emulate)
    if known is not None and known.bus != name:
        raise InputError(f"{rig} is of a {known.bus} servo, not of {name}; give another --rig")
    if known is not None:
        check_goals(given, known)
    baud = known.baud if known else None
    with bus_on(name, port or (known.port if known else None), baud, emulate, seed, speed) as (bus, emulator):
        servo = known or wired(bus, 1, joint, lambda sentence: None)[0]
        ticks = check_goals(given, servo)
        ask(f"The {servo.joint} will move for {len(ticks) * given.Ts:.0f} s. Keep clear of it.", yes)
        with room_for(Path(log), ROW * len(ticks)), console.progress(1, lines=not as_json, known=True) as step:
            step(f"playing {goals}")
            recording, about = play(bus, servo, ticks, given.Ts, lambda share: step.part(share, f"playing {goals}"))
        result = log_of(recording, servo, about, goals)
        if len(recording.goals):
            with hold_requests():
                save(result, recording, log)
                note_result(log)
        hidden = [] if emulator is None else emulator.sentences()
    _end(recording, result.meta, hidden, log, as_json)


def _known(rig: str, emulate: str | None) -> "Servo | None":
    """The file of a servo; None of an emulated one without a file. Raises InputError for that of a board."""
    from twin.rig.bus.servo import is_servo, read

    if emulate is not None and rig == FILE and not Path(rig).exists():
        return None
    if Path(rig).is_file() and not is_servo(rig):
        raise InputError(f"{rig} is that of a board, not of a servo; give another --rig")
    return read(rig)


def auto(
    name: str,
    joint: str,
    most: int,
    budget: float,
    port: str | None,
    rig: str,
    emulate: str | None,
    seed: int,
    yes: bool,
    out: str | None,
    as_json: bool,
) -> "tuple[Path, Campaign]":
    """Go round from goals to values; the folder with the logs and the report, and what was found."""
    from twin.rig.bus.auto import campaign
    from twin.rig.bus.recording import save
    from twin.rig.bus.servo import wired

    known = _known(rig, emulate)
    if known is not None and (known.bus != name or known.joint != joint):
        raise InputError(f"{rig} is of the {known.joint}, a {known.bus} servo; give another --rig, or wire this one")
    baud = known.baud if known else None
    with (
        run_folder(out, "rig") as (folder, scratch),
        kept_logs(folder, scratch, as_json) as kept,
        bus_on(name, port or (known.port if known else None), baud, emulate, seed) as (bus, emulator),
    ):
        servo = known or wired(bus, 1, joint, lambda sentence: None)[0]
        ask(f"The {joint} will move, with pauses, for up to {budget / 60:.0f} min of rig time. Keep clear of it.", yes)

        def keep(number: int, log: "Log", recording: "Recording") -> None:
            with hold_requests():
                if log.N:
                    save(log, recording, kept.path(number))

        with console.progress(1 + 3 * most, lines=not as_json) as step:
            result = campaign(bus, servo, seed, most, budget, step, lambda share: step.part(share, "playing"), keep)
        if emulator is not None:
            result = replace(result, truth=emulator.truth())
        write_campaign(result, scratch)
    return folder, result


def _end(done: "Recording", meta: Any, hidden: list[str], log: str, as_json: bool) -> None:
    """What a run of goals has left, in words; exit status 1, or 130 after Ctrl-C, where it ended early."""
    n = len(done.goals)
    written = f"the first {n} samples are in {log}" if n else "no sample was recorded"
    torque = (
        "the torque is off"
        if done.off is not None
        else "the servo did not confirm that its torque is off: cut its supply"
    )
    if done.interrupted:
        raise console.Interruption(f"{torque}; {written}")
    rig = meta["rig"]
    summary = {"log": log, "samples": n, "rig": rig, "servo": meta["servo"], "notes": meta["notes"]}
    timing = (
        f"Readings came {rig['reading_after_goal_ms']:.2f} ms after the goals; jitter {rig['jitter_ms']:.2f} ms, "
        f"at most {rig['largest_jitter_ms']:.2f} ms"
    )
    say(summary, as_json, timing, *(f"Note: {note}." for note in meta["notes"]), f"Log: {log}")
    if done.reason:
        print(f"qpal: the run ended early: {done.reason}; {torque}, {written}", file=sys.stderr)
        raise typer.Exit(1)
    if not as_json:
        print("\n".join([*hidden, f"Next: qpal identify {log} --structure servo_joint"]))
