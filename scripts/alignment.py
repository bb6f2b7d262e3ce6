"""Whether the intervals of an alignment hold, on logs of a twin that departs from the nominal one in several ways.

.venv/bin/python scripts/alignment.py --first 1000 --number 40 --jobs 2
"""

import argparse

import numpy as np
from joblib import Parallel, delayed

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


def drawn(seed: int, mismatch: bool) -> tuple[Log, str, dict[str, float]]:
    """A log, its joint, and the truth about how it is read."""
    rng, p = np.random.default_rng([seed, 99]), Parameters()
    joint = str(rng.choice(JOINTS))
    own = Experiment(
        joint, "sweep", 10.0 if joint == "shoulder" else DURATION, TS, seed, options={"jitter": 0.5, "shrink": 0.4}
    )
    plan = Log(own.commands()[:, 0], np.full(own.N, middle(p, joint)), TS, joint=joint)
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
    y = truth["gear"] * course.at(row, truth["delay"]) + truth["offset"]
    y = y + p["pot_noise"] * rng.standard_normal(len(y))
    return Log(plan.u, y, TS, joint=joint), joint, truth


def judge(seed: int, mismatch: bool, named: bool) -> list[tuple[bool, bool, float, float]]:
    """Whether there is an interval, whether it holds, its error and its half width, for each of `NAMES`."""
    log, joint, truth = drawn(seed, mismatch)
    trials = Trials(Follower(log, joint, threads=1), Parameters())
    found = align(trials, explain(trials) if named else None)
    rows = []
    for name in NAMES:
        value = getattr(found, name)
        known = value.low is not None
        half = (value.high - value.low) / 2 if known else np.inf
        rows.append((known, value.holds(truth[name]), value.value - truth[name], half))
    words = (f"{n} {r[2]:+.4f} +- {r[3]:.4f} {'in' if r[1] else 'OUT'};" for n, r in zip(NAMES, rows, strict=True))
    print(seed, joint, *words, flush=True)
    return rows


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--first", type=int, default=1000)
    parser.add_argument("--number", type=int, default=40)
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--exact", action="store_true", help="a twin without mismatch")
    parser.add_argument("--bare", action="store_true", help="without the effects that a verdict names")
    given = parser.parse_args()
    seeds = range(given.first, given.first + given.number)
    rows = np.array(Parallel(given.jobs)(delayed(judge)(seed, not given.exact, not given.bare) for seed in seeds))
    for k, name in enumerate(NAMES):
        known, held, error, half = rows[:, k].T
        print(
            f"{name}: interval in {known.sum():.0f} of {len(rows)}, holds in {held.sum():.0f}; median error "
            f"{np.median(np.abs(error)):.4f}, median half width {np.median(half):.4f}"
        )


if __name__ == "__main__":
    main()
