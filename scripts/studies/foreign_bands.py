"""Whether the band of a calibrated twin holds for legs with something that the twin has not.

    python scripts/study.py foreign_bands --seeds 5000:5003

The legs are those of the study foreign_legs. Two logs of 30 s, a sweep and random levels, are used; other random levels
and a sweep of another kind are not.
"""

import argparse
import time

import numpy as np
from foreign_legs import DT, DURATION, FOREIGN, NOISE, TS, Leg
from study import Study, markdown, words

from twin.calibrate.calibration import calibrate
from twin.experiment import Experiment
from twin.log import Log
from twin.parameters import JOINTS

KINDS = ("spring", "hysteresis", "heat", "grease")


def foreign_log(kind: str, seed: int, joint: str, excitation: str, draw: int, **options: float) -> Log:
    """A log of the leg number `seed` of this kind; the leg is the same whatever its input."""
    rng = np.random.default_rng([seed, list(FOREIGN).index(kind), 36])
    u = Experiment(joint, excitation, DURATION, TS, seed=100 * seed + draw, options=options).commands()[:, 0]
    x = FOREIGN[kind](Leg(joint, u, rng))
    noise = NOISE * np.random.default_rng([seed, draw]).standard_normal(len(u))
    return Log(u, np.interp(np.arange(len(u)) * TS, np.arange(len(x)) * DT, x) + noise, TS, None, joint, {})


def score(case: tuple[str, int], options: argparse.Namespace) -> dict[str, object]:
    """The share of the samples within the band, and errors [deg], for each of the logs that were not used."""
    kind, seed = case
    joint = str(np.random.default_rng([seed, 37]).choice(JOINTS))
    half = 2.0 if joint == "shoulder" else 7.5
    logs = [
        foreign_log(kind, seed, joint, "sweep", 1, half_period=half, jitter=0.2, shrink=0.25, first=0.6),
        foreign_log(kind, seed, joint, "aprbs", 2),
        foreign_log(kind, seed, joint, "aprbs", 3),
        foreign_log(kind, seed, joint, "sweep", 4, half_period=half, jitter=0.5, shrink=0.5, first=0.6),
    ]
    begun = time.process_time()
    result = calibrate(logs[:2], joint, held_out=logs[2:], threads=1)
    held = [each for each in result.scores if each.held_out]
    return {
        "kind": kind,
        "joint": joint,
        "cpu": time.process_time() - begun,
        "inside": [each.inside for each in held],
        "before": [float(np.degrees(each.rms_before)) for each in held],
        "after": [float(np.degrees(each.rms_after)) for each in held],
    }


def summary(rows: list[dict], options: argparse.Namespace) -> str:
    """How much of the logs that were not used lies within their bands, by kind."""
    lines = []
    for kind in options.kinds:
        group = [row for row in rows if row["kind"] == kind]
        inside, after = (np.concatenate([row[name] for row in group]) for name in ("inside", "after"))
        lines.append(
            [kind, len(inside), f"{100 * inside.mean():.0f} %", f"{100 * inside.min():.0f} %",
             f"{np.mean((inside > 0.9) & (inside < 0.98)):.0%}", f"{np.median(after):.2f}, at most {after.max():.2f}"]
        )  # fmt: skip
    headings = ["foreign", "logs not used", "inside the band", "worst", "of 90 to 98 %", "error after [deg]"]
    return markdown(headings, lines) + "\n"


STUDY = Study(
    cases=lambda options: [(kind, seed) for seed in options.seeds for kind in options.kinds],
    score=score,
    summary=summary,
    seeds="5000:5003",
    options={"--kinds": {"type": words, "default": list(KINDS)}},
)
