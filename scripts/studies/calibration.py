"""Calibration of stand-ins for the rig, counted: whether intervals hold, held-out fit, seconds.

    python scripts/study.py calibration --seeds 1000:1017 --out runs/calibration.jsonl

Stand-ins and their ranges are in twin/bench/standin.py. Each seed is calibrated for each joint, with the twin's
structure ("same") and with effects that the twin lacks ("other").
"""

import itertools
import time
from collections import defaultdict

import numpy as np
from study import Study, markdown, words

import twin
from twin.bench.standin import LACKS, StandIn
from twin.calibrate.calibration import calibrate

KINDS = ("same", "other")
SCORES = (
    *("joint", "structure", "n", "inside 95 %", "band holds", "its worst", "worst loss", "median"),
    *("times closer, worst", "CPU s", "converged"),
)
INTERVALS = ("parameter", "same: inside", "other: inside", "error before", "error after, other", "noise's share")


def score(case, options):
    """Everything that the tables count, for one stand-in: (joint, seed, kind)."""
    joint, seed, kind = case
    rig = StandIn(joint, seed, kind == "same")
    logs, fresh = rig.calibration(), rig.fresh()
    sweep = {"half_period": 2.0 if joint == "shoulder" else 7.5, "jitter": 0.5, "shrink": 0.5, "first": 0.6}
    held_out = [rig.log("aprbs", 30.0, 7), rig.log("sweep", 30.0, 8, **sweep), fresh]
    start, cpu_start = time.perf_counter(), time.process_time()
    calibration = calibrate(logs, joint, without=LACKS, held_out=held_out, threads=options.threads)
    seconds, cpu = time.perf_counter() - start, time.process_time() - cpu_start
    scores, run = calibration.scores[-1], calibration.runs[-1]
    return {
        "joint": joint,
        "seed": seed,
        "kind": kind,
        "seconds": seconds,
        "cpu": cpu,
        "converged": calibration.converged,
        "free": len(calibration.values) + len(calibration.fixed),
        "ceiling": 100 * (1 - np.sqrt(np.mean((fresh.y - fresh.y_true) ** 2)) / np.std(fresh.y)),
        "before": scores.fit_before,
        "after": scores.fit_after,
        "error_before": float(np.degrees(np.sqrt(np.mean((fresh.y_true - run.before) ** 2)))),
        "error_after": float(np.degrees(np.sqrt(np.mean((fresh.y_true - run.after) ** 2)))),
        "values": {
            value.name.rpartition(".")[2]: {
                "true": rig.parameters[value.name],
                "value": value.value,
                "low": value.low,
                "high": value.high,
                "nominal": value.nominal,
                "noise": value.noise_share,
            }
            for value in calibration.values
        },
        "band": [each.inside for each in calibration.scores if each.held_out],
        "fixed": [name.rpartition(".")[2] for name in calibration.fixed],
    }


def holds(value):
    """Whether an interval holds the truth."""
    return value["low"] <= value["true"] <= value["high"]


def summary(rows, options):
    """Markdown: scores by joint and kind, then intervals by parameter."""
    scores = []
    for kind in KINDS:
        for joint in (*twin.JOINTS, "all"):
            group = [row for row in rows if row["kind"] == kind and joint in (row["joint"], "all")]
            if not group:
                continue
            holding = [holds(value) for row in group for value in row["values"].values()]
            loss = [row["ceiling"] - row["after"] for row in group]
            closer = [row["error_before"] / row["error_after"] for row in group]
            cpu, band = [row["cpu"] for row in group], [share for row in group for share in row["band"]]
            scores.append(
                [joint, kind, len(group), f"{100 * np.mean(holding):.1f} % of {len(holding)}",
                 f"{100 * np.mean(band):.0f} % of {len(band)} logs", f"{100 * min(band):.0f} %", f"{max(loss):.2f}",
                 f"{np.median(loss):.2f}", f"{min(closer):.1f}", f"{np.median(cpu):.0f}, at most {max(cpu):.0f}",
                 sum(row["converged"] for row in group)]
            )  # fmt: skip
    values_of = defaultdict(lambda: defaultdict(list))
    for row in rows:
        for name, value in row["values"].items():
            values_of[name][row["kind"]].append(value)
    intervals = []
    for name, by_kind in values_of.items():
        holding = [f"{sum(map(holds, by_kind[kind]))} of {len(by_kind[kind])}" for kind in KINDS]
        values = by_kind["other"] or by_kind["same"]
        errors = (
            np.median([abs(v[key] - v["true"]) / max(abs(v["true"]), 1e-12) for v in values])
            for key in ("nominal", "value")
        )
        share = np.median([v["noise"] for v in values])
        intervals.append([name, *holding, *(f"{100 * error:.1f} %" for error in errors), f"{100 * share:.0f} %"])
    return f"{markdown(SCORES, scores, 2)}\n\n{markdown(INTERVALS, intervals)}"


STUDY = Study(
    cases=lambda options: itertools.product(options.joints, options.seeds, options.kinds),
    score=score,
    summary=summary,
    seeds="1000:1017",
    options={
        "--joints": {"type": words, "default": list(twin.JOINTS)},
        "--kinds": {"type": words, "default": list(KINDS)},
        "--threads": {"type": int, "help": "of each calibration; give 1 with several --workers"},
    },
)
