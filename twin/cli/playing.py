"""The verbs of `qpal rig` that play: `run` an input, and `auto`, which goes round to values."""

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from sysid.base.errors import InputError
from twin.cli import bus as servos
from twin.cli import console, options
from twin.cli.cable import (
    FILE,
    Emulate,
    Port,
    RigFile,
    Seed,
    Speed,
    Yes,
    ask,
    check_known,
    emulated_calibration,
    known_calibration,
    rig_on,
    say,
)
from twin.cli.keeping import check_new_log, kept_logs, save_log, write_campaign
from twin.cli.output import run_folder
from twin.cli.results import note_result
from twin.cli.stopping import hold_requests
from twin.parameters import JOINTS

if TYPE_CHECKING:
    import numpy as np

    from twin.rig.auto import Campaign
    from twin.rig.run import Input, Recording


def run(
    design: Annotated[
        str,
        typer.Argument(
            metavar="DESIGN.csv", help="time and voltage, as qpal design writes it; time and goal of a servo"
        ),
    ],
    log: Annotated[str, typer.Option("--log", metavar="OUT.csv", help="the log")] = "log.csv",
    input: options.Input = None,
    ts: options.Ts = None,
    time: options.Time = None,
    time_unit: options.TimeUnit = None,
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

    Any key, Ctrl-C, a fault and a pulled cable turn the drive off; the log up to there is written. Exit status 1 if the
    run ended early.

    Limit: 65,535 samples. Progress: the run.
    """
    from sysid.channels.guess import Given
    from twin.cli.live import Trace, played
    from twin.rig.journal import journal
    from twin.rig.room import LINE, room_for
    from twin.rig.run import check_input, log_of, play, read_input

    if name := servos.name_of(None, emulate, rig):
        check_new_log(log)
        servos.run(name, design, log, rig, port, emulate, joint, seed, speed, yes, as_json)
        return
    given = read_input(design, Given(input=input, time=time, time_unit=time_unit, Ts=ts))
    check_new_log(log)
    known = known_calibration(rig, emulate)
    joint = joint if known is None else known.joint
    if known is not None:
        check_input(given, known)
    with rig_on(port or (known.port if known else None), emulate, joint, seed, speed) as (link, emulator):
        check_known(known, link, emulator)
        calibration = known or emulated_calibration(link, joint, emulator)
        levels = check_input(given, calibration)
        setup = calibration.setup(link.identity.full, calibration.patience(levels, given.Ts))
        ask(
            f"The {joint} will move for {len(levels) * given.Ts:.0f} s. Keep clear of it, and a hand on the switch.",
            yes,
        )
        trace = Trace(calibration, len(levels), given.Ts)
        with journal(Path(log), link, calibration, levels, given.Ts, design) as note:
            with (
                room_for(Path(log), LINE * len(levels)),
                console.progress(1, lines=not as_json, known=True, below=tuple if as_json else trace.lines) as step,
                played(link, note, trace, as_json),
            ):
                step(f"playing {design}")
                recording = play(link, setup, levels, given.Ts, lambda share: step.part(share, f"playing {design}"))
            result = log_of(recording, calibration, link, design)
            if len(recording.counts):
                with hold_requests():
                    save_log(result, Path(log))
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
    from twin.cli.live import Trace, played
    from twin.rig.auto import TS, campaign
    from twin.rig.journal import journal

    if experiments < 1 or not 0.0 < budget < 1e6:
        raise InputError(f"--experiments is {experiments} and --budget {budget:g}; give positive numbers")
    if name := servos.name_of(None, emulate, rig):
        _finish(*servos.auto(name, joint, experiments, budget, port, rig, emulate, seed, yes, out, as_json), as_json)
        return
    known = known_calibration(rig, emulate)
    if known is not None and known.joint != joint:
        raise InputError(
            f"{rig} is of the {known.joint}, not the {joint}; give another --rig, or wire this joint first"
        )
    shown: list[Trace] = []
    with (
        run_folder(out, "rig") as (folder, scratch),
        kept_logs(folder, scratch, as_json) as kept,
        rig_on(port or (known.port if known else None), emulate, joint, seed) as (link, emulator),
    ):
        check_known(known, link, emulator)
        ask(f"The {joint} will move, with pauses, for up to {budget / 60:.0f} min of rig time. Keep clear of it.", yes)
        with console.progress(
            1 + 3 * experiments,
            lines=not as_json,
            below=lambda: [line for trace in shown for line in trace.lines()] if not as_json else (),
        ) as step:
            step("wiring and ends" if known is None else "first experiment")
            calibration = known or emulated_calibration(link, joint, emulator)

            @contextmanager
            def around(number: int, given: "Input", levels: "np.ndarray") -> Iterator[None]:
                shown.append(Trace(calibration, len(levels), given.Ts))
                with journal(kept.path(number), link, calibration, levels, given.Ts, given.source) as note:
                    with played(link, note, shown[0], as_json):
                        yield
                    shown.clear()

            result = campaign(
                link,
                calibration,
                seed,
                experiments,
                budget,
                step=step,
                share=lambda share: step.part(share, "playing"),
                keep=kept.save,
                around=around,
            )
            if emulator is not None:
                result = result.with_truth(emulator.truth(TS))
        write_campaign(result, scratch)
    _finish(folder, result, as_json)


def _finish(folder: Path, result: "Campaign", as_json: bool) -> None:
    """What a campaign found; exit status 130 after Ctrl-C, 1 where a value is not determined."""
    from twin.report import rig as report

    console.finish(folder, result.as_dict(), as_json, report.tables(result), report.sentences(result))
    if result.interrupted:
        raise console.Interruption(f"the drive is off; the experiments before are in {folder}")
    if result.open:
        raise typer.Exit(1)


def _end(recording: "Recording", meta: Any, log: str, as_json: bool) -> None:
    """What the run has left, in words; exit status 1, or 130 after Ctrl-C, where it ended early."""
    n = len(recording.counts)
    written = f"the first {n} samples are in {log}" if n else "no sample was recorded"
    summary = {
        "log": log if n else None,
        "samples": n,
        "lost": len(recording.lost),
        "rig": meta["rig"],
        "notes": meta["notes"],
    }
    if recording.interrupted:
        if as_json:
            say(summary, as_json)
        raise console.Interruption(f"the drive is off; {written}")
    say(summary, as_json, *(f"Note: {note}." for note in meta["notes"]), f"Log: {log}")
    if recording.reason:
        print(f"qpal: the run ended early: {recording.reason}; the drive is off, {written}", file=sys.stderr)
        raise typer.Exit(1)
    if not as_json:
        print(f"Next: qpal identify {log} --structure actuated_joint")
