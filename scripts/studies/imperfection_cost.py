"""What each imperfection of the twin costs a joint on another kind of input.

    python scripts/study.py imperfection_cost [--seeds 0:4] [--joints shoulder,thigh,shank]

Legs are those of `drawn_joints`. With all imperfections, and with each of them left out, a joint is fitted to one sweep
of 125 s at 0.1 s, and its free run is compared with the noise ceiling on levels and times drawn at random over the
whole supply (aprbs). What a joint loses less without an imperfection is what its model lacks of it. Without end stops
the actuator leaves its stroke, so they stay.
"""

import argparse

import numpy as np
from drawn_joints import DURATION, TS, below_ceiling, leg
from study import Row, Study, words

import twin
from sysid.joint.posterior import fit_joint
from sysid.structures import actuated_joint
from twin.bench.families import sweep
from twin.hardware.actuator import drive
from twin.imperfections import TABLE

LEFT_OUT = [name for name in TABLE if name != "end_stops"]


def score(case: tuple[str, int], options: argparse.Namespace) -> Row:
    """Points below the ceiling with all imperfections and without each."""
    joint, seed = case
    p = leg(joint, seed)
    plain = actuated_joint(play=False, driver_step=drive(p, joint).step)
    own, levels, row = sweep(joint, p, "voltage"), {"amplitude": p["supply_voltage"]}, Row(joint=joint, seed=seed)
    for name in ("", *LEFT_OUT):
        without = (name,) if name else ()
        data = twin.Experiment(joint, "sweep", DURATION, TS, 3 * seed, without, p, own).run().io()
        other = twin.Experiment(joint, "aprbs", DURATION, TS, 3 * seed + 3, without, p, levels).run()
        row[name] = below_ceiling(fit_joint(data, plain, seed=seed).fit, other)
    return row


def summary(rows: list[Row], options: argparse.Namespace) -> str:
    """Median and worst with all imperfections, and the points won without each, the most first."""
    complete = np.array([row[""] for row in rows])
    won = {name: complete - [row[name] for row in rows] for name in LEFT_OUT}
    lines = [f"all imperfections: n {len(rows)}, median {np.median(complete):.2f}, worst {complete.max():.1f} points"]
    for name in sorted(LEFT_OUT, key=lambda name: -float(np.mean(won[name]))):
        left = np.array([row[name] for row in rows])
        lines.append(
            f"without {name:14s} median {np.median(left):5.2f}  worst {left.max():5.1f}  won on the mean "
            f"{np.mean(won[name]):6.2f} ± {np.std(won[name], ddof=1) / np.sqrt(len(rows)):.2f}"
        )
    return "\n".join(lines)


STUDY = Study(
    cases=lambda options: ((joint, seed) for seed in options.seeds for joint in options.joints),
    score=score,
    summary=summary,
    seeds="0:4",
    options={"--joints": {"type": words, "default": ["shoulder", "thigh", "shank"]}},
)
