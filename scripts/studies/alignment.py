"""Whether the intervals of an alignment hold, on logs of a twin that departs from the nominal one in several ways.

python scripts/study.py alignment --seeds 1000:1040 --workers 2
"""

import argparse
from typing import Any

import numpy as np
from study import Study

from twin.compare.alignment import align
from twin.compare.search import Trials
from twin.compare.standins import DURATION, TS
from twin.compare.verdict import explain
from twin.experiment import Experiment
from twin.follow import Follower
from twin.hardware.linkage import middle
from twin.log import Log
from twin.parameters import JOINTS, Parameters

NAMES = ("delay", "gear", "offset")


def draw(seed: int, mismatch: bool) -> tuple[Log, str, dict[str, float]]:
    """A log, its joint, and the truth about how it is read."""
    rng, p = np.random.default_rng([seed, 99]), Parameters()
    joint = str(rng.choice(JOINTS))
    experiment = Experiment(
        joint, "sweep", 10.0 if joint == "shoulder" else DURATION, TS, seed, options={"jitter": 0.5, "shrink": 0.4}
    )
    plan = Log(experiment.commands()[:, 0], np.full(experiment.N, middle(p, joint)), TS, joint=joint)
    changes = {
        f"{joint}.coulomb": p[f"{joint}.coulomb"] * rng.uniform(0.8, 1.25),
        f"{joint}.asymmetry": p[f"{joint}.asymmetry"] + rng.uniform(-0.1, 0.1),
        f"{joint}.stribeck": p[f"{joint}.stribeck"] * rng.uniform(0.5, 1.5),
        f"{joint}.rated_voltage": p[f"{joint}.rated_voltage"] * rng.uniform(0.95, 1.05),
        f"{joint}.backlash": p[f"{joint}.backlash"] * rng.uniform(0.5, 2.0),
        "foot_mass": p["foot_mass"] + rng.uniform(0.0, 0.3),
        "supply_resistance": p["supply_resistance"] * rng.uniform(0.5, 2.0),
        "dead_band": p["dead_band"] * rng.uniform(0.5, 2.0),
        # These an alignment does not move.
        f"{joint}.load_friction": p[f"{joint}.load_friction"] * rng.uniform(0.8, 1.2),
        f"{joint}.rotor_inertia": p[f"{joint}.rotor_inertia"] * rng.uniform(0.7, 1.4),
        f"{joint}.stribeck_speed": p[f"{joint}.stribeck_speed"] * rng.uniform(0.5, 2.0),
        "pot_linearity": p["pot_linearity"] * rng.uniform(0.0, 2.0),
    }
    truth = {
        "delay": float(rng.uniform(-0.02, 0.08)),
        "gear": float(rng.uniform(0.97, 1.03)),
        "offset": float(rng.uniform(-0.03, 0.03)),
    }
    course = Follower(plan, joint, threads=1)
    (row,) = course.courses([p.replace(changes if mismatch else {})])
    y = truth["gear"] * course.sample_course(row, truth["delay"]) + truth["offset"]
    y = y + p["pot_noise"] * rng.standard_normal(len(y))
    return Log(plan.u, y, TS, joint=joint), joint, truth


def score(case: tuple[int], options: argparse.Namespace) -> dict[str, Any]:
    """By name of `NAMES`: whether there is an interval, whether it holds, its error and its half width."""
    log, joint, truth = draw(*case, not options.exact)
    trials = Trials(Follower(log, joint, threads=1), Parameters())
    alignment = align(trials, None if options.bare else explain(trials))
    row: dict[str, Any] = {"joint": joint}
    for name in NAMES:
        value = getattr(alignment, name)
        has_interval = value.low is not None
        half = (value.high - value.low) / 2 if has_interval else np.inf
        row[name] = has_interval, value.holds(truth[name]), value.value - truth[name], half
    return row


def line(row: dict[str, Any]) -> str:
    """The errors of one log."""
    values = (f"{n} {row[n][2]:+.4f} +- {row[n][3]:.4f} {'in' if row[n][1] else 'OUT'};" for n in NAMES)
    return " ".join(map(str, (*row["case"], row["joint"], *values)))


def summary(rows: list[dict[str, Any]], options: argparse.Namespace) -> str:
    """How often there is an interval and how often it holds, by name."""
    lines = []
    for name in NAMES:
        has_interval, holds, error, half = np.array([row[name] for row in rows], dtype=float).T
        lines.append(
            f"{name}: interval in {has_interval.sum():.0f} of {len(rows)}, holds in {holds.sum():.0f}; median error "
            f"{np.median(np.abs(error)):.4f}, median half width {np.median(half):.4f}"
        )
    return "\n".join(lines)


STUDY = Study(
    cases=lambda options: ((seed,) for seed in options.seeds),
    score=score,
    summary=summary,
    seeds="1000:1040",
    options={
        "--exact": {"action": "store_true", "help": "a twin without mismatch"},
        "--bare": {"action": "store_true", "help": "without the effects that a verdict names"},
    },
    line=line,
)
