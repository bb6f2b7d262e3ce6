"""Which value differs between runs: by the likelihood of the records if that value alone is another one in each run.

Differences of a value are random, of a size that the records choose beside the sizes of noise and departures: a
departure that only one run visits may then be the difference, or the difference a departure. One step from the common
value, as in `twin.calibrate.agreement`, does not tell apart values that act alike: where a motor is weak, friction and
speed by voltage. So those that may be the cause are searched with a value of their own in each run before one is named.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import null_space
from scipy.stats import chi2, norm

from sysid.solver.iterate import Options
from twin.calibrate import discrepancy
from twin.calibrate.agreement import CHANCE, Agreement, odd_run, own_steps
from twin.calibrate.problem import Free, Record, Simulations
from twin.calibrate.search import descend

MOST = 5  # candidates that are searched
_SCAN = np.linspace(-1.5, 1.5, 13)  # scales from the common value at which the searches of a run's own value begin
ODDS = 20.0  # to one: a candidate less likely than the best by more than this is no rival


def explained(
    task: Simulations,
    p: np.ndarray,
    e: np.ndarray,
    J: np.ndarray,
    rows: Sequence[Agreement],
    searched: Sequence[str],
    offset: Free,
    options: Options,
    level: float = 0.95,
    least: float = 0.0,
    begins: Callable[[], Sequence[np.ndarray]] = tuple,
    say: Callable[[str], None] = lambda text: None,
) -> tuple[Agreement, ...]:
    """The `rows` of `agreement` at p (n,), with residuals e (N,) and Jacobian J (N, n), and which of them differ.

    `searched` are the shared parameters that move, all others keep their values; `offset` is the parameter of the
    reading. The most likely is the cause; others within `ODDS` of it are its rivals. Differences that change the
    response of every run by less than `least` RMS matter to nobody. A search begins at p, and at `begins` (n,).
    """
    if not rows:
        return ()
    common, limit = _Common.of(task, p, e, J, searched, offset), CHANCE / len(rows)
    gains = {row.name: common.gain(row.name) for row in rows}
    judged, points = list[Agreement](), list[np.ndarray]()
    for row in sorted(rows, key=lambda row: -gains[row.name]):
        row = replace(row, chance=_chance(gains[row.name]), differ=False, odd=None, rest_agrees=True)
        if len(judged) < MOST and row.chance < CHANCE:
            say(f"{row.name} of its own in each log")
            points = points or [p, *begins()]
            problem, start = split(task, p, row.name, searched, offset, J)
            starts = [split(task, point, row.name, searched, offset)[1] for point in points]
            row = common.beside(row, problem, start, _searched(problem, starts, options), level, least, limit)
        judged.append(row)
    best = min((row.behind for row in judged if row.differ), default=0.0)
    ranked = {row.name: replace(row, behind=row.behind - best) for row in judged}
    found = (ranked[row.name] for row in rows)
    return tuple(replace(row, rival=row.differ and row.behind <= np.log(ODDS)) for row in found)


@dataclass(frozen=True)
class _Common:
    """The calibration in which nothing differs between runs: residuals e (N,), columns X (N, n) of what was searched,
    one column per scale of every other value (`held`) and of every row, and its log likelihood.

    A held value may be a scale off, in all runs alike; a row that is not searched must not be named for that.
    """

    e: np.ndarray
    X: np.ndarray
    columns: dict[str, np.ndarray]
    held: tuple[str, ...]
    runs: np.ndarray
    groups: list[np.ndarray]
    likelihood: float

    @classmethod
    def of(
        cls, task: Simulations, p: np.ndarray, e: np.ndarray, J: np.ndarray, searched: Sequence[str], offset: Free
    ) -> "_Common":
        """At p (n,) of `task`, with Jacobian J (N, n)."""
        names, spreads = [free.name for free in task.shared], task.spreads(p)
        columns = {name: J[:, j] * spreads[j] for j, name in enumerate(names)}
        columns.setdefault(offset.name, np.full(len(e), offset.scale))
        X = np.hstack([J[:, [names.index(name) for name in searched]], J[:, len(names) :]])
        held = tuple(name for name in columns if name not in searched)
        runs = np.repeat(np.eye(len(task.records)), task.lengths, axis=0)
        more = [np.column_stack([columns[name] for name in held])]
        groups, size = discrepancy.estimate(e, X, *_of_records(task, p), more)
        return cls(e, X, columns, held, runs, groups, size.likelihood)

    def gain(self, name: str) -> float:
        """What differences of one value add to the log likelihood, by one linear step."""
        own = _differences(self.columns[name][:, None] * self.runs)
        return discrepancy.sizes(self.e, self.X, [*self.groups, own]).likelihood - self.likelihood

    def beside(
        self,
        row: Agreement,
        problem: Simulations,
        start: np.ndarray,
        p: np.ndarray,
        level: float,
        least: float,
        limit: float,
    ) -> Agreement:
        """The row with the values at the end p of the search of `problem` from `start`, and whether they differ.

        The last own parameter of each run is the row's.
        """
        e, J = problem.linearise(p)
        last, free = [int(own[-1]) for own in problem.own], problem.free[problem.own[0][-1]]
        centre, spread = float(start[last[0]]), float(problem.spreads(start)[last[0]])
        steps, columns, others = (p - start)[last] / spread, J[:, last] * spread, np.delete(J, last, axis=1)
        together = columns.sum(axis=1)
        held = [together if name == row.name else self.columns[name] for name in self.held]
        X = others if row.name in self.held else np.column_stack([others, together])
        more = [np.column_stack(held), _differences(columns)]
        groups, size = discrepancy.estimate(e + columns @ steps, X, *_of_records(problem, p), more)
        n, departures = len(last), replace(size, groups=size.groups[:-2])
        design = np.hstack([columns, others * np.delete(problem.spreads(p), last)])
        _, posterior, sampling = own_steps(e, design, groups[:-2], departures)
        stds, wide = np.sqrt(np.diag(posterior)[:n]), float(norm.ppf(0.5 + level / 2))
        low, values, high = (free.outer(centre + spread * (steps + side * wide * stds)) for side in (-1.0, 0.0, 1.0))
        moved = np.sqrt(np.sum(columns**2, axis=0) / problem.lengths) * np.abs(steps - np.median(steps))
        gain = size.likelihood - self.likelihood
        row = replace(
            row,
            values=values,
            low=low,
            high=high,
            told=stds**2 < 0.5,
            chance=_chance(gain),
            differ=_chance(gain) < limit and float(moved.max()) > least,
            rms=float(np.sqrt(np.mean(e**2))),
            behind=-gain,
        )
        odd, rest = odd_run(steps, sampling[:n, :n], limit) if row.differ else (None, True)
        return replace(row, odd=odd, rest_agrees=rest)


def without_each(task: Simulations, p: np.ndarray, options: Options) -> list[np.ndarray]:
    """Coordinates (n,) of the optima without one of the runs each, from p (n,): without the odd one they are its leg's.

    What is the run's own stays.
    """
    points = []
    for k, own in enumerate(task.own):
        columns = np.delete(np.arange(len(p)), own)
        rest = Simulations(task.shared, [*task.records[:k], *task.records[k + 1 :]], task.noise)
        rest.steps, point = task.steps[columns], p.copy()
        point[columns] = descend(rest, p[columns], None, options).p
        points.append(point)
    return points


def _searched(problem: Simulations, starts: Sequence[np.ndarray], options: Options) -> np.ndarray:
    """The best of descents from two of the `starts` (n,), after a scan of the runs' own values, and from a last scan:
    valleys of a joint that sticks or strikes are short."""
    points = np.array([*starts, *(_scanned(problem, start) for start in starts)])
    order = np.argsort(problem.losses(points))[:2]
    best = min((descend(problem, points[k], None, options) for k in order), key=lambda outcome: outcome.cost)
    last = descend(problem, _scanned(problem, best.p), None, options)
    return min(best, last, key=lambda outcome: outcome.cost).p


def _scanned(problem: Simulations, start: np.ndarray) -> np.ndarray:
    """The start with the best of some values for the last own parameter of each run, where all else is held."""
    points, p = np.repeat(start[None], len(_SCAN), axis=0), start.copy()
    last = [int(own[-1]) for own in problem.own]
    points[:, last] += _SCAN[:, None] * problem.spreads(start)[last]
    points = np.clip(points, problem.low, problem.high)
    for record, rows, j in zip(problem.records, problem.responses(points), last, strict=True):
        losses = np.sum((record.y - rows)[:, record.scored] ** 2, axis=1)
        p[j] = points[int(np.argmin(np.where(np.isfinite(losses), losses, np.inf))), j]
    return p


def _of_records(task: Simulations, p: np.ndarray) -> tuple[list[np.ndarray], list[float], np.ndarray]:
    """Responses, sampling times and scored samples, as `discrepancy.estimate` takes them."""
    scored = np.concatenate([record.scored for record in task.records])
    return task.responses_at(p), [record.Ts for record in task.records], scored


def _differences(columns: np.ndarray) -> np.ndarray:
    """Columns (N, runs) of a value's own in each run, without what they have in common (N, runs - 1)."""
    return np.asarray(columns @ null_space(np.ones((1, columns.shape[1]))))


def _chance(gain: float) -> float:
    """Probability of such a gain in log likelihood where nothing differs, by the size of differences, which is not
    negative (Self and Liang, J. Am. Statist. Assoc. 82, 1987)."""
    return float(0.5 * chi2.sf(2.0 * gain, 1)) if gain > 0.0 else 1.0


def split(
    task: Simulations,
    p: np.ndarray,
    name: str,
    searched: Sequence[str],
    offset: Free,
    J: np.ndarray | None = None,
) -> tuple[Simulations, np.ndarray]:
    """The same problem with an own value of `name` in each run, and its coordinates at p (n,).

    Of the shared parameters only those `searched` move; `offset` has an own value where `name` is not shared. With the
    Jacobian J (N, n) of `task` at p, its own is known there.
    """
    names = [free.name for free in task.shared]
    j = names.index(name) if name in names else None
    free = offset if j is None else task.shared[j]
    kept = [i for i, row in enumerate(names) if row in searched and i != j]
    fixed = task.values(p)[: len(names)]
    records = [_with_own(record, free, j, kept, fixed) for record in task.records]
    problem = Simulations([task.shared[i] for i in kept], records, task.noise)
    value, step = (0.0, 0.05) if j is None else (p[j], task.steps[j])
    start, steps = p[kept], task.steps[kept]
    for own in task.own:
        start = np.concatenate([start, p[own], [value]])
        steps = np.concatenate([steps, task.steps[own], [step]])
    problem.steps = steps
    if J is not None:
        column = np.full(len(J), offset.scale) if j is None else J[:, j]
        runs = np.repeat(np.arange(len(task.records)), task.lengths)
        parts = [np.column_stack([J[:, own], column * (runs == k)]) for k, own in enumerate(task.own)]
        problem.take_over(start, task.responses_at(p), np.hstack([J[:, kept], *parts]))
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
