"""What it brings to take the plain joint where the record makes it likelier: drives without parts, and drawn legs.

    python scripts/study.py plain_joints [--seeds 0:24] [--kinds drive,loaded,leg]

A drive is a motor behind dry friction in Euler steps that are written here, with another load in every loaded one; it
is fitted to half of a record of drawn levels and judged on the other half. A leg is drawn with all its imperfections,
fitted to a sweep and judged on stairs.
"""

from typing import Any

import numpy as np
from drawn_joints import leg, records
from study import Study, markdown, words

from sysid.blocks import Motor
from sysid.data.record import IOData
from sysid.estimation.result import Fit
from sysid.joint import posterior
from sysid.structures import actuated_joint
from twin.hardware.actuator import drive as driver

TS, N, FINE = 0.02, 900, 20  # [s], samples, Euler steps a sample
JOINTS = ("thigh", "shank", "shoulder")


def drive(seed: int, loaded: bool) -> IOData:
    """The record of a drawn drive."""
    rng = np.random.default_rng(seed)
    gain, lag, friction = rng.uniform(0.2, 2.0), rng.uniform(0.03, 0.3), rng.uniform(0.1, 1.0)
    load = rng.uniform(-0.3, 0.3) * friction if loaded else 0.0
    largest, hold = rng.uniform(2.0, 8.0) * friction + 1.0, int(rng.integers(10, 60))
    u = np.repeat(rng.uniform(-largest, largest, N // hold + 1), hold)[:N]
    y, x, v = np.zeros(N), 0.0, 0.0
    for k in range(N):
        y[k] = x
        for _ in range(FINE):
            drives = u[k] - load
            way = np.sign(v) if v else np.sign(drives)
            end = gain * (drives - way * friction) if v or abs(drives) > friction else 0.0
            after = v + TS / FINE / lag * (end - v)
            v = 0.0 if v * after < 0.0 else after
            x += TS / FINE * v
    return IOData(u, y + rng.uniform(0.0005, 0.005) * np.ptp(y) * rng.standard_normal(N), TS)


def score(case: tuple[str, int], options: Any) -> dict[str, Any]:
    """Free-run fits [%] on the unseen record of the joint with all parts and of the one taken, and the odds."""
    kind, seed = case
    if kind == "leg":
        joint = JOINTS[seed % len(JOINTS)]
        p = leg(joint, seed)
        seen, unseen = records(joint, seed, p)[0].experiments
        plain = actuated_joint(play=False, driver_step=driver(p, joint).step)
    else:
        record = drive(seed, kind == "loaded")
        seen, unseen = record.select(0, N // 2), record.select(N // 2, N)
        plain = actuated_joint(play=False, motor=Motor(load=3, stops=False), knots=None)
    full: list[Fit] = []
    likelier = posterior._Search.likelier
    posterior._Search.likelier = lambda search, fit: full.append(fit) or likelier(search, fit)  # type: ignore
    try:
        taken = posterior.fit_joint(seen, plain, seed=seed)
    finally:
        posterior._Search.likelier = likelier  # type: ignore
    fits = [fit.fit_percent(unseen) for fit in (*full, taken.fit)]
    return {"kind": kind, "seed": seed, "all_parts": fits[0], "taken": fits[-1], "log_odds": taken.log_odds}


def summary(rows: list[dict[str, Any]], options: Any) -> str:
    """A row for each kind: how often the plain joint was taken, and the points that this changed."""
    table = []
    for kind in options.kinds:
        own = [row for row in rows if row["kind"] == kind]
        change = np.array([row["taken"] - row["all_parts"] for row in own if row["log_odds"] < 0.0])
        ends = f"{change.min():+.1f} to {change.max():+.1f}" if len(change) else "–"
        table.append((kind, len(own), len(change), int(np.sum(change > 0.0)), ends))
    return markdown(("records", "n", "plain taken", "better on the unseen", "points"), table)


STUDY = Study(
    cases=lambda options: [(kind, seed) for kind in options.kinds for seed in options.seeds],
    score=score,
    summary=summary,
    seeds="0:24",
    options={"--kinds": {"type": words, "default": ["drive", "loaded", "leg"]}},
    line=lambda row: (
        f"{row['kind']} {row['seed']}: {row['all_parts']:.2f} to {row['taken']:.2f} %, {row['log_odds']:.1f}"
    ),
)
