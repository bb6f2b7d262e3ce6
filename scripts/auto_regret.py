"""What the structure search loses against the best structure that it could have chosen, record by record.

    python scripts/auto_regret.py [--seeds 2] [--seconds 110] [--jobs 2] [--joints shoulder,thigh,shank]
                                  [--excitations sweep,aprbs,multisine,prbs] [--data DIR] [--only ced,silverbox]

Twin: 2 x 125 s of each joint under each excitation, all imperfections on; the search sees the first half, and free runs
over the second half judge it. Real records, instead of the twin's, with --data: their official parts, signals from
their own zero. The regret is the fit of the best other model less that of the search's: every structure by its defaults
and by its best row in the search's table, fitted alone to the estimation part (a joint also grown part by part).
"""

import argparse
from collections.abc import Iterator
from pathlib import Path

import numpy as np

import sysid
import twin
from sysid.base.criteria import fit_percent
from sysid.base.errors import InputError
from sysid.bench.scenarios.real import RECORDS
from sysid.data.preprocess import detrend
from sysid.data.record import IOData
from sysid.joint.growth import grow_joint
from sysid.model.recipes import Recipe
from sysid.selection.judge import AnyFit, Effort, fitted
from sysid.structures import TABLE, NonlinearArx

EXCITATIONS = "sweep,aprbs,multisine,prbs"
WITHIN = 1.0  # points of fit
FULL = Effort(5, 200, 60.0)
Records = Iterator[tuple[str, IOData, dict[str, IOData], int | None, str]]


def twins(joints: list[str], excitations: list[str], seeds: int) -> Records:
    """Name, estimation part, test parts, samples of the initial state (None: of the fit) and unit."""
    for joint in joints:
        for excitation in excitations:
            for seed in range(1, seeds + 1):
                log = twin.Experiment(joint=joint, excitation=excitation, duration=250.0, Ts=0.1, seed=seed).run()
                estimation, validation = sysid.data.quick_start(log.io())
                yield f"{joint} {excitation} {seed}", estimation, {"second half": validation}, None, ""


def real(folder: Path, names: list[str]) -> Records:
    """The public records by their official parts, about the means of the estimation part."""
    for name in names:
        task = RECORDS[name][0](folder)
        raw = task.train
        estimation = detrend(raw)
        about = {
            part: IOData(
                test.u - estimation.u_offset,
                test.y - estimation.y_offset,
                test.Ts,
                u_offset=estimation.u_offset,
                y_offset=estimation.y_offset,
            )
            for part, test in task.tests.items()
        }
        yield name, estimation, about, task.drop, task.unit


def tested(c: Recipe, fit: AnyFit, tests: dict[str, IOData], first: int | None) -> tuple[float, list[float]]:
    """Mean free-run fit [%] over the tests, and the rms errors."""
    percents, errors = [], []
    for test in tests.values():
        data = c.scale(test)
        n = fit.n_init if first is None else first
        run = np.ravel(fit.simulate(data, n))
        y = data.y[n:, 0]
        percents.append(fit_percent(y, run[n:]))
        with np.errstate(over="ignore", invalid="ignore"):
            errors.append(float(np.sqrt(np.mean((y - run[n:]) ** 2))))
    return float(np.mean(percents)), errors


def alone(estimation: IOData, tests: dict[str, IOData], first: int | None, rows: list[Recipe]) -> dict[str, float]:
    """Fit [%] on the tests of every structure by its defaults and of the given settings, each fitted alone."""
    candidates: list[Recipe] = []
    for kind in TABLE.values():
        candidates += kind.ladder(kind().scale(estimation))[:1]
    found: dict[str, float] = {}
    for c in dict.fromkeys([*candidates, NonlinearArx(), *rows]):
        data = c.scale(estimation)
        try:
            found[str(c)] = tested(c, fitted(c, data, "auto", 0, FULL), tests, first)[0]
            if c.grown and data.N < 5000:
                found[f"{c} grown"] = tested(c, grow_joint(data, c.model()).fit, tests, first)[0]
        except InputError:
            found[str(c)] = -np.inf
    return found


def main() -> None:
    """Prints one line a record, then the shares."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--seeds", type=int, default=2)
    parser.add_argument("--seconds", type=float, default=110.0)
    parser.add_argument("--jobs", type=int)
    parser.add_argument("--joints", default="shoulder,thigh,shank")
    parser.add_argument("--excitations", default=EXCITATIONS)
    parser.add_argument("--data", type=Path)
    parser.add_argument("--only", default=",".join(RECORDS))
    args = parser.parse_args()
    records = twins(args.joints.split(","), args.excitations.split(","), args.seeds)
    if args.data:
        records = real(args.data, args.only.split(","))
    regrets = []
    print(f"{'record':24s} {'N':>6s} {'s':>5s} {'auto':>8s} {'best':>8s} {'regret':>7s}  chosen; best; rms errors")
    for name, estimation, tests, first, unit in records:
        found = sysid.select(estimation, seconds=args.seconds, jobs=args.jobs)
        chosen = found.chosen.candidate
        percent, errors = tested(chosen, found.fit, tests, first)
        others = alone(estimation, tests, first, [r.candidate for r in found.best_of_each])
        best = max(others, key=lambda each: others[each])
        regrets.append(max(0.0, others[best] - percent))
        shown = ", ".join(f"{e:.4g}" for e in errors)
        print(
            f"{name:24s} {estimation.N:6d} {found.seconds:5.0f} {percent:8.2f} {others[best]:8.2f} {regrets[-1]:7.2f}  "
            f"{chosen}; {best}; {shown} {unit}",
            flush=True,
        )
        for note in found.notes:
            print(f"    {note}")
    within = sum(r <= WITHIN for r in regrets)
    middle, worst = np.median(regrets), max(regrets)
    print(f"within {WITHIN:g} point: {within} of {len(regrets)}; median {middle:.2f}, worst {worst:.2f}")


if __name__ == "__main__":
    main()
