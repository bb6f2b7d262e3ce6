"""The searches of one fit: from several starts, or from a portfolio of starts until two of them agree."""

import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace

import numpy as np

from sysid.base.errors import unknown
from sysid.base.threads import available
from sysid.data.record import IOData
from sysid.estimation.initial_state import with_initial_states
from sysid.estimation.objective import Objective, spread
from sysid.estimation.problem import ChainProblem
from sysid.estimation.starts._shared import longest
from sysid.estimation.starts.portfolio.candidates import Point, points
from sysid.estimation.starts.portfolio.moves import alternatives, movable, relaid
from sysid.model.chain import Chain
from sysid.solver.iterate import Options, Outcome, iterate, until
from sysid.solver.searches import search as make_search

# Every start gets a few iterations, then only the best go on: a start that is far behind by then seldom wins.
# The first iterations always use Levenberg-Marquardt, the most reliable search far from an optimum.
_TRIAL, _TRIAL_SEARCH, _LEADERS = 15, "lm", 2
_ROUNDS = 3  # of the portfolio
ENOUGH = 2  # independent starts at one optimum end the rounds
SAME = 1.02  # losses within this ratio are one optimum
_RELAYS, _WORTH = 6, 0.995  # times that break points are laid again, while the loss falls below this share
_RELAID = 40  # iterations after break points were laid again
_COLOURED = 0.5  # correlation of neighbouring residuals above which agreement must be wider
_OTHERS = 3  # pole sets tried once the maps are known
_SETTLING = 4  # times that the curvature weight follows the residuals
_WINDOW = 20_000  # samples that show where break points belong
_LONG = 3  # times as many samples are a long record


@dataclass(frozen=True)
class Run:
    """The data that all starts of one fit share."""

    model: Chain
    data: IOData
    objective: Objective
    search: str
    options: Options
    progress: Callable[[str], None] | None
    huber_threshold: float = np.inf
    size: float = 1.0  # of the output's unit in that of the user's record, for progress

    def problem(self, thetas: np.ndarray) -> ChainProblem:
        """The problem around thetas (K, P)."""
        prior_weight, nominal = _ridge(self.model, self.objective)
        return ChainProblem(
            self.model,
            thetas,
            self.data.experiments,
            self.model.free,
            self.huber_threshold,
            prior_weight,
            nominal,
            weights=np.array(self.objective.weights or (1.0,)),
        )

    def iterate(self, problem: ChainProblem, p: np.ndarray, options: Options, search: str = "") -> Outcome:
        """One search, by default with the requested method."""
        outcome = iterate(problem, p, make_search(search or self.search), options)
        problem.scratch.clear()  # otherwise each of several starts of a long record would keep a Jacobian
        if self.progress is not None:
            loss = self.size**2 * outcome.cost / max(int(self.data.observed.sum()), 1)
            self.progress(f"{self.model.structure}: loss {loss:.4g} after {outcome.stop.iterations} iterations")
        return outcome

    @property
    def trial(self) -> Options:
        """The options of a first few iterations."""
        return replace(self.options, max_iterations=min(_TRIAL, self.options.max_iterations))

    @property
    def late(self) -> bool:
        """Whether the time of the fit is over."""
        return time.monotonic() > self.options.deadline


def race(run: Run, problems: list[ChainProblem]) -> list[Outcome]:
    """Every start for a few iterations, and the leaders to the end."""
    if len(problems) == 1:
        return [run.iterate(problems[0], problems[0].start, run.options)]
    # Threads, not processes: the loops over samples release the interpreter's lock, and no data are copied.
    with ThreadPoolExecutor(min(len(problems), available())) as pool:
        outcomes = list(
            pool.map(lambda problem: run.iterate(problem, problem.start, run.trial, _TRIAL_SEARCH), problems)
        )
        leaders = [int(k) for k in np.argsort([o.cost for o in outcomes], kind="stable")[:_LEADERS]]
        ends = list(pool.map(lambda k: run.iterate(problems[k], outcomes[k].p, run.options), leaders))
    for k, end in zip(leaders, ends, strict=True):
        outcomes[k] = outcomes[k].then(end)
    return outcomes


def with_curvature_weight(run: Run, problems: list[ChainProblem]) -> list[ChainProblem]:
    """The problems with one curvature weight, from the smallest residuals of any start."""
    weight, kinks = run.objective.curvature_weight, len(run.model.kinks(problems[0].theta0[0])[0])
    if not weight or not kinks:
        return problems
    noise = min(noise_of(problem, problem.start, False) for problem in problems)
    if not np.isfinite(noise):
        return problems
    return [replace(problem, curvature_weight=weight * noise) for problem in problems]


def noise_of(problem: ChainProblem, p: np.ndarray, robust: bool) -> float:
    """Standard deviation of the residuals at p; infinite if the model is invalid, never exactly zero."""
    e = replace(problem.bare, huber_threshold=np.inf).residual(p)
    if e is None or not np.all(np.isfinite(e)):
        return np.inf
    return max(spread(e) if robust else float(np.std(e)), 1e-12 * np.sqrt(problem.size / len(e)))


def _ridge(model: Chain, objective: Objective) -> tuple[np.ndarray | None, np.ndarray | None]:
    if not objective.ridge:
        return None, None
    for name in objective.nominal:
        if name not in model.names:
            raise unknown("parameter", name, model.names)
    nominal = np.array([objective.nominal.get(name, 0.0) for name in model.names])
    size = np.where(nominal != 0.0, np.abs(nominal), 1.0)
    return np.where(model.free & ~model.initial, np.sqrt(objective.ridge) / size, 0.0), nominal


@dataclass(frozen=True)
class Raced:
    """The best problem and its search, the loss of every start, the member that each came from, and how many agree."""

    problem: ChainProblem
    outcome: Outcome
    costs: tuple[float, ...]
    members: tuple[str, ...] = ()
    agreed: int = 0


def portfolio(run: Run, seed: int, count: int | None) -> Raced | None:
    """Rounds of the portfolio until `ENOUGH` starts agree; with a count, that many candidates without this rule.

    A long record is searched on its most varied part first. None if no candidate gives a valid model.
    """
    part = longest(run.data)
    if part.N > _LONG * _WINDOW:
        found = _rounds(replace(run, data=_varied(part)), seed, count)
        return None if found is None else _continued(run, found)
    return _rounds(run, seed, count)


def _varied(record: IOData) -> IOData:
    """The part of `_WINDOW` samples over which input and output vary most."""
    starts = range(0, record.N - _WINDOW + 1, _WINDOW // 2)
    signals = [(x, np.ptp(x) or 1.0) for x in (record.u, record.y)]
    spread = [sum(float(np.ptp(x[k : k + _WINDOW]) / whole) for x, whole in signals) for k in starts]
    k = starts[int(np.argmax(spread))]
    return record.select(k, k + _WINDOW)


def _continued(run: Run, found: Raced) -> Raced:
    """A search of the whole record from the optimum of a part."""
    theta = found.problem.thetas(found.outcome.p)[0]
    theta = np.where(run.model.initial, 0.0, theta)
    problem = run.problem(with_initial_states(run.model, theta, run.data))
    problem = with_curvature_weight(run, [problem])[0]
    outcome = run.iterate(problem, problem.start, run.options)
    whole, part = int(run.data.observed.sum()), int(found.problem.records[0].observed.sum())
    costs = tuple(c * whole / part for c in found.costs)  # so that they are comparable as losses
    return replace(found, problem=problem, outcome=outcome, costs=costs)


def _rounds(run: Run, seed: int, count: int | None) -> Raced | None:
    """The rounds on one record."""
    best: Raced | None = None
    costs: list[float] = []
    members: list[str] = []
    per_round = 6 if count is None else min(count, 6)
    for turn in range(_ROUNDS if count is None else -(-count // 6)):
        known = None if best is None else best.problem.thetas(best.outcome.p)[0]
        with until(run.options.deadline):
            found = points(run.model, longest(run.data), seed, turn, per_round, run.objective.curvature_weight, known)
        raced = _tried(run, found, best) if found else best
        if raced is None:
            continue
        costs += raced.costs
        members += raced.members
        best = replace(raced, costs=(), members=())
        wanted = ENOUGH + (turn == 0 and _unexplained(best))
        if (count is None and best.agreed >= wanted) or run.late:
            break
    if best is None or not np.isfinite(best.outcome.cost):
        return None
    return replace(best, costs=tuple(costs), members=tuple(members))


def _unexplained(raced: Raced) -> bool:
    """Whether the residuals go on from sample to sample: coloured noise, or a wrong optimum on which starts agree."""
    e = raced.problem.plain.residual(raced.outcome.p)
    if e is None or not min(np.ptp(e[1:]), np.ptp(e[:-1])) > 0.0:  # an exact model, but for one end perhaps
        return False
    return float(np.corrcoef(e[1:], e[:-1])[0, 1]) > _COLOURED


def _tried(run: Run, found: list[Point], before: Raced | None) -> Raced:
    """A few iterations from every point; the best goes on if it is better than what was there before."""
    problems = [run.problem(with_initial_states(run.model, p.theta, run.data)) for p in found]
    if before is not None:
        problems = [replace(p, curvature_weight=before.problem.curvature_weight) for p in problems]
    else:
        problems = with_curvature_weight(run, problems)
    outcomes = [run.iterate(p, p.start, run.trial, _TRIAL_SEARCH) for p in problems]
    costs = tuple(o.cost for o in outcomes)
    members = tuple(p.member for p in found)
    k = int(np.argmin(costs))
    if before is not None and not costs[k] < before.outcome.cost * SAME:
        return replace(before, costs=costs, members=members)
    problem, outcome = problems[k], outcomes[k]
    if np.isfinite(outcome.cost):
        problem, outcome = _polished(run, problem, outcome)
        if len(found) + (before is not None) > 1 or found[k].agreed > 1:
            problem, outcome = _with_other_poles(run, problem, outcome)
    agreed = sum(p.agreed for p, c in zip(found, costs, strict=True) if c <= SAME * outcome.cost or p is found[k])
    if before is not None:
        if outcome.cost > before.outcome.cost / SAME:
            agreed += before.agreed
        if before.outcome.cost <= outcome.cost:
            problem, outcome = before.problem, before.outcome
    return Raced(problem, outcome, costs, members, agreed)


def _polished(run: Run, problem: ChainProblem, outcome: Outcome) -> tuple[ChainProblem, Outcome]:
    """The search to its end, with break points laid again as long as that lowers the loss."""
    if not _movable(run):
        return problem, outcome.then(run.iterate(problem, outcome.p, run.options))
    limit = replace(run.options, max_iterations=min(_RELAID, run.options.max_iterations))
    problem, outcome = _settled(run, problem, outcome, limit)
    near = False
    for _ in range(_RELAYS):
        other = None if run.late else _relaid(run, problem, outcome, near)
        if other is not None:
            other, after = _settled(run, other, run.iterate(other, other.start, limit), limit)
            if after.cost < outcome.cost:
                worth = after.cost < _WORTH * outcome.cost
                problem, outcome = other, outcome.then(after)
                if worth:
                    continue
        if near or run.late:
            break
        near = True
    if not outcome.stop.converged:
        outcome = outcome.then(run.iterate(problem, outcome.p, run.options))
    return problem, outcome


def _with_other_poles(run: Run, problem: ChainProblem, outcome: Outcome) -> tuple[ChainProblem, Outcome]:
    """The search from other poles of the fit's own filters, if that leads lower."""
    rows = problem.thetas(outcome.p)
    rng = np.random.default_rng(0)
    best, end = problem, outcome
    for point in alternatives(run.model, rows[0], run.data.experiments[0], rng, _OTHERS):
        moved = rows.copy()
        moved[:, ~run.model.initial] = point[~run.model.initial]
        moved[0] = point
        other = replace(problem, theta0=moved, scratch={})
        after = run.iterate(other, other.start, run.trial, _TRIAL_SEARCH)
        if after.cost < _WORTH * end.cost:
            best, end = other, outcome.then(after)
    return (problem, outcome) if best is problem else _polished(run, best, end)


def _settled(run: Run, problem: ChainProblem, outcome: Outcome, limit: Options) -> tuple[ChainProblem, Outcome]:
    """The search continued with a curvature weight that suits the residuals: the first weight is that of a start."""
    for _ in range(_SETTLING):
        weight = run.objective.curvature_weight * noise_of(problem, outcome.p, False)
        if not problem.curvature_weight or weight > 0.5 * problem.curvature_weight or not np.isfinite(weight):
            break
        problem = replace(problem, curvature_weight=weight)
        outcome = outcome.then(run.iterate(problem, outcome.p, limit))
    return problem, outcome


def _relaid(run: Run, problem: ChainProblem, outcome: Outcome, near: bool) -> ChainProblem | None:
    """The problem from break points laid again, None if there is nothing to win."""
    rows, first = problem.thetas(outcome.p), run.data.experiments[0]
    fresh = relaid(run.model, rows[0], first if first.N <= _WINDOW else first.select(0, _WINDOW), near)
    if fresh is None:
        return None
    moved = rows.copy()
    moved[:, ~run.model.initial] = fresh[~run.model.initial]
    moved[0] = fresh
    return replace(problem, theta0=moved, scratch={})


def _movable(run: Run) -> bool:
    return bool(movable(run.model)) and run.model.channels == (1, 1)
