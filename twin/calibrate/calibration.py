"""Calibration of a joint of the twin from logs of the leg: values, intervals, scores, and why the search stopped."""

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
from scipy.stats import norm

from sysid.base.errors import InputError, unknown
from sysid.base.parallel import available_cores, one_blas_thread
from sysid.solver.iterate import Options
from twin.calibrate import discrepancy
from twin.calibrate.identifiability import tell
from twin.calibrate.leg import DELAY, ROWS, Leg, free, row_name, scale, usual
from twin.calibrate.problem import Record, Simulations
from twin.calibrate.result import LEVEL, Calibration, Run, Score, Value
from twin.calibrate.search import USUAL, Found, find
from twin.calibrate.start import from_joint
from twin.imperfections import TABLE as IMPERFECTIONS
from twin.log import Log, check_plausible
from twin.parameters import JOINTS, Parameters

# Rows that no record of voltage and angle tells from friction; their spread is part of the intervals of the others.
CONSIDERED = ("dead_band",)
FIRST = 3  # samples that give the first angle of a log
SHORT = 1.0  # standard deviations


def calibrate(
    logs: Sequence[Log],
    joint: str,
    base: Parameters | None = None,
    names: Sequence[str] | None = None,
    fixed: Sequence[str] = (),
    held_out: Sequence[Log] = (),
    without: Sequence[str] = (),
    pot_side: str = "link",
    realisation: str = "tendon",
    level: float = LEVEL,
    seed: int = 0,
    threads: int | None = None,
    labels: Sequence[str] | None = None,
    progress: Callable[[str], None] | None = None,
    seconds: float = np.inf,
) -> Calibration:
    """Fit the twin's `joint` to `logs`, from `base` (nominal if None).

    `names` are the rows to free (those that records of voltage and angle usually tell, if None); rows in `fixed` are
    known and keep their values. What the logs cannot tell is fixed too, with a sentence in `fixed`. After `seconds` the
    search ends with the best so far, see `reason`; intervals and free runs take their time after that. Raises
    InputError for unknown names, for seconds that are not positive, for logs that cannot be of this joint, and if
    nothing is left to calibrate.
    """
    say = progress or (lambda text: None)
    if joint not in JOINTS:
        raise unknown("joint", joint, JOINTS)
    if not seconds > 0.0:
        raise InputError(f"seconds is {seconds:g}; give a positive number, or leave it out")
    if not logs:
        raise InputError("there is no log to calibrate from; give at least one")
    base = base or Parameters()
    rows, held = chosen(joint, names, fixed, without), [row_name(joint, name) for name in fixed]
    labels = labels or [f"log {k + 1}" for k in range(len(logs) + len(held_out))]
    for log, label in zip((*logs, *held_out), labels, strict=False):
        check_plausible(log, joint, base, label)
    settings = (tuple(without), pot_side, realisation, threads or available_cores())
    time = Options(max_seconds=seconds).begun()
    with one_blas_thread():
        say("actuated joint as a start")
        start = from_joint(logs, joint, base, rows, seed, time)
        say("what the logs can tell")
        others = [row for row in CONSIDERED if row not in (*rows, *held) and row not in switched_off(without)]
        first = _problem(Leg(joint, start.parameters, (*rows, *others), *settings), logs, labels)
        if first.residual(first.start) is None:
            raise InputError(
                f"the twin's {joint} cannot be simulated with these parameters; start from others (--params)"
            )
        _, J = first.linearise(first.start)
        told = tell(first, J, max(first.noise, start.rms), rows, start.missed)
        kept = tuple(row.name for row in told if row.told)
        if not kept:
            raise InputError(
                f"these logs tell none of {', '.join(rows)}; record the {joint} from end to end at several voltages"
            )
        say(f"search over {len(kept)} parameters")
        begun = start.parameters.replace({row: base[row] for row in rows if row not in (*kept, *start.missed)})
        leg = Leg(joint, begun, kept, *settings)
        task = _problem(leg, logs, labels)
        _take_over(first, J, task, begun == start.parameters)
        limits = replace(USUAL, max_seconds=seconds, deadline=time.deadline)
        draw = np.random.default_rng(seed)
        found = find(task, draw, progress=lambda k, loss: say(f"iteration {k}"), options=limits)
        say("intervals")
        e, J = task.linearise(found.p)
        responses, steps = task.at(found.p), [record.Ts for record in task.records]
        scored = np.concatenate([record.scored for record in task.records])
        departures, size = discrepancy.estimate(e, J, responses, steps, scored)
        unsure = [*(row.name for row in told if not (row.told or row.missed)), *others]
        wide = _problem(Leg(joint, begun, (*rows, *others), *settings), logs, labels)
        wide.steps = first.steps.copy()
        cov = discrepancy.covariance(J, departures, size) + _considered(wide, task, found, J, unsure)
        cov += _from_missed_end(task, found, joint, base, start.missed)
        values = _values(task, found, cov, J, size, base, level)
        after = _as_board_sees(leg.parameters(task.values(found.p)[: len(kept)]))
        runs = _runs(Leg(joint, base, (), *settings), leg, task, found, logs, held_out, labels)
    moved = tuple(row for row in ROWS if row not in kept and row != DELAY and after[row] != base[row])
    converged, reason = _verdict(found, e, J, cov, seconds)
    cov = cov[: len(kept), : len(kept)]
    std = np.sqrt(np.diag(cov))
    return Calibration(
        joint,
        after,
        values,
        cov / np.outer(std, std),
        told,
        {row.name: row.sentence() + _moved(row.name, moved, base, after) for row in told if not row.told},
        found,
        converged,
        reason,
        size,
        tuple(_score(run) for run in runs),
        runs,
        {
            "logs": list(labels[: len(logs)]),
            "held_out": list(labels[len(logs) :]),
            "without": list(without),
            "pot_side": pot_side,
            "realisation": realisation,
            "fixed": held,
            "considered": unsure,
            "seed": seed,
            "seconds": seconds if np.isfinite(seconds) else None,
        },
        level,
        seconds,
        moved,
    )


def _moved(name: str, moved: Sequence[str], base: Parameters, after: Parameters) -> str:
    """That a row which is not calibrated has another value all the same, so that the twin can do what the logs show."""
    if name not in moved:
        return ""
    unit = ROWS[name].unit
    return f" It is set to {after[name]:.4g} {unit} (from {base[name]:.4g}): the logs pass the end of the nominal twin."


def chosen(joint: str, names: Sequence[str] | None, fixed: Sequence[str], without: Sequence[str]) -> tuple[str, ...]:
    """The rows to free, in order; raises InputError for unknown names and for rows of a switched-off imperfection."""
    off, held = switched_off(without), [row_name(joint, name) for name in fixed]
    if names is None:
        return tuple(row for row in usual(joint) if row.replace(joint, "JOINT") not in off and row not in held)
    rows = tuple(dict.fromkeys(row_name(joint, name) for name in names))
    for row in rows:
        if row.replace(joint, "JOINT") in off:
            raise InputError(f"{row} is free, but its imperfection is left out; leave it out of --free or --without")
        if row in held:
            raise InputError(f"{row} is both free and fixed; name it once")
    return rows


def switched_off(without: Sequence[str]) -> set[str]:
    """Rows, with JOINT for the joint, that have no effect without these imperfections."""
    for name in without:
        if name not in IMPERFECTIONS:
            raise unknown("imperfection", name, IMPERFECTIONS)
    return {row for name in without for row in IMPERFECTIONS[name].ideal}


def _as_board_sees(p: Parameters) -> Parameters:
    """The delay in whole periods of the board, which reads commands no more often."""
    period = p["switch_period"]
    return p.replace({DELAY: min(round(p[DELAY] / period) * period, ROWS[DELAY].upper)})


def _problem(leg: Leg, logs: Sequence[Log], labels: Sequence[str]) -> Simulations:
    records = [leg.record(log, label) for log, label in zip(logs, labels, strict=False)]
    return Simulations(free(leg.names, leg.base), records)


def _take_over(first: Simulations, J: np.ndarray, task: Simulations, same: bool) -> None:
    """Give `task`, which has fewer shared parameters, the steps of `first`, and its simulations at the `same` start."""
    names = [f.name for f in task.shared]
    columns = [j for j, f in enumerate(first.free) if j >= len(first.shared) or f.name in names]
    task.steps = first.steps[columns]
    if same:
        task.known(task.start, first.at(first.start), J[:, columns])


def _considered(first: Simulations, task: Simulations, found: Found, J: np.ndarray, names: Sequence[str]) -> np.ndarray:
    """Covariance (n, n) of the estimate from rows that keep a value which may be a scale off (Schmidt's considered
    parameters): (J+ J_c S)(J+ J_c S)' with their columns J_c, and their scales S as coordinates."""
    shared = {f.name: j for j, f in enumerate(first.shared)}
    p = first.start
    p[[shared[f.name] for f in task.shared]] = found.p[: len(task.shared)]
    p[len(first.shared) :] = found.p[len(task.shared) :]
    first.known(p, task.at(found.p))
    which = [shared[name] for name in names]
    spread = np.array([first.free[j].scale / first.free[j].slope(first.free[j].start) for j in which])
    moved = np.linalg.pinv(J) @ (first.columns(p, which) * spread)
    return moved @ moved.T


def _from_missed_end(
    task: Simulations, found: Found, joint: str, base: Parameters, missed: Sequence[str]
) -> np.ndarray:
    """Covariance (n, n) of a stroke whose retracted end no log strikes: the logs tell the sum of the two lengths."""
    cov = np.zeros((len(task.free), len(task.free)))
    first = f"{joint}.retracted_length"
    for j, f in enumerate(task.shared):
        if f.name == f"{joint}.stroke" and first in missed:
            cov[j, j] = (scale(first, base[first]) / f.slope(task.values(found.p)[j])) ** 2
    return cov


def _values(
    task: Simulations,
    found: Found,
    cov: np.ndarray,
    J: np.ndarray,
    size: discrepancy.Sizes,
    base: Parameters,
    level: float,
) -> tuple[Value, ...]:
    """Values with intervals that are symmetric in the coordinates of the search, and so stay within the bounds."""
    wide = float(norm.ppf(0.5 + level / 2))
    white = size.noise**2 * np.diag(np.linalg.pinv(J.T @ J))
    out = []
    for j, f in enumerate(task.shared):
        z, spread = found.p[j], wide * np.sqrt(cov[j, j])
        low, value, high = (float(f.outer(at)) for at in (z - spread, z, z + spread))
        out.append(Value(f.name, f.unit, base[f.name], f.start, value, low, high, float(np.sqrt(white[j] / cov[j, j]))))
    return tuple(out)


def _runs(
    before: Leg,
    after: Leg,
    task: Simulations,
    found: Found,
    logs: Sequence[Log],
    held_out: Sequence[Log],
    labels: Sequence[str],
) -> tuple[Run, ...]:
    """Free runs of the uncalibrated and the calibrated twin over all logs.

    The uncalibrated twin and held-out logs start at the log's first angle.
    """
    values, shared, out = task.values(found.p), len(task.shared), []
    for k, log in enumerate((*logs, *held_out)):
        held = k >= len(logs)
        old, new = before.record(log, labels[k]), after.record(log, labels[k])
        nominal = _from_first_angle(old, np.empty(0))
        if held:
            found_run = _from_first_angle(new, values[:shared])
        else:
            found_run = new.respond(np.append(values[:shared], values[task.own[k]])[None])[0]
        u = log.io(before.joint if log.joint else None).u.ravel()
        out.append(Run(labels[k], held, log.Ts, u, new.y, nominal, found_run))
    return tuple(out)


def _from_first_angle(record: Record, values: np.ndarray) -> np.ndarray:
    """The free run (N,) that begins at the median of the log's first angles.

    The drive is not where the link is read: the backlash and the sensor lie between. What a first run begins with is
    subtracted.
    """
    first = float(np.nanmedian(record.y[:FIRST]))
    run = record.respond(np.append(values, first)[None])[0]
    return record.respond(np.append(values, 2.0 * first - run[0])[None])[0]


def _score(run: Run) -> Score:
    def rms(of: np.ndarray) -> float:
        return float(np.sqrt(np.nanmean((run.y - of) ** 2)))

    def fit(of: np.ndarray) -> float:
        return float(100.0 * (1.0 - rms(of) / np.nanstd(run.y)))

    return Score(run.name, run.held_out, rms(run.before), rms(run.after), fit(run.before), fit(run.after))


def _verdict(found: Found, e: np.ndarray, J: np.ndarray, cov: np.ndarray, seconds: float) -> tuple[bool, str]:
    """Whether the search ended at a minimum, and why it ended.

    The response of a joint that trips limit switches jumps a little, so that the last steps may find no descent. That
    is good enough if what is left of the way is short beside the standard deviations.
    """
    left = float(np.max(np.abs(np.linalg.lstsq(J, e)[0]) / np.sqrt(np.diag(cov)), initial=0.0))
    if found.late:
        before = "other starts were followed" if found.stop.converged else "it converged"
        step = f"the next step would be {left:.2g} standard deviations long"
        said = f"it was stopped after {seconds:g} s, before {before}; {step}"
        return found.stop.converged or left <= SHORT, said
    if found.stop.converged or left > SHORT:
        return found.stop.converged, found.stop.reason
    return True, f"no step lowers the error, and the next one would be at most {left:.2f} standard deviations long"
