"""Faults put into the real firmware, executed in simavr: how many drove off within 50 ms of when they could be seen.

    python scripts/study.py rig_faults [--seeds 0:16]

A case is one run of three drawn joints with random levels at 200 Hz, and a fault of one kind at a random time and a
random byte; twin/rig/faults.py says from when on each kind can be seen. A stuck sensor is seen when the stall time
(0.25 s, driven), the quarter of it in which it may have begun, and 20 ms are over; a motor that changes its sign when
the joint has gone back by the least motion (0.6 % of a full reading, and 0.15 % of noise) further than one whose sign
did not change. Where the drive was off before, 0 ms count. A case is met if the drive was off in time, stayed off while
the host went on, and the firmware called the fault by its name. Besides, runs of 10 s without a fault, with 1 % of the
host's frames damaged: nothing may stop them.
"""

import argparse
from collections import Counter
from dataclasses import asdict
from typing import Any

import numpy as np
from study import Study, markdown

from twin.rig import wire
from twin.rig.faults import ALLOWED, HEALTHY, KINDS, healthy, outcome


def cases(options: argparse.Namespace) -> list[tuple[str, int]]:
    """Kinds and seeds."""
    return [(kind, seed) for kind in (*KINDS, HEALTHY) for seed in options.seeds]


def score(case: tuple[str, int], options: argparse.Namespace) -> dict[str, Any]:
    """Times [s] of a run with a fault, or what happened in one without."""
    kind, seed = case
    if kind == HEALTHY:
        run = healthy(seed)
        return {"met": run.reason == 0 and run.missing == 0} | asdict(run)
    result = outcome(kind, seed)
    return {"met": result.met, "late": result.late, "after": result.off - result.began} | asdict(result)


def summary(rows: list[dict[str, Any]], options: argparse.Namespace) -> str:
    """A row for each kind of fault, and a sentence about runs without one."""
    faults = [row for row in rows if row["case"][0] != HEALTHY]
    cells = []
    for kind in KINDS:
        part = [row for row in faults if row["case"][0] == kind]
        late, after = (1000 * np.array([row[name] for row in part], dtype=float) for name in ("late", "after"))
        names = Counter(wire.FAULTS.get(row["reason"], "not heard") for row in part)
        met = sum(row["met"] for row in part)
        figures = (f"{np.median(late):.1f}", f"{np.max(late):.1f}", f"{np.max(after):.0f}") if part else ("", "", "")
        cells.append((kind, f"{met} of {len(part)}", *figures, "; ".join(f"{n} {name}" for name, n in names.items())))
    heads = ("fault", f"off in {1000 * ALLOWED:.0f} ms", "ms, median", "ms, worst", "ms after the fault, worst", "told")
    quiet = [row for row in rows if row["case"][0] == HEALTHY]
    missing, told = (sum(row[name] for row in quiet) for name in ("missing", "samples"))
    return (
        f"{markdown(heads, cells)}\n\n{sum(row['met'] for row in faults)} of {len(faults)} faults. Of {len(quiet)} "
        f"runs of 10 s without a fault {sum(row['reason'] != 0 for row in quiet)} were stopped; {missing} of {told} "
        "samples are missing."
    )


def line(row: dict[str, Any]) -> str:
    """One case."""
    kind, seed = row["case"]
    return f"{kind} {seed}: {'met' if row['met'] else 'MISSED'}" + (
        f" {1000 * row['late']:.1f} ms" if "late" in row else ""
    )


STUDY = Study(cases, score, summary, seeds="0:16", line=line, fails=lambda rows: not all(row["met"] for row in rows))
