"""Hidden servos behind the emulated buses: wire, run, identify, and what came out beside the truth.

    python scripts/study.py servo_buses [--seeds 0:40] [--garbled 0.01] [--lost 0.001] [--late 0.002] [--experiments 3]

Even seeds are a Dynamixel XL330, odd ones a Feetech STS3215. Each plays 30 s of drawn steps; a servo joint with
friction by load is fitted with the loop and kp that the log's header names. Errors are in percent of the truth.
With --experiments the servo goes round as `qpal rig auto` does, with at most so many: told are the values that are
determined and, of those whose truth is known, the intervals that hold it.
"""

import argparse
from typing import Any

import numpy as np
from study import Study

import sysid
from sysid.blocks import ServoMotor
from sysid.structures import servo_joint
from twin.rig.bus.auto import campaign
from twin.rig.bus.emulator import Emulator
from twin.rig.bus.recording import log_of
from twin.rig.bus.registers import DYNAMIXEL, FEETECH, Family
from twin.rig.bus.run import check_goals, play
from twin.rig.bus.servo import wired
from twin.rig.run import Input

TS, NAMES = 0.02, ("speed_full_drive", "time_constant", "pull")


def score(case: tuple[int], options: argparse.Namespace) -> dict[str, Any]:
    """Errors [%], jitter [ms] and lost samples of servo k."""
    (k,) = case
    family = (DYNAMIXEL, FEETECH)[k % 2]
    if options.experiments:
        return loop(family, k, options)
    damage = {"garbled": options.garbled, "lost": options.lost, "late": options.late}
    u = np.repeat(np.random.default_rng([k, 1]).uniform(-0.7, 0.7, 60), 25)
    with Emulator(family, k, **damage) as emulator, emulator.bus() as bus:
        servo = wired(bus, 1, "servo", lambda sentence: None)[0]
        recording, known = play(bus, servo, check_goals(Input(u, TS), servo), TS)
        true, log = emulator.truth(), log_of(recording, servo, known)
    terms = known.loop
    motor = ServoMotor(load=0, periodic=1, stops=False, loss=True, loop=terms["loop"])
    fit = sysid.fit(servo_joint(motor, play=False, kp=terms["kp"]), log.io(), search="lm", starts=2)
    found = dict(zip(fit.model.names, fit.theta, strict=True))
    values = {"speed_full_drive": found["motor.gain"] / TS, "time_constant": found["motor.lag"] * TS}
    values["pull"] = float(np.hypot(found["motor.sine1"], found["motor.cosine1"]))
    errors = {name: 100.0 * (values[name] / true[name] - 1.0) for name in NAMES}
    rig = log.meta["rig"]
    counts = {"missing": int(np.isnan(log.y).sum()), "jitter": rig["jitter_ms"], "other": recording.other_goals}
    return errors | counts | {"family": family.name, "early": recording.reason}


def loop(family: Family, k: int, options: argparse.Namespace) -> dict[str, Any]:
    """What a campaign on servo k determines, and which of its intervals hold."""
    damage = {"garbled": options.garbled, "lost": options.lost, "late": options.late}
    with Emulator(family, k, **damage) as emulator, emulator.bus() as bus:
        servo = wired(bus, 1, "servo", lambda sentence: None)[0]
        done, true = campaign(bus, servo, k, options.experiments), emulator.truth()
    known = done.values_after(len(done.rounds))
    told = [name for name in done.asked if name not in done.open]
    holds = {name: known[name].holds(true[name]) for name in told if name in true}
    kinds = [each.what for each in done.rounds]
    return {"family": family.name, "asked": done.asked, "told": told, "holds": holds, "seconds": done.rig_seconds} | {
        "kinds": kinds,
        "stopped": done.stopped,
    }


def loops(rows: list[dict[str, Any]]) -> str:
    """Experiments, rig time, and values determined, by family."""
    lines = ["| family | n | experiments | rig time [s] | determined | intervals that hold |"]
    lines.append("| :-- | --: | --: | --: | --: | --: |")
    for family in (DYNAMIXEL.name, FEETECH.name):
        group = [r for r in rows if r["family"] == family]
        if not group:
            continue
        told, asked = (sum(len(r[name]) for r in group) for name in ("told", "asked"))
        held = [held for r in group for held in r["holds"].values()]
        lines.append(
            f"| {family} | {len(group)} | {np.mean([len(r['kinds']) for r in group]):.1f} | "
            f"{np.median([r['seconds'] for r in group]):.0f} | {told} of {asked} | {sum(held)} of {len(held)} |"
        )
    return "\n".join(lines)


def summary(rows: list[dict[str, Any]], options: argparse.Namespace) -> str:
    """Median and largest error of each value, by family; or what campaigns determine."""
    if options.experiments:
        return loops(rows)
    lines = ["| family | n | speed | time constant | pull | missing of 1500 | jitter [ms] | ended early |"]
    lines.append("| :-- | --: | --: | --: | --: | --: | --: | --: |")
    for family in (DYNAMIXEL.name, FEETECH.name):
        group = [r for r in rows if r["family"] == family]
        if not group:
            continue
        cells = []
        for name in NAMES:
            off = np.abs([r[name] for r in group])
            cells.append(f"{np.median(off):.2f}, {off.max():.2f} %")
        cells += [f"{np.mean([r['missing'] for r in group]):.0f}", f"{np.median([r['jitter'] for r in group]):.2f}"]
        lines.append(f"| {family} | {len(group)} | {' | '.join(cells)} | {sum(bool(r['early']) for r in group)} |")
    return "\n".join(lines)


STUDY = Study(
    cases=lambda options: ((k,) for k in options.seeds),
    score=score,
    summary=summary,
    seeds="0:40",
    options={
        "--garbled": {"type": float, "default": 0.01, "help": "share of packets with a damaged byte"},
        "--lost": {"type": float, "default": 0.001, "help": "share of packets that never arrive"},
        "--experiments": {"type": int, "default": 0, "help": "go round with at most so many experiments"},
        "--late": {"type": float, "default": 0.002, "help": "share of answers that come 8 ms late"},
    },
)
