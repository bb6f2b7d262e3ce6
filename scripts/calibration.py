"""Calibration of stand-ins for the rig, counted: whether intervals hold, held-out fit, seconds; and the pictures.

    python scripts/calibration.py --seeds 1000:1017 --journal runs/calibration.jsonl   # resumes
    python scripts/calibration.py --journal runs/calibration.jsonl                     # tables alone
    python scripts/calibration.py --toolbox --seeds 1000:1003                          # mujoco.sysid on the same task
    python scripts/calibration.py --page                                               # the story of docs/calibrate.md

Stand-ins and their ranges are in twin/bench/standin.py. Each seed is calibrated for each joint, with the twin's
structure ("same") and with effects that the twin lacks ("other"). The row of `mujoco.sysid` needs
`pip install mujoco[sysid]`.
"""

import argparse
import itertools
import json
import sys
import time
from collections import defaultdict
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT / "tests"))

from standin import LACKS, StandIn  # noqa: E402

import twin  # noqa: E402
from sysid.base.parallel import results  # noqa: E402
from twin.calibrate.calibration import calibrate  # noqa: E402

KINDS = ("same", "other")


def one(job):
    """Everything that the tables count, for one stand-in: (joint, seed, kind, threads)."""
    joint, seed, kind, threads = job
    rig = StandIn(joint, seed, kind == "same")
    logs, fresh = rig.calibration(), rig.fresh()
    began, worked = time.perf_counter(), time.process_time()
    found = calibrate(logs, joint, without=LACKS, held_out=[fresh], threads=threads)
    seconds, cpu = time.perf_counter() - began, time.process_time() - worked
    score, run = found.scores[-1], found.runs[-1]
    return {
        "joint": joint,
        "seed": seed,
        "kind": kind,
        "seconds": seconds,
        "cpu": cpu,
        "converged": found.converged,
        "free": len(found.values) + len(found.fixed),
        "ceiling": 100 * (1 - np.sqrt(np.mean((fresh.y - fresh.y_true) ** 2)) / np.std(fresh.y)),
        "before": score.fit_before,
        "after": score.fit_after,
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
            for value in found.values
        },
        "fixed": [name.rpartition(".")[2] for name in found.fixed],
    }


def read(journal):
    """The rows of a journal, one for each stand-in."""
    lines = journal.read_text(encoding="utf-8").splitlines() if journal.is_file() else []
    rows = map(json.loads, lines)
    return list({(row["joint"], row["seed"], row["kind"]): row for row in rows}.values())


def holds(value):
    return value["low"] <= value["true"] <= value["high"]


def tables(rows):
    """Markdown: scores by joint and kind, then intervals by parameter."""
    out = ["| joint | structure | n | inside 95 % | worst loss | median | times closer, worst | CPU s | converged |"]
    out.append("| :-- | :-- | --: | --: | --: | --: | --: | --: | --: |")
    for kind in KINDS:
        for joint in (*twin.JOINTS, "all"):
            mine = [row for row in rows if row["kind"] == kind and joint in (row["joint"], "all")]
            if not mine:
                continue
            inside = [holds(value) for row in mine for value in row["values"].values()]
            loss = [row["ceiling"] - row["after"] for row in mine]
            closer = [row["error_before"] / row["error_after"] for row in mine]
            cpu = [row["cpu"] for row in mine]
            share = f"{100 * np.mean(inside):.1f} % of {len(inside)}"
            out.append(
                f"| {joint} | {kind} | {len(mine)} | {share} | {max(loss):.2f} | "
                f"{np.median(loss):.2f} | {min(closer):.1f} | {np.median(cpu):.0f}, at most {max(cpu):.0f} | "
                f"{sum(row['converged'] for row in mine)} |"
            )
    out += ["", "| parameter | same: inside | other: inside | error before | error after, other | noise's share |"]
    out.append("| :-- | --: | --: | --: | --: | --: |")
    named = defaultdict(lambda: defaultdict(list))
    for row in rows:
        for name, value in row["values"].items():
            named[name][row["kind"]].append(value)
    for name, by in named.items():
        cells = [f"{sum(map(holds, by[kind]))} of {len(by[kind])}" for kind in KINDS]
        both = by["other"] or by["same"]
        before, after = (
            np.median([abs(v[of] - v["true"]) / max(abs(v["true"]), 1e-12) for v in both])
            for of in ("nominal", "value")
        )
        share = np.median([v["noise"] for v in both])
        out.append(
            f"| {name} | {' | '.join(cells)} | {100 * before:.1f} % | {100 * after:.1f} % | {100 * share:.0f} % |"
        )
    return "\n".join(out)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", default="", help="first:after the last")
    parser.add_argument("--joints", default=",".join(twin.JOINTS))
    parser.add_argument("--kinds", default=",".join(KINDS))
    parser.add_argument("--journal", type=Path, default=Path("runs/calibration.jsonl"))
    parser.add_argument("--threads", type=int, default=None)
    parser.add_argument("--jobs", type=int, default=1, help="processes; give --threads 1 with more than one")
    parser.add_argument("--scheduler", help="address of a Dask scheduler, instead of --jobs")
    parser.add_argument("--toolbox", action="store_true")
    parser.add_argument("--page", action="store_true")
    given = parser.parse_args()
    seeds = range(*map(int, given.seeds.split(":"))) if given.seeds else ()
    if given.page:
        from calibration_page import story

        return story(ROOT / "docs")
    if given.toolbox:
        from calibration_toolbox import row

        for seed in seeds:
            for joint in given.joints.split(","):
                print(row(joint, seed), flush=True)
        return None
    given.journal.parent.mkdir(parents=True, exist_ok=True)
    done = {(row["joint"], row["seed"], row["kind"]) for row in read(given.journal)}
    every = itertools.product(given.joints.split(","), seeds, given.kinds.split(","))
    jobs = [(*key, given.threads) for key in every if key not in done]
    for _, row in results(one, jobs, given.jobs, given.scheduler):
        with given.journal.open("a", encoding="utf-8") as file:
            file.write(json.dumps(row, default=float) + "\n")
    print(tables(read(given.journal)))
    return None


if __name__ == "__main__":
    main()
