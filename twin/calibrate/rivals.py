"""Which value differs between runs: the search again with each candidate's own value in each run.

One step from the common value, as in `twin.calibrate.agreement`, does not tell apart values that act alike: where a
motor is weak, friction and speed by voltage. After a search the one that is the cause leaves less.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from sysid.solver.iterate import Options, iterate
from sysid.solver.searches import search
from twin.calibrate import discrepancy
from twin.calibrate.agreement import CHANCE, Agreement, differences, own_steps
from twin.calibrate.problem import Free, Record, Simulations

MOST = 3  # candidates that are searched, each in about a quarter of the time of a calibration
ITERATIONS = 5
ODDS = 20.0  # to one: a candidate less likely than the best by more than this is no rival


@dataclass(frozen=True)
class Rival:
    """A calibration in which one value differs between runs: its values (runs,), the probability of their differences
    by chance, residuals RMS [rad], and the log likelihood."""

    values: np.ndarray
    chance: float
    rms: float
    likelihood: float


def explained(
    task: Simulations,
    p: np.ndarray,
    J: np.ndarray,
    rows: Sequence[Agreement],
    searched: Sequence[str],
    offset: Free,
    options: Options,
    say: Callable[[str], None] = lambda text: None,
) -> tuple[Agreement, ...]:
    """The `rows` of `agreement` at p (n,), with Jacobian J (N, n), those that may be the cause with values searched.

    `searched` are the shared parameters that move with them, all others keep their values; `offset` is the parameter of
    the reading. The most likely is the cause; others within `ODDS` of it are its rivals.
    """
    candidates = sorted((row for row in rows if row.differ), key=lambda row: -row.squares)[:MOST]
    limits, found = replace(options, max_iterations=ITERATIONS), dict[str, Rival]()
    for row in candidates:
        say(f"{row.name} of its own in each log")
        found[row.name] = _search(*split(task, p, J, row.name, searched, offset), limits)
    best = max((rival.likelihood for rival in found.values() if rival.chance < CHANCE / len(rows)), default=0.0)
    return tuple(
        row if (rival := found.get(row.name)) is None else _with(row, rival, best - rival.likelihood, len(rows))
        for row in rows
    )


def _with(row: Agreement, rival: Rival, behind: float, tests: int) -> Agreement:
    """The row with the values of the search, about which its intervals are as wide as before.

    Values that agree after the search, at the chance of one of so many tests, do not differ.
    """
    if rival.chance >= CHANCE / tests:
        return replace(row, differ=False, odd=None, rest_agrees=True)
    moved = rival.values - row.values
    return replace(
        row,
        values=rival.values,
        low=row.low + moved,
        high=row.high + moved,
        rms=rival.rms,
        behind=behind,
        rival=behind <= np.log(ODDS),
    )


def split(
    task: Simulations, p: np.ndarray, J: np.ndarray, name: str, searched: Sequence[str], offset: Free
) -> tuple[Simulations, np.ndarray]:
    """The same problem with an own value of `name` in each run, and its coordinates at p (n,).

    Of the shared parameters only those `searched` move; `offset` has an own value where `name` is not shared. Its
    simulations and its Jacobian at p are those of `task`.
    """
    names = [free.name for free in task.shared]
    j = names.index(name) if name in names else None
    free = offset if j is None else task.shared[j]
    kept = [i for i, row in enumerate(names) if row in searched and i != j]
    fixed = task.values(p)[: len(names)]
    records = [_with_own(record, free, j, kept, fixed) for record in task.records]
    problem = Simulations([task.shared[i] for i in kept], records, task.noise)
    column, value, step = (np.full(len(J), offset.scale), 0.0, 0.05) if j is None else (J[:, j], p[j], task.steps[j])
    start, slopes, steps = p[kept], [J[:, kept]], task.steps[kept]
    runs = np.repeat(np.arange(len(task.records)), task.lengths)
    for k, own in enumerate(task.own):
        start = np.concatenate([start, p[own], [value]])
        steps = np.concatenate([steps, task.steps[own], [step]])
        slopes += [J[:, own], (column * (runs == k))[:, None]]
    problem.steps = steps
    problem.take_over(start, task.responses_at(p), np.hstack(slopes))
    return problem, start


def _with_own(record: Record, free: Free, j: int | None, kept: Sequence[int], fixed: np.ndarray) -> Record:
    """The record with one more own parameter, the shared one at `j` or, if None, an offset of its response.

    Of its shared parameters those `kept` move, the others stay at `fixed` (shared,).
    """

    def respond(values: np.ndarray) -> np.ndarray:
        moving, own, last = np.split(values, [len(kept), values.shape[1] - 1], axis=1)
        shared = np.tile(fixed, (len(values), 1))
        shared[:, kept] = moving
        if j is None:
            return record.respond(np.hstack([shared, own])) + last
        shared[:, j] = last[:, 0]
        return record.respond(np.hstack([shared, own]))

    return replace(record, respond=respond, own=(*record.own, free))


def _search(problem: Simulations, start: np.ndarray, options: Options) -> Rival:
    """A few iterations from the common value."""
    p = iterate(problem, start, search("trust_region"), options, None).p
    e, J = problem.linearise(p)
    steps, scored = [r.Ts for r in problem.records], np.concatenate([r.scored for r in problem.records])
    groups, size = discrepancy.estimate(e, J, problem.responses_at(p), steps, scored)
    last = [int(own[-1]) for own in problem.own]
    spreads = problem.spreads(p)
    _, _, sampling = own_steps(e, J * spreads, groups, size)
    chance = differences(p[last] / spreads[last], sampling[np.ix_(last, last)])[1]
    return Rival(problem.values(p)[last], chance, float(np.sqrt(np.mean(e**2))), size.likelihood)
