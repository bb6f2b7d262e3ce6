"""What a joint of a drawn leg loses on a sweep that it has not seen, and on another kind of input.

    python scripts/study.py joint_transfer [--seeds 0:8] [--joints shoulder,thigh,shank] [--stairs]

Legs are those of `drawn_joints`. A joint is estimated from one sweep of 125 s at 0.1 s (`--stairs`: and from slow
stairs), by growth and with all parts at once (`sysid.joint_posterior`). Its free run is compared with the noise
ceiling on a fresh sweep, and on levels and times drawn at random over the whole supply (aprbs). "found" are joints
within 0.5 points.
"""

import argparse
import time

import numpy as np
from drawn_joints import DURATION, TS, below_ceiling, leg, records
from study import Row, Study, words

import twin
from sysid.joint.growth import grow_joint
from sysid.joint.posterior import joint_posterior
from sysid.structures import actuated_joint
from twin.hardware.actuator import drive

WAYS = {
    "growth": lambda data, plain, seed: grow_joint(data, plain, starts=2, seed=seed).fit,
    "all parts": lambda data, plain, seed: joint_posterior(data, plain, seed=seed),
}
KINDS = ("same kind", "another kind")


def score(case: tuple[str, int], options: argparse.Namespace) -> Row:
    """Points below the ceiling on both kinds of input, and seconds, of both ways."""
    joint, seed = case
    p = leg(joint, seed)
    data, fresh = records(joint, seed, p)
    data = data if options.stairs else data.experiments[0]
    amplitude = {"amplitude": p["supply_voltage"]}
    other = twin.Experiment(joint, "aprbs", DURATION, TS, 3 * seed + 3, (), p, amplitude).run()
    row: Row = {"joint": joint, "seed": seed}
    for name, way in WAYS.items():
        start = time.process_time()
        fit = way(data, actuated_joint(play=False, driver_step=drive(p, joint).step), seed)
        row[name] = {"seconds": time.process_time() - start}
        for kind, log in zip(KINDS, (fresh, other), strict=True):
            row[name][kind] = below_ceiling(fit, log)
    return row


def summary(rows: list[Row], options: argparse.Namespace) -> str:
    """Found, within 2 points, median and worst by way and kind of input."""
    lines = []
    for name in WAYS:
        seconds = np.median([row[name]["seconds"] for row in rows])
        for kind in KINDS:
            x = np.array([row[name][kind] for row in rows])
            worst = rows[int(np.argmax(x))]
            lines.append(
                f"{name:10s} {kind:12s} n {len(x)}  found {np.sum(x <= 0.5)}  within 2 {np.sum(x <= 2.0)}  median "
                f"{np.median(x):.2f}  worst {x.max():.1f} ({worst['joint']} {worst['seed']})  {seconds:.1f} s CPU"
            )
    return "\n".join(lines)


STUDY = Study(
    cases=lambda options: ((joint, seed) for seed in options.seeds for joint in options.joints),
    score=score,
    summary=summary,
    seeds="0:8",
    options={
        "--joints": {"type": words, "default": ["shoulder", "thigh", "shank"]},
        "--stairs": {"action": "store_true", "help": "estimate from slow stairs beside the sweep"},
    },
)
