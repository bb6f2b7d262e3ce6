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
from twin.calibrate.search import USUAL, Optimum, find_optimum
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
    rows, known_rows = rows_to_free(joint, names, fixed, without), [row_name(joint, name) for name in fixed]
    labels = labels or [f"log {k + 1}" for k in range(len(logs) + len(held_out))]
    for log, label in zip((*logs, *held_out), labels, strict=False):
        check_plausible(log, joint, base, label)
    settings = (tuple(without), pot_side, realisation, threads or available_cores())
    time = Options(max_seconds=seconds).begun()
    with one_blas_thread():
        say("actuated joint as a start")
        start = from_joint(logs, joint, base, rows, seed, time)
        say("what the logs can tell")
        nuisance_rows = [
            row for row in CONSIDERED if row not in (*rows, *known_rows) and row not in rows_without_effect(without)
        ]
        first = _problem(Leg(joint, start.parameters, (*rows, *nuisance_rows), *settings), logs, labels)
        if first.residual(first.start) is None:
            raise InputError(
                f"the twin's {joint} cannot be simulated with these parameters; start from others (--params)"
            )
        _, J = first.linearise(first.start)
        verdicts = tell(first, J, max(first.noise, start.rms), rows, start.missed)
        free_rows = tuple(row.name for row in verdicts if row.told)
        if not free_rows:
            raise InputError(
                f"these logs tell none of {', '.join(rows)}; record the {joint} from end stop to end stop at several "
                "voltages"
            )
        say(f"search over {len(free_rows)} parameters")
        initial = start.parameters.replace({row: base[row] for row in rows if row not in (*free_rows, *start.missed)})
        leg = Leg(joint, initial, free_rows, *settings)
        task = _problem(leg, logs, labels)
        _take_over(first, J, task, initial == start.parameters)
        limits = replace(USUAL, max_seconds=seconds, deadline=time.deadline)
        draw = np.random.default_rng(seed)
        optimum = find_optimum(task, draw, progress=lambda k, loss: say(f"iteration {k}"), options=limits)
        say("intervals")
        unsure = [*(row.name for row in verdicts if not (row.told or row.missed)), *nuisance_rows]
        wide = _problem(Leg(joint, initial, (*rows, *nuisance_rows), *settings), logs, labels)
        wide.steps = first.steps.copy()
        e, J = task.linearise(optimum.p)
        size, cov = _covariance(wide, task, optimum, e, J, unsure)
        cov += _covariance_of_missed_end(task, optimum, joint, base, start.missed)
        values = _values(task, optimum, cov, J, size, base, level)
        parameters = _as_board_sees(leg.parameters(task.values(optimum.p)[: len(free_rows)]))
        runs = _runs(Leg(joint, base, (), *settings), leg, task, optimum, logs, held_out, labels)
    moved_rows = tuple(row for row in ROWS if row not in free_rows and row != DELAY and parameters[row] != base[row])
    converged, reason = _verdict(optimum, e, J, cov, seconds)
    cov = cov[: len(free_rows), : len(free_rows)]
    std = np.sqrt(np.diag(cov))
    fixed_sentences = {
        row.name: row.sentence() + _moved_sentence(row.name, moved_rows, base, parameters)
        for row in verdicts
        if not row.told
    }
    return Calibration(
        joint,
        parameters,
        values,
        cov / np.outer(std, std),
        verdicts,
        fixed_sentences,
        optimum,
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
            "fixed": known_rows,
            "considered": unsure,
            "seed": seed,
            "seconds": seconds if np.isfinite(seconds) else None,
        },
        level,
        seconds,
        moved_rows,
    )


def _moved_sentence(name: str, rows: Sequence[str], base: Parameters, parameters: Parameters) -> str:
    """That a row which is not calibrated has another value all the same, so that the twin can do what the logs show."""
    if name not in rows:
        return ""
    unit = ROWS[name].unit
    value = f"{parameters[name]:.4g} {unit} (from {base[name]:.4g})"
    return f" It is set to {value}: the logs pass the end of the nominal twin."


def rows_to_free(
    joint: str, names: Sequence[str] | None, fixed: Sequence[str], without: Sequence[str]
) -> tuple[str, ...]:
    """The rows to free, in order; raises InputError for unknown names and for rows of a switched-off imperfection."""
    inactive_rows, known_rows = rows_without_effect(without), [row_name(joint, name) for name in fixed]
    if names is None:
        return tuple(
            row for row in usual(joint) if row.replace(joint, "JOINT") not in inactive_rows and row not in known_rows
        )
    rows = tuple(dict.fromkeys(row_name(joint, name) for name in names))
    for row in rows:
        if row.replace(joint, "JOINT") in inactive_rows:
            raise InputError(f"{row} is free, but its imperfection is left out; leave it out of --free or --without")
        if row in known_rows:
            raise InputError(f"{row} is both free and fixed; name it once")
    return rows


def rows_without_effect(without: Sequence[str]) -> set[str]:
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
        task.take_over(task.start, first.responses_at(first.start), J[:, columns])


def _covariance(
    first: Simulations, task: Simulations, optimum: Optimum, e: np.ndarray, J: np.ndarray, unsure: Sequence[str]
) -> tuple[discrepancy.Sizes, np.ndarray]:
    """Sizes of noise and departures, and the covariance (n, n) that they and the rows `unsure` of `first` give."""
    responses, steps = task.responses_at(optimum.p), [record.Ts for record in task.records]
    scored_samples = np.concatenate([record.scored for record in task.records])
    departures, size = discrepancy.estimate(e, J, responses, steps, scored_samples)
    cov = discrepancy.covariance(J, departures, size)
    return size, cov + _covariance_of_considered(first, task, optimum, J, unsure)


def _covariance_of_considered(
    first: Simulations, task: Simulations, optimum: Optimum, J: np.ndarray, names: Sequence[str]
) -> np.ndarray:
    """Covariance (n, n) of the estimate from rows that keep a value which may be a scale off (Schmidt's considered
    parameters): (J+ J_c S)(J+ J_c S)' with their columns J_c, and their scales S as coordinates."""
    columns = {f.name: j for j, f in enumerate(first.shared)}
    p = first.start
    p[[columns[f.name] for f in task.shared]] = optimum.p[: len(task.shared)]
    p[len(first.shared) :] = optimum.p[len(task.shared) :]
    first.take_over(p, task.responses_at(optimum.p))
    indices = [columns[name] for name in names]
    spread = np.array([first.free[j].scale / first.free[j].slope(first.free[j].start) for j in indices])
    sensitivity = np.linalg.pinv(J) @ (first.columns(p, indices) * spread)
    return sensitivity @ sensitivity.T


def _covariance_of_missed_end(
    task: Simulations, optimum: Optimum, joint: str, base: Parameters, missed_rows: Sequence[str]
) -> np.ndarray:
    """Covariance (n, n) of a stroke whose retracted end no log strikes: the logs tell the sum of the two lengths."""
    cov = np.zeros((len(task.free), len(task.free)))
    first = f"{joint}.retracted_length"
    for j, f in enumerate(task.shared):
        if f.name == f"{joint}.stroke" and first in missed_rows:
            cov[j, j] = (scale(first, base[first]) / f.slope(task.values(optimum.p)[j])) ** 2
    return cov


def _values(
    task: Simulations,
    optimum: Optimum,
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
        z, spread = optimum.p[j], wide * np.sqrt(cov[j, j])
        low, value, high = (float(f.outer(end)) for end in (z - spread, z, z + spread))
        out.append(Value(f.name, f.unit, base[f.name], f.start, value, low, high, float(np.sqrt(white[j] / cov[j, j]))))
    return tuple(out)


def _runs(
    nominal_leg: Leg,
    calibrated_leg: Leg,
    task: Simulations,
    optimum: Optimum,
    logs: Sequence[Log],
    held_out: Sequence[Log],
    labels: Sequence[str],
) -> tuple[Run, ...]:
    """Free runs of the uncalibrated and the calibrated twin over all logs.

    The uncalibrated twin and held-out logs start at the log's first angle.
    """
    values, n_shared, out = task.values(optimum.p), len(task.shared), []
    for k, log in enumerate((*logs, *held_out)):
        held = k >= len(logs)
        old, new = nominal_leg.record(log, labels[k]), calibrated_leg.record(log, labels[k])
        nominal = _from_first_angle(old, np.empty(0))
        if held:
            found_run = _from_first_angle(new, values[:n_shared])
        else:
            found_run = new.respond(np.append(values[:n_shared], values[task.own[k]])[None])[0]
        u = log.io(nominal_leg.joint if log.joint else None).u.ravel()
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
    def rms(response: np.ndarray) -> float:
        return float(np.sqrt(np.nanmean((run.y - response) ** 2)))

    def fit(response: np.ndarray) -> float:
        return float(100.0 * (1.0 - rms(response) / np.nanstd(run.y)))

    return Score(run.name, run.held_out, rms(run.before), rms(run.after), fit(run.before), fit(run.after))


def _verdict(optimum: Optimum, e: np.ndarray, J: np.ndarray, cov: np.ndarray, seconds: float) -> tuple[bool, str]:
    """Whether the search ended at a minimum, and why it ended.

    The response of a joint that trips limit switches jumps a little, so that the last steps may find no descent. That
    is good enough if what is left of the way is short beside the standard deviations.
    """
    step_length = float(np.max(np.abs(np.linalg.lstsq(J, e)[0]) / np.sqrt(np.diag(cov)), initial=0.0))
    if optimum.late:
        event = "other starts were followed" if optimum.stop.converged else "it converged"
        step = f"the next step would be {step_length:.2g} standard deviations long"
        sentence = f"it was stopped after {seconds:g} s, before {event}; {step}"
        return optimum.stop.converged or step_length <= SHORT, sentence
    if optimum.stop.converged or step_length > SHORT:
        return optimum.stop.converged, optimum.stop.reason
    return (
        True,
        f"no step lowers the error, and the next one would be at most {step_length:.2f} standard deviations long",
    )
