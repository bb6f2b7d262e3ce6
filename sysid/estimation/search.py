"""The searches of one fit: a race of several starts, or rounds of a portfolio of starts until two of them agree."""

import time
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextvars import copy_context
from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np

from sysid.base.errors import unknown
from sysid.base.parallel import available_cores
from sysid.data.record import IOData
from sysid.estimation.free_run import autoregression, forecast
from sysid.estimation.initial_state import with_initial_states
from sysid.estimation.objective import Objective, spread
from sysid.estimation.prior import Prior
from sysid.estimation.problem import ChainProblem
from sysid.estimation.starts._start import longest, longest_number
from sysid.estimation.starts.portfolio.candidates import StartingPoint, starting_points
from sysid.estimation.starts.portfolio.curves import movable_maps
from sysid.estimation.starts.portfolio.moves import move_breakpoints, pole_alternatives
from sysid.model.chain import Chain
from sysid.solver.iterate import ESTIMATE, Options, Outcome, iterate, time_limit
from sysid.solver.linearisation import order_of
from sysid.solver.searches import search as make_search

T = TypeVar("T")

# The numbers of the portfolio were chosen on drawn plants and judged on fresh ones (study global_optimum): 147 of
# 150 fits end within 1 % of the loss from the truth, see docs/optimum.md.
# Every start gets a few iterations, then only the best go on: a start that is far behind by then seldom wins.
# The first iterations always use Levenberg-Marquardt, the most reliable search far from an optimum.
_TRIAL, _TRIAL_SEARCH, _LEADERS = 15, "lm", 2
_ROUNDS, _PER_ROUND = 6, 6  # of the portfolio, and its candidates in one round
ENOUGH = 2  # independent starts at one optimum end the rounds
SAME = 1.02  # losses within this ratio are one optimum
_MOVES, _WORTH = 6, 0.995  # times that break points move, while the loss falls below this share
_AFTER_MOVE = 40  # iterations after break points have moved
_REMEMBERED = 0.1  # share of their variance that residuals tell ahead: a loss 1.1 times that of white noise alone
_OTHER_POLES = 3  # pole sets tried once the maps are known
_UPDATES = 4  # times that the curvature weight follows the residuals
_WINDOW = 20_000  # samples that show where break points belong
_LONG = 3  # times as many samples are a long record


@dataclass(frozen=True)
class SearchContext:
    """What all searches of one fit share."""

    model: Chain
    data: IOData
    objective: Objective
    search: str
    options: Options
    progress: Callable[[str], None] | None
    huber_threshold: float = np.inf
    unit: float = 1.0  # of the output, in that of the user's record, for progress

    def problem(self, thetas: np.ndarray) -> ChainProblem:
        """The problem around thetas (K, P)."""
        return ChainProblem(
            self.model,
            thetas,
            self.data.experiments,
            self.model.free,
            self.huber_threshold,
            _ridge(self.model, self.objective),
            weights=np.array(self.objective.weights or (1.0,)),
        )

    def iterate(self, problem: ChainProblem, p: np.ndarray, options: Options, search: str = "") -> Outcome:
        """One search, by default with the requested method."""
        outcome = iterate(problem, p, make_search(search or self.search), options)
        problem.scratch.clear()  # otherwise each of several starts of a long record would keep a Jacobian
        if self.progress is not None:
            loss = self.unit**2 * outcome.cost / max(int(self.data.observed.sum()), 1)
            self.progress(f"{self.model.structure}: loss {loss:.4g} after {outcome.stop.iterations} iterations")
        return outcome

    def trial(self, problem: ChainProblem, first_grain: float = 0.0) -> Outcome:
        """A first few iterations from the start of a problem."""
        iterations = min(_TRIAL, self.options.max_iterations)
        options = replace(self.options, max_iterations=iterations, first_grain=first_grain)
        return self.iterate(problem, problem.start, options, _TRIAL_SEARCH)

    @property
    def out_of_time(self) -> bool:
        """Whether the time of the fit is over."""
        return time.monotonic() > self.options.deadline


def _ridge(model: Chain, objective: Objective) -> Prior | None:
    """The objective's prior, or the distance of the parameters to their nominal values; None without either."""
    if not objective.ridge:
        return objective.prior
    for name in objective.nominal:
        if name not in model.names:
            raise unknown("parameter", name, model.names)
    nominal = np.array([objective.nominal.get(name, 0.0) for name in model.names])
    size = np.where(nominal != 0.0, np.abs(nominal), 1.0)
    weight = np.where(model.free & ~model.initial, np.sqrt(objective.ridge) / size, 0.0)
    return Prior(np.eye(len(nominal)), nominal, weight)


@dataclass(frozen=True)
class SearchResult:
    """The best problem and its search, the cost of every start, the member that each came from, and how many agree."""

    problem: ChainProblem
    outcome: Outcome
    costs: tuple[float, ...]
    members: tuple[str, ...] = ()
    agreed: int = 0


def race(context: SearchContext, problems: list[ChainProblem]) -> list[Outcome]:
    """Every start for a few iterations, and the leaders to the end."""
    if len(problems) == 1:
        return [context.iterate(problems[0], problems[0].start, context.options)]
    # Threads, not processes: the loops over samples release the interpreter's lock, and no data are copied.
    with ThreadPoolExecutor(min(len(problems), available_cores())) as pool:
        outcomes = _in_threads(pool, context.trial, problems)
        leaders = [int(k) for k in order_of(o.cost for o in outcomes)[:_LEADERS]]
        ends = _in_threads(pool, lambda k: context.iterate(problems[k], outcomes[k].p, context.options), leaders)
    for k, end in zip(leaders, ends, strict=True):
        outcomes[k] = outcomes[k].then(end)
    return outcomes


def _in_threads(pool: ThreadPoolExecutor, function: Callable[[T], Outcome], items: Sequence[T]) -> list[Outcome]:
    """`function` of each item, under the caller's `np.errstate`, which a thread does not have by itself."""
    return list(pool.map(lambda own, item: own.run(function, item), [copy_context() for _ in items], items))


def set_curvature_weight(context: SearchContext, problems: list[ChainProblem]) -> list[ChainProblem]:
    """The problems with one curvature weight, from the smallest residuals of any start."""
    weight, kinks = context.objective.curvature_weight, len(context.model.kinks(problems[0].theta0[0])[0])
    if not weight or not kinks:
        return problems
    noise = min(residual_noise(problem, problem.start, False) for problem in problems)
    if not np.isfinite(noise):
        return problems
    return [replace(problem, curvature_weight=weight * noise) for problem in problems]


def residual_noise(problem: ChainProblem, p: np.ndarray, robust: bool) -> float:
    """Standard deviation of the residuals at p; infinite if the model is invalid, never exactly zero."""
    e = replace(problem.bare, huber_threshold=np.inf).residual(p)
    if e is None or not np.all(np.isfinite(e)):
        return np.inf
    return max(spread(e) if robust else float(np.std(e)), 1e-12 * np.sqrt(problem.size / len(e)))


def search_portfolio(context: SearchContext, seed: int, count: int | None) -> SearchResult | None:
    """Rounds of the portfolio until `ENOUGH` starts agree; with a count, that many candidates without this rule.

    A long record is searched on its most varied part first. None if no candidate gives a valid model.
    """
    record = longest(context.data)
    if record.N > _LONG * _WINDOW:
        result = _search_rounds(replace(context, data=_most_varied_part(record)), seed, count)
        return None if result is None else _search_whole_record(context, result)
    return _search_rounds(context, seed, count)


def _most_varied_part(record: IOData) -> IOData:
    """The part of `_WINDOW` samples over which input and output vary most."""
    begins = range(0, record.N - _WINDOW + 1, _WINDOW // 2)
    signals = [(x, np.ptp(x) or 1.0) for x in (record.u, record.y)]
    variation = [sum(float(np.ptp(x[k : k + _WINDOW]) / span) for x, span in signals) for k in begins]
    k = begins[int(np.argmax(variation))]
    return record.select(k, k + _WINDOW)


def _search_whole_record(context: SearchContext, result: SearchResult) -> SearchResult:
    """A search of the whole record from the optimum of a part."""
    theta = result.problem.thetas(result.outcome.p)[0]
    theta = np.where(context.model.initial, 0.0, theta)
    problem = context.problem(with_initial_states(context.model, theta, context.data))
    problem = set_curvature_weight(context, [problem])[0]
    outcome = context.iterate(problem, problem.start, context.options)
    N, N_part = int(context.data.observed.sum()), int(result.problem.records[0].observed.sum())
    costs = tuple(c * N / N_part for c in result.costs)  # so that they are comparable as losses
    return replace(result, problem=problem, outcome=outcome, costs=costs)


def _search_rounds(context: SearchContext, seed: int, count: int | None) -> SearchResult | None:
    """The best of the rounds on one record, with the costs and members of all; None without a valid model."""
    best: SearchResult | None = None
    costs: list[float] = []
    members: list[str] = []
    per_round = _PER_ROUND if count is None else min(count, _PER_ROUND)
    for turn in range(_ROUNDS if count is None else -(-count // _PER_ROUND)):
        theta = None if best is None else best.problem.thetas(best.outcome.p)[0]
        weight = context.objective.curvature_weight
        with time_limit(context.options.deadline):
            points = starting_points(context.model, longest(context.data), seed, turn, per_round, weight, theta)
        result = _search_round(context, points, best) if points else best
        if result is None:
            continue
        costs += result.costs
        members += result.members
        best = replace(result, costs=(), members=())
        enough = ENOUGH + _residuals_remember(best)
        if (count is None and best.agreed >= enough) or context.out_of_time:
            break
    if best is None or not np.isfinite(best.outcome.cost):
        return None
    return replace(best, costs=tuple(costs), members=tuple(members))


def _residuals_remember(result: SearchResult) -> bool:
    """Whether the past of the residuals tells them: coloured noise, or a wrong optimum on which starts agree."""
    e = result.problem.plain.residual(result.outcome.p)
    if e is None:
        return False
    a = autoregression(e, (len(e),))
    w = e - forecast(e, a, 1)
    return float(w @ w) < (1.0 - _REMEMBERED) * float(e @ e)


def _search_round(context: SearchContext, points: list[StartingPoint], previous: SearchResult | None) -> SearchResult:
    """A few iterations from every point; the best goes on if it is better than the best of previous rounds."""
    problems = [context.problem(with_initial_states(context.model, p.theta, context.data)) for p in points]
    if previous is not None:
        problems = [replace(p, curvature_weight=previous.problem.curvature_weight) for p in problems]
    else:
        problems = set_curvature_weight(context, problems)
    outcomes = [context.trial(problem, ESTIMATE) for problem in problems]
    costs = tuple(o.cost for o in outcomes)
    members = tuple(p.member for p in points)
    k = int(order_of(costs)[0])
    if previous is not None and not costs[k] < previous.outcome.cost * SAME:
        return replace(previous, costs=costs, members=members)
    problem, outcome = problems[k], outcomes[k]
    if np.isfinite(outcome.cost):
        problem, outcome = _refine(context, problem, outcome)
        if len(points) + (previous is not None) > 1 or points[k].agreed > 1:
            problem, outcome = _try_other_poles(context, problem, outcome)
    agreement = sum(p.agreed for p, c in zip(points, costs, strict=True) if c <= SAME * outcome.cost or p is points[k])
    if previous is not None:
        if outcome.cost > previous.outcome.cost / SAME:
            agreement += previous.agreed
        if previous.outcome.cost <= outcome.cost:
            problem, outcome = previous.problem, previous.outcome
    return SearchResult(problem, outcome, costs, members, agreement)


def _refine(context: SearchContext, problem: ChainProblem, outcome: Outcome) -> tuple[ChainProblem, Outcome]:
    """The search to its end, with break points moved as long as that lowers the loss."""
    if not movable_maps(context.model):
        return problem, outcome.then(context.iterate(problem, outcome.p, context.options))
    limit = replace(context.options, max_iterations=min(_AFTER_MOVE, context.options.max_iterations))
    problem, outcome = _update_curvature_weight(context, problem, outcome, limit)
    near = False
    for _ in range(_MOVES):
        candidate = None if context.out_of_time else _move_breakpoints(context, problem, outcome, near)
        if candidate is not None:
            end = context.iterate(candidate, candidate.start, limit)
            candidate, end = _update_curvature_weight(context, candidate, end, limit)
            if end.cost < outcome.cost:
                worth = end.cost < _WORTH * outcome.cost
                problem, outcome = candidate, outcome.then(end)
                if worth:
                    continue
        if near or context.out_of_time:
            break
        near = True
    if not outcome.stop.converged:
        outcome = outcome.then(context.iterate(problem, outcome.p, context.options))
    return problem, outcome


def _try_other_poles(context: SearchContext, problem: ChainProblem, outcome: Outcome) -> tuple[ChainProblem, Outcome]:
    """The search from other poles of the fit's own filters, if that leads lower."""
    number = longest_number(context.data)
    theta, record = problem.thetas(outcome.p)[number], context.data.experiments[number]
    best, end = problem, outcome
    for point in pole_alternatives(context.model, theta, record, np.random.default_rng(0), _OTHER_POLES):
        candidate = _problem_at(context.model, problem, outcome, point, number)
        end_moved = context.trial(candidate)
        if end_moved.cost < _WORTH * end.cost:
            best, end = candidate, outcome.then(end_moved)
    return (problem, outcome) if best is problem else _refine(context, best, end)


def _update_curvature_weight(
    context: SearchContext, problem: ChainProblem, outcome: Outcome, limit: Options
) -> tuple[ChainProblem, Outcome]:
    """The search continued with a curvature weight that suits the residuals: the first weight is that of a start."""
    for _ in range(_UPDATES):
        weight = context.objective.curvature_weight * residual_noise(problem, outcome.p, False)
        if not problem.curvature_weight or weight > 0.5 * problem.curvature_weight or not np.isfinite(weight):
            break
        problem = replace(problem, curvature_weight=weight)
        outcome = outcome.then(context.iterate(problem, outcome.p, limit))
    return problem, outcome


def _move_breakpoints(
    context: SearchContext, problem: ChainProblem, outcome: Outcome, near: bool
) -> ChainProblem | None:
    """The problem with break points in other places, None if there is nothing to win."""
    number = longest_number(context.data)
    theta, record = problem.thetas(outcome.p)[number], context.data.experiments[number]
    theta_moved = move_breakpoints(
        context.model, theta, record if record.N <= _WINDOW else record.select(0, _WINDOW), near
    )
    return None if theta_moved is None else _problem_at(context.model, problem, outcome, theta_moved, number)


def _problem_at(model: Chain, problem: ChainProblem, outcome: Outcome, theta: np.ndarray, number: int) -> ChainProblem:
    """The problem around theta (P,) of one experiment, with the initial states that the others have in the outcome."""
    thetas = problem.thetas(outcome.p)
    thetas[:, ~model.initial] = theta[~model.initial]
    thetas[number] = theta
    return replace(problem, theta0=thetas, scratch={})
