"""Calibration of a joint of the twin from logs of the leg: values, intervals, scores, and why the search stopped."""

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
from scipy.stats import norm

from sysid.base.errors import InputError, unknown
from sysid.base.parallel import available_cores, one_blas_thread
from sysid.solver.iterate import Options
from twin.calibrate import discrepancy
from twin.calibrate.agreement import agreement
from twin.calibrate.band import Lack, lack
from twin.calibrate.identifiability import tell
from twin.calibrate.leg import DELAY, OFFSET, ROWS, ZERO, Leg, free, row_name, scale, usual
from twin.calibrate.problem import Simulations
from twin.calibrate.result import LEVEL, Calibration, Value
from twin.calibrate.rivals import explained, without_each
from twin.calibrate.runs import columns_by_run, free_runs, score, typical_logs, with_bands, with_reference
from twin.calibrate.search import USUAL, Optimum, find_optimum
from twin.calibrate.start import from_joint
from twin.follow import VISIBLE
from twin.imperfections import TABLE as IMPERFECTIONS
from twin.log import Log, check_plausible
from twin.parameters import JOINTS, Parameters

# Rows that no record of voltage and angle tells from friction; their spread is part of the intervals of the others.
CONSIDERED = ("dead_band",)
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
    by_run: Sequence[str] = (),
) -> Calibration:
    """Fit the twin's `joint` to `logs`, from `base` (nominal if None).

    `names` are the rows to free (those that records of voltage and angle usually tell, if None); rows in `fixed` are
    known and keep their values; rows `by_run`, and "zero" of the sensor, have a value of their own in each log. What
    the logs cannot tell is fixed too, with a sentence in `fixed`. After `seconds` the search ends with the best so far,
    see `reason`; intervals and free runs take their time after that. Raises InputError for unknown names, for seconds
    that are not positive, for logs that cannot be of this joint, and if nothing is left to calibrate.
    """
    say = progress or (lambda text: None)
    if joint not in JOINTS:
        raise unknown("joint", joint, JOINTS)
    if not seconds > 0.0:
        raise InputError(f"seconds is {seconds:g}; give a positive number, or leave it out")
    if not logs:
        raise InputError("there is no log to calibrate from; give at least one")
    base = base or Parameters()
    daily = _rows_by_run(joint, by_run, fixed, len(logs))
    rows = tuple(row for row in rows_to_free(joint, names, fixed, without) if row not in daily)
    known_rows = [row_name(joint, name) for name in fixed]
    labels = labels or [f"log {k + 1}" for k in range(len(logs) + len(held_out))]
    for log, label in zip((*logs, *held_out), labels, strict=False):
        check_plausible(log, joint, base, label)
    settings = (tuple(without), pot_side, realisation, threads or available_cores())
    of_runs = (*settings, daily)
    time = Options(max_seconds=seconds).begun()
    with one_blas_thread():
        say("actuated joint as a start")
        start = from_joint(logs, joint, base, rows, seed, time)
        say("what the logs can tell")
        nuisance_rows = [
            row
            for row in CONSIDERED
            if row not in (*rows, *known_rows, *daily) and row not in rows_without_effect(without)
        ]
        first = _problem(Leg(joint, start.parameters, (*rows, *nuisance_rows), *of_runs), logs, labels)
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
        leg = Leg(joint, initial, free_rows, *of_runs)
        task = _problem(leg, logs, labels)
        _take_over(first, J, task, initial == start.parameters)
        limits = replace(USUAL, max_seconds=seconds, deadline=time.deadline)
        draw = np.random.default_rng(seed)
        optimum = find_optimum(task, draw, progress=lambda k, loss: say(f"iteration {k}"), options=limits)
        say("intervals")
        unsure = [*(row.name for row in verdicts if not (row.told or row.missed)), *nuisance_rows]
        wide_leg = Leg(joint, initial, (*rows, *nuisance_rows), *of_runs)
        wide = _problem(wide_leg, logs, labels)
        wide.steps = first.steps.copy()
        e, J = task.linearise(optimum.p)
        size, cov, lacking, every = _covariance(wide, task, optimum, e, J, unsure)
        q, zero = _wide_point(wide, task, optimum.p), None if ZERO in daily else OFFSET
        rows_judged = agreement(wide, q, e, every, level, VISIBLE, zero)  # a row that is not calibrated may differ too
        agreements = tuple(row for row in rows_judged if row.name not in nuisance_rows)
        judge = (wide, q, e, every, agreements, free_rows, OFFSET, limits, level, VISIBLE)
        agreements = explained(
            *judge,
            lambda: [_wide_point(wide, task, point) for point in without_each(task, optimum.p, limits)],
            say,
        )
        cov += _covariance_of_missed_end(task, optimum, joint, base, start.missed)
        values = _values(task, optimum, cov, J, size, base, level)
        own = {row: _values(task, optimum, cov, J, size, base, level, js) for row, js in columns_by_run(task).items()}
        runs_values = with_reference(own)
        typical = typical_logs(task, optimum.p, cov)
        found = dict(zip(free_rows, task.values(optimum.p), strict=False))
        means = {row: float(np.mean([runs_values[row][k].value for k in logs])) for row, logs in typical.items()}
        parameters = _as_board_sees(initial.replace(found | means))
        runs = free_runs(Leg(joint, base, (), *settings), leg, task, optimum, means, logs, held_out, labels)
        runs = with_bands(runs, lacking, wide, wide_leg, q, held_out, level)
    moved_rows = tuple(row for row in ROWS if row not in (*free_rows, *daily, DELAY) and parameters[row] != base[row])
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
        tuple(score(run) for run in runs),
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
        agreements,
        runs_values,
        typical,
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


def _rows_by_run(joint: str, names: Sequence[str], fixed: Sequence[str], runs: int) -> tuple[str, ...]:
    """The rows with a value for each run; raises InputError for unknown names, known rows and a single run."""
    rows = tuple(dict.fromkeys(name if name == ZERO else row_name(joint, name) for name in names))
    if rows and runs < 2:
        raise InputError(f"{', '.join(rows)} cannot differ between runs of one log; give the logs of two runs or more")
    for row in rows:
        if row in [row_name(joint, name) for name in fixed]:
            raise InputError(f"{row} is both fixed and free in each run; name it once")
    return rows


def _as_board_sees(p: Parameters) -> Parameters:
    """The delay in whole periods of the board, which reads commands no more often."""
    period = p["switch_period"]
    return p.replace({DELAY: min(round(p[DELAY] / period) * period, ROWS[DELAY].upper)})


def _problem(leg: Leg, logs: Sequence[Log], labels: Sequence[str]) -> Simulations:
    records = [leg.record(log, label, k == 0) for k, (log, label) in enumerate(zip(logs, labels, strict=False))]
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
) -> tuple[discrepancy.Sizes, np.ndarray, Lack, np.ndarray]:
    """Sizes of noise and departures, the covariance (n, n) that they and the rows `unsure` of `first` give, the
    posterior of all rows of `first` and departures, and the Jacobian of `first`.

    A row that keeps a value which may be a scale off adds (J+ J_c S)(J+ J_c S)' with its column J_c and its scale S as
    a coordinate (Schmidt's considered parameters).
    """
    responses, steps = task.responses_at(optimum.p), [record.Ts for record in task.records]
    scored_samples = np.concatenate([record.scored for record in task.records])
    groups, size = discrepancy.estimate(e, J, responses, steps, scored_samples)
    cov = discrepancy.covariance(J, groups, size)
    names, p, shared = [f.name for f in first.shared], _wide_point(first, task, optimum.p), len(task.shared)
    first.take_over(p, responses)
    searched = [names.index(f.name) for f in task.shared]
    others = [j for j in range(len(names)) if j not in searched]
    every, spreads = np.zeros((len(e), len(names))), first.spreads(p)[: len(names)]
    every[:, searched] = J[:, :shared]
    every[:, others] = first.columns(p, others)
    indices = [names.index(name) for name in unsure]
    sensitivity = np.linalg.pinv(J) @ (every[:, indices] * spreads[indices])
    frame = discrepancy.Frame.of(responses, steps)
    lacking = lack(e, every, spreads, J[:, shared:], groups, size, frame)
    return size, cov + sensitivity @ sensitivity.T, lacking, np.hstack([every, J[:, shared:]])


def _wide_point(first: Simulations, task: Simulations, p: np.ndarray) -> np.ndarray:
    """Coordinates of `first`, which has more shared parameters than `task`, at p of `task`."""
    columns, out = {f.name: j for j, f in enumerate(first.shared)}, first.start
    out[[columns[f.name] for f in task.shared]] = p[: len(task.shared)]
    out[len(first.shared) :] = p[len(task.shared) :]
    return out


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
    columns: Sequence[int] | None = None,
) -> tuple[Value, ...]:
    """Values with intervals that are symmetric in the coordinates of the search, and so stay within the bounds.

    `columns` are those of the parameters that all runs share if they are not given.
    """
    wide = float(norm.ppf(0.5 + level / 2))
    white = size.noise**2 * np.diag(np.linalg.pinv(J.T @ J))
    out = []
    for j in range(len(task.shared)) if columns is None else columns:
        f, z, spread = task.free[j], optimum.p[j], wide * np.sqrt(cov[j, j])
        low, value, high = (float(f.outer(end)) for end in (z - spread, z, z + spread))
        nominal, noise_share = 0.0 if f.name == ZERO else base[f.name], float(np.sqrt(white[j] / cov[j, j]))
        out.append(Value(f.name, f.unit, nominal, f.start, value, low, high, noise_share))
    return tuple(out)


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
