"""The runs of a calibration: what each has of its own, free runs of the twin before and after, and their scores."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from twin.calibrate.agreement import agreeing
from twin.calibrate.band import Lack
from twin.calibrate.leg import ZERO, Leg
from twin.calibrate.problem import Record, Simulations
from twin.calibrate.result import Run, Score, Value
from twin.calibrate.search import Optimum
from twin.log import Log

FIRST = 3  # samples that give the first angle of a log


def columns_by_run(task: Simulations) -> dict[str, list[int]]:
    """The columns of each row that every run has of its own, in the order of the runs."""
    columns: dict[str, list[int]] = {}
    for indices in task.own:
        for j in indices[1:]:  # the first one is the start
            columns.setdefault(task.free[j].name, []).append(int(j))
    return columns


def typical_logs(task: Simulations, p: np.ndarray, cov: np.ndarray) -> dict[str, list[int]]:
    """The runs that agree in each row that they have of their own, at p (n,) with covariance (n, n)."""
    columns = columns_by_run(task)
    return {row: agreeing(p[js], cov[np.ix_(js, js)]) for row, js in columns.items() if row != ZERO}


def with_reference(values: Mapping[str, tuple[Value, ...]]) -> dict[str, tuple[Value, ...]]:
    """The values by run, in which the first run's zero is the reference of the others."""
    first = Value(ZERO, "rad", 0.0, 0.0, 0.0, 0.0, 0.0, 1.0)
    return {row: (first, *each) if row == ZERO else each for row, each in values.items()}


def free_runs(
    nominal_leg: Leg,
    calibrated_leg: Leg,
    task: Simulations,
    optimum: Optimum,
    means: Mapping[str, float],
    logs: Sequence[Log],
    held_out: Sequence[Log],
    labels: Sequence[str],
) -> tuple[Run, ...]:
    """Free runs of the uncalibrated and the calibrated twin over all logs.

    The uncalibrated twin and held-out logs start at the log's first angle. What each run has of its own, a held-out log
    takes from the `means` of the runs that agree.
    """
    values, n_shared, out = task.values(optimum.p), len(task.shared), []
    own = np.array([means[row] for row in calibrated_leg.by_run if row in means])
    for k, log in enumerate((*logs, *held_out)):
        held = k >= len(logs)
        old, new = nominal_leg.record(log, labels[k]), calibrated_leg.record(log, labels[k], k == 0 or held)
        nominal = _from_first_angle(old, np.empty(0), np.empty(0))
        if held:
            found_run = _from_first_angle(new, values[:n_shared], own)
        else:
            found_run = new.respond(np.append(values[:n_shared], values[task.own[k]])[None])[0]
        u = log.io(nominal_leg.joint if log.joint else None).u.ravel()
        out.append(Run(labels[k], held, log.Ts, u, new.y, nominal, found_run))
    return tuple(out)


def with_bands(
    runs: Sequence[Run],
    lacking: Lack,
    wide: Simulations,
    leg: Leg,
    p: np.ndarray,
    held_out: Sequence[Log],
    level: float,
) -> tuple[Run, ...]:
    """The runs, those over logs that were not used with the band of `level`.

    `wide` has all rows of `lacking` as its shared parameters, at p (n,); `leg` is its leg.
    """
    out = [run for run in runs if not run.held_out]
    for run, log in zip(runs[len(out) :], held_out, strict=True):
        record = leg.record(log, run.name)
        task = Simulations(wide.shared, [record], wide.noise)
        task.steps[: len(wide.shared)] = wide.steps[: len(wide.shared)]
        start = task.start
        start[: len(wide.shared)] = p[: len(wide.shared)]
        out.append(replace(run, half=lacking.half(task, start, run.after, level)))
    return tuple(out)


def _from_first_angle(record: Record, values: np.ndarray, own: np.ndarray) -> np.ndarray:
    """The free run (N,) that begins at the median of the log's first angles, with shared and own `values`.

    The drive is not where the link is read: the backlash and the sensor lie between. What a first run begins with is
    subtracted.
    """
    first = float(np.nanmedian(record.y[:FIRST]))
    run = record.respond(np.concatenate([values, [first], own])[None])[0]
    return record.respond(np.concatenate([values, [2.0 * first - run[0]], own])[None])[0]


def score(run: Run) -> Score:
    """RMS error and fit of both free runs over a log."""

    def rms(response: np.ndarray) -> float:
        return float(np.sqrt(np.nanmean((run.y - response) ** 2)))

    def fit(response: np.ndarray) -> float:
        return float(100.0 * (1.0 - rms(response) / np.nanstd(run.y)))

    scored = np.isfinite(run.y)
    inside = None if run.half is None else float(np.mean(np.abs(run.y - run.after)[scored] <= run.half[scored]))
    return Score(run.name, run.held_out, rms(run.before), rms(run.after), fit(run.before), fit(run.after), inside)
