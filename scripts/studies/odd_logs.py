"""Whether calibrate names what differs between three logs of one leg, and in which of them; or that nothing does.

    python scripts/study.py odd_logs --seeds 18:36

Drawn are the joint, the leg's values, the inputs (random levels or a sweep), the odd log, and what is off in it.
"""

import argparse
import time
from collections.abc import Callable

import numpy as np
from study import Study, markdown, words

from twin.calibrate.calibration import calibrate
from twin.experiment import Experiment
from twin.log import Log
from twin.parameters import JOINTS, TABLE, Parameters

TS, DURATION = 0.05, 20.0
NOTHING = "nothing"
CHANGES: dict[str, Callable[[np.random.Generator], float]] = {  # of a value its share; the zero in rad, the delay in s
    "no_load_speed": lambda rng: float(rng.choice([-1, 1]) * rng.uniform(0.04, 0.1)),
    "coulomb": lambda rng: float(rng.choice([-1, 1]) * rng.uniform(0.2, 0.4)),
    "zero": lambda rng: float(np.deg2rad(rng.choice([-1, 1]) * rng.uniform(0.7, 2.0))),
    "delay": lambda rng: 0.02 * float(rng.choice([1, 2])),
    "load_friction": lambda rng: float(rng.choice([-0.7, 1.0])),
    NOTHING: lambda rng: 0.0,
}
_UPPER = {row.name: row.upper for row in TABLE}


def drawn_logs(joint: str, kind: str, rng: np.random.Generator) -> tuple[list[Log], int]:
    """Three logs of a leg, and the number of the one in which something is off."""
    nominal, leg, size = Parameters(), dict[str, float](), CHANGES[kind](rng)
    for name, spread in (("no_load_speed", 0.07), ("coulomb", 0.3), ("stribeck", 0.3), ("load_friction", 0.4)):
        row = f"{joint}.{name}"
        leg[row] = nominal[row] * float(np.exp(spread * rng.uniform(-1.0, 1.0)))
    leg["dead_band"] = float(rng.uniform(0.2, 0.5))
    odd, logs = int(rng.integers(3)), []
    for k in range(3):
        values, zero = dict(leg), 0.0
        if k == odd and kind == "zero":
            zero = size
        elif k == odd and kind == "delay":
            values["delay"] = nominal["delay"] + size
        elif k == odd and kind != NOTHING:
            row = f"{joint}.{kind}"
            values[row] = min(values[row] * (1.0 + size), _UPPER[row])
        levels = {"amplitude": 12.0, "hold_min": 0.5, "hold_max": 4.0}
        excitation, options = [("aprbs", levels), ("sweep", {})][int(rng.integers(2))]
        experiment = Experiment(
            joint,
            excitation,
            DURATION,
            TS,
            seed=int(rng.integers(1e6)),
            parameters=nominal.replace(values),
            options=options,
        )
        log = experiment.run()
        logs.append(Log(log.u, log.y + zero, TS, None, joint, {}))
    return logs, odd


def score(case: tuple[int], options: argparse.Namespace) -> dict[str, object]:
    """What was off, and what is named."""
    (seed,) = case
    rng = np.random.default_rng([seed, 77])
    joint, kind = JOINTS[seed % 3], options.kinds[(seed // 3) % len(options.kinds)]
    logs, odd = drawn_logs(joint, kind, rng)
    begun = time.process_time()
    result = calibrate(logs, joint, threads=1)
    found = result.differing
    names = [row.name.rpartition(".")[2] for row in found if row.rival]
    return {
        "kind": kind,
        "joint": joint,
        "named": names,
        "first": bool(names) and names[0] == kind,
        "rival": kind in names[1:],
        "odd": bool(found) and found[0].odd == odd,
        "cpu": time.process_time() - begun,
    }


def summary(rows: list[dict], options: argparse.Namespace) -> str:
    """How often the true value is named first or beside the first, and the odd log, by kind."""
    lines = []
    for kind in options.kinds:
        group = [row for row in rows if row["kind"] == kind]
        if group:
            counts = [sum(row[name] for row in group) for name in ("first", "rival", "odd")]
            nothing = sum(not row["named"] for row in group)
            lines.append([kind.replace("_", " "), len(group), *counts, nothing])
    headings = ["off in one log", "legs", "named first", "named beside", "odd log right", "nothing named"]
    return markdown(headings, lines) + "\n"


STUDY = Study(
    cases=lambda options: [(seed,) for seed in options.seeds],
    score=score,
    summary=summary,
    seeds="18:36",
    options={"--kinds": {"type": words, "default": list(CHANGES)}},
)
