"""From a plugged-in rig to values: the loop of `qpal rig auto` on drawn hidden legs behind a noisy emulated cable.

    python scripts/study.py rig_loop [--seeds 0:5] [--joints shoulder,thigh,shank] [--ways designed,sweeps]
        [--garbled 0.01] [--lost 0.001]

Each seed is another leg with another wiring. The rig is wired, zeroed and goes round as the verb does; beside it
stands the same rig with plain sweeps in place of designed experiments. Told are the rig time, the experiments, how many
of the asked values that are identifiable are determined, and of all that are determined how many intervals hold the
truth. A backlash is identifiable if some input brings the twin's link from one side of it to the other.
"""

import argparse
import time

import numpy as np
from scipy.stats import binom
from study import Row, Study, markdown, words

from twin.bench.standin import draw_parameters
from twin.parameters import JOINTS
from twin.rig.auto import ASKED, BUDGET, MOST, TS, Campaign, campaign
from twin.rig.calibration import of_joint
from twin.rig.emulator import Emulator
from twin.rig.link import Link
from twin.rig.wiring import find_ends, find_wiring, zero
from twin.studies.beyond import link_crosses

WAYS = ("designed", "sweeps")


def loop(joint: str, seed: int, way: str, garbled: float, lost: float) -> tuple[Campaign, dict[str, float]]:
    """The campaign on a drawn leg, with the wiring and the zero before it, and the hidden values."""
    with Emulator(joint, seed, garbled=garbled, lost=lost) as emulator, Link(emulator.port) as link:
        known = of_joint(link.port, joint, JOINTS.index(joint), emulator.supply, emulator.supply, emulator.linearity)
        wired = find_wiring(link, known, lambda sentence: None)
        ends = find_ends(link, wired, lambda sentence: None, lambda end, counts: emulator.plant.angle_of(counts))
        calibration = zero(wired, ends)
        return campaign(link, calibration, seed, plain_sweeps=way == "sweeps"), emulator.truth(TS)


def score(case: tuple[str, int, str], options: argparse.Namespace) -> Row:
    """One leg: rig time, experiments, values that are determined, and intervals that hold."""
    joint, seed, way = case
    start = time.process_time()
    result, true = loop(joint, seed, way, options.garbled, options.lost)
    values = result.values_after(len(result.rounds))
    determined = [name for name in ASKED if name not in result.open]
    rigs = [done.log.meta["rig"] for done in result.rounds]
    return {
        "rig_seconds": result.rig_seconds,
        "experiments": len(result.rounds),
        "identifiable": [
            name for name in ASKED if name != "backlash" or link_crosses(joint, draw_parameters(joint, seed))
        ],
        "determined": determined,
        "holds": [name for name in determined if values[name].holds(true[name])],
        "widths": {name: (values[name].high - values[name].low) / abs(true[name]) for name in determined},
        "samples": sum(done.log.N for done in result.rounds),
        "lost": sum(int(np.isnan(done.log.y).sum()) for done in result.rounds),
        "early": [rig["ended_early"] for rig in rigs if rig["ended_early"]],
        "stopped": result.stopped,
        "seconds": time.process_time() - start,
    }


def line(row: Row) -> str:
    """How the loop went on one leg."""
    missing = [name for name in row["identifiable"] if name not in row["determined"]]
    wrong = [name for name in row["determined"] if name not in row["holds"]]
    return (
        f"{' '.join(map(str, row['case']))}: {row['rig_seconds']:.0f} s, {row['experiments']} experiments, open "
        f"{missing}, missed {wrong}, {row['lost']} of {row['samples']} samples lost, {row['early']} {row['stopped']}"
    )


def summary(rows: list[Row], options: argparse.Namespace) -> str:
    """A line for each joint and way."""
    table = []
    for way in WAYS:
        for joint in (*options.joints, "all"):
            group = [row for row in rows if row["case"][2] == way and joint in ("all", row["case"][0])]
            if not group:
                continue
            missing = [set(row["identifiable"]) - set(row["determined"]) for row in group]
            n_values, n_told = (sum(len(row[key]) for row in group) for key in ("identifiable", "determined"))
            n_held = sum(len(row["holds"]) for row in group)
            low, high = binom.interval(0.95, max(n_told, 1), 0.95)
            table.append(
                (
                    way,
                    joint,
                    len(group),
                    f"{np.median([row['rig_seconds'] for row in group]):.0f}",
                    f"{max(row['rig_seconds'] for row in group):.0f}",
                    f"{np.mean([row['experiments'] for row in group]):.1f}",
                    f"{n_values - sum(map(len, missing))} of {n_values}",
                    sum(not names for names in missing),
                    f"{n_held} of {n_told}",
                    f"{low:.0f} to {high:.0f}",
                )
            )
    headings = ("experiments", "joint", "legs", "rig time, median [s]", "largest [s]", "experiments, mean")
    headings += ("identifiable values determined", "legs with all", "intervals that hold", "expected of 95 %")
    text = markdown(headings, table, texts=2)
    noise = f"{options.garbled:.1%} of lines garbled, {options.lost:.1%} lost"
    return f"At most {MOST} experiments and {BUDGET:g} s; {noise}.\n{text}"


STUDY = Study(
    cases=lambda options: (
        (joint, seed, way) for seed in options.seeds for joint in options.joints for way in options.ways
    ),
    score=score,
    summary=summary,
    seeds="0:5",
    options={
        "--joints": {"type": words, "default": list(JOINTS)},
        "--ways": {"type": words, "default": list(WAYS)},
        "--garbled": {"type": float, "default": 0.01},
        "--lost": {"type": float, "default": 0.001},
    },
    line=line,
)
