"""What the structure search loses against the best structure that it could have chosen, record by record.

    python scripts/study.py auto_regret [--seeds 1:3] [--seconds 110] [--jobs 2] [--joints shoulder,thigh,shank]
                                        [--excitations sweep,aprbs,multisine,prbs] [--data DIR] [--only ced,silverbox]

Twin: 2 x 125 s of each joint under each excitation, all imperfections on; the search sees the first half, and free runs
over the second half judge it. Real records, instead of the twin's, with --data: their official parts, signals from
their own zero. The regret is the fit of the best other model less that of the search's: every structure by its defaults
and by its best row in the search's table, fitted alone to the estimation part (a joint also with all parts).
"""

import argparse
import itertools
from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np
from study import Case, Row, Study, words

import sysid
import twin
from sysid.base.criteria import fit_percent
from sysid.base.errors import InputError
from sysid.bench.scenarios.real import RECORDS
from sysid.data.preprocess import detrend
from sysid.data.record import IOData
from sysid.joint.posterior import fit_joint
from sysid.model.recipes import Recipe
from sysid.selection.judge import AnyFit, Effort, fitted
from sysid.structures import TABLE, NonlinearArx

EXCITATIONS = ("sweep", "aprbs", "multisine", "prbs")
WITHIN = 1.0  # points of fit
FULL = Effort(5, 200, 60.0)
Record = tuple[IOData, dict[str, IOData], int | None, str]  # estimation, tests, samples of the initial state, unit


def twin_record(joint: str, excitation: str, seed: int) -> Record:
    """The two halves of an experiment; the initial state takes as many samples as the fit says."""
    log = twin.Experiment(joint=joint, excitation=excitation, duration=250.0, Ts=0.1, seed=seed).run()
    estimation, validation = sysid.data.quick_start(log.io())
    return estimation, {"second half": validation}, None, ""


def real(folder: Path, name: str) -> Record:
    """A public record by its official parts, about the means of the estimation part."""
    task = RECORDS[name][0](folder)
    estimation = detrend(task.train)
    u0, y0 = estimation.u_offset, estimation.y_offset
    tests = {
        part: IOData(test.u - u0, test.y - y0, test.Ts, u_offset=u0, y_offset=y0) for part, test in task.tests.items()
    }
    return estimation, tests, task.drop, task.unit


def test_fit(c: Recipe, fit: AnyFit, tests: dict[str, IOData], first: int | None) -> tuple[float, list[float]]:
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


def fit_alternatives(
    estimation: IOData, tests: dict[str, IOData], first: int | None, rows: list[Recipe]
) -> dict[str, float]:
    """Fit [%] on the tests of every structure by its defaults and of the given settings, each fitted alone."""
    candidates: list[Recipe] = []
    for kind in TABLE.values():
        candidates += kind.ladder(kind().scale(estimation))[:1]
    percents: dict[str, float] = {}
    for c in dict.fromkeys([*candidates, NonlinearArx(), *rows]):
        data = c.scale(estimation)
        try:
            percents[str(c)] = test_fit(c, fitted(c, data, "auto", 0, FULL), tests, first)[0]
            if c.with_parts and data.N < 5000:
                percents[f"{c} with parts"] = test_fit(c, fit_joint(data, c.model()).fit, tests, first)[0]
        except InputError:
            percents[str(c)] = -np.inf
    return percents


def records(options: argparse.Namespace) -> dict[Case, Callable[[], Record]]:
    """What makes the record of a case."""
    if options.data:
        return {(name,): partial(real, options.data, name) for name in options.only}
    keys = itertools.product(options.joints, options.excitations, options.seeds)
    return {key: partial(twin_record, *key) for key in keys}


def score(case: Case, options: argparse.Namespace) -> Row:
    """The fit of the search's choice beside the best structure's."""
    estimation, tests, first, unit = records(options)[case]()
    selection = sysid.select(estimation, seconds=options.seconds, jobs=options.jobs)
    choice = selection.chosen.candidate
    percent, errors = test_fit(choice, selection.fit, tests, first)
    alternatives = fit_alternatives(estimation, tests, first, [r.candidate for r in selection.best_of_each])
    best = max(alternatives, key=lambda name: alternatives[name])
    row = {"N": estimation.N, "seconds": selection.seconds, "auto": percent, "best": alternatives[best], "unit": unit}
    regret = max(0.0, alternatives[best] - percent)
    return row | {"regret": regret, "names": [str(choice), best], "errors": errors, "notes": list(selection.notes)}


def line(row: Row) -> str:
    """One record, and notes of the search below it."""
    errors = ", ".join(f"{e:.4g}" for e in row["errors"])
    text = (
        f"{' '.join(map(str, row['case'])):24s} {row['N']:6d} {row['seconds']:5.0f} {row['auto']:8.2f} "
        f"{row['best']:8.2f} {row['regret']:7.2f}  {'; '.join(row['names'])}; {errors} {row['unit']}"
    )
    return "\n".join([text, *(f"    {note}" for note in row["notes"])])


def summary(rows: list[Row], options: argparse.Namespace) -> str:
    """One line a record, then the shares."""
    regrets = [row["regret"] for row in rows]
    head = f"{'record':24s} {'N':>6s} {'s':>5s} {'auto':>8s} {'best':>8s} {'regret':>7s}  chosen; best; rms errors"
    shares = f"within {WITHIN:g} point: {sum(r <= WITHIN for r in regrets)} of {len(regrets)}; "
    return "\n".join([head, *map(line, rows), f"{shares}median {np.median(regrets):.2f}, worst {max(regrets):.2f}"])


STUDY = Study(
    cases=records,
    score=score,
    summary=summary,
    seeds="1:3",
    options={
        "--seconds": {"type": float, "default": 110.0, "help": "of each search"},
        "--jobs": {"type": int, "help": "processes of each search"},
        "--joints": {"type": words, "default": list(twin.JOINTS)},
        "--excitations": {"type": words, "default": list(EXCITATIONS)},
        "--data": {"type": Path, "metavar": "DIR", "help": "public records instead of the twin's"},
        "--only": {"type": words, "default": list(RECORDS), "help": "which of them"},
    },
    line=line,
)
