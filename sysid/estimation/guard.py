"""A fit is never worse than its own linear start: where a portfolio ends above it, the search goes on from there."""

from dataclasses import replace

import numpy as np

from sysid.base.errors import InputError
from sysid.data.record import IOData
from sysid.estimation.initial_state import with_initial_states
from sysid.estimation.problem import ChainProblem
from sysid.estimation.search import SAME, Raced, Run
from sysid.estimation.starts import starts as make_starts
from sysid.estimation.starts._shared import longest, output_error_start, start_maps
from sysid.estimation.starts.portfolio.candidates import applies
from sysid.model.chain import Chain
from sysid.solver.iterate import Outcome, iterate, until
from sysid.solver.searches import LevenbergMarquardt

_SHOWN = 20_000  # samples that give the linear start
_QUICK = 5000  # samples whose linear start takes less than a second: also where the time is over
_EASED, _EASE = 3, 0.1  # times that the weight of the kinks is made smaller, and the share that is left of it
_BELOW = 0.999  # times a loss: what is a better linear model
_CLEAR = 1.0 + 1e-6  # times the mean square of the output, above which a fit explains less than a constant


def linear_start(run: Run, raced: Raced, seed: int) -> ChainProblem | None:
    """The problem around the chain's linear start, without smoothing.

    None where a race of starts contained it and nothing is smoothed, where there is none, or no time for it.
    """
    part = longest(run.data)
    if not (raced.members or raced.problem.curvature_weight) or (run.late and part.N > _QUICK):
        return None
    try:
        with until(run.options.deadline):
            first = make_starts(run.model, part.select(0, min(part.N, _SHOWN)), 1, seed)[0]
    except (InputError, np.linalg.LinAlgError):
        return None
    problem = run.problem(with_initial_states(run.model, first, run.data))
    return problem if np.isfinite(_cost(problem, problem.start)) else None


def guarded(run: Run, raced: Raced, first: ChainProblem | None) -> Raced:
    """The result, or that of a search from the linear start `first` where it ends lower.

    A portfolio need not contain that start: its candidates come from curves, and a map may not come near to them. A
    race of starts contains it.
    """
    if first is None or not raced.members:
        return raced
    problem = replace(first, curvature_weight=raced.problem.curvature_weight)
    if not _cost(problem, problem.start) < raced.outcome.cost:
        return raced
    outcome = run.iterate(problem, problem.start, run.options)
    members, costs = (*raced.members, "linear"), (*raced.costs, outcome.cost)
    same = raced.outcome.cost <= SAME * outcome.cost  # one optimum, to which one start more has come
    agreed = raced.agreed + 1 if same else 1
    return replace(raced, problem=problem, outcome=outcome, members=members, costs=costs, agreed=agreed)


def not_above_linear(run: Run, raced: Raced) -> Raced:
    """The result, or that of a search from the best linear model of all experiments where that model is better.

    Starts come from the longest experiment; a map that suits its range may be flat over the others.
    """
    chain, objective = run.model, run.objective
    plain = objective.huber_threshold is None and not objective.ridge and not objective.weights
    if len(run.data.lengths) == 1 or not plain or not applies(chain) or len(chain.dynamics) != 1 or run.late:
        return raced
    linear, rows = _linear_model(run, chain.part(raced.problem.thetas(raced.outcome.p)[0], chain.linear))
    if not squares(linear, rows, run.data) < _BELOW * _cost(raced.problem.plain, raced.outcome.p):
        return raced
    best = raced
    for straight in (False, True):
        thetas = _around_linear(chain, rows, run.data, straight)
        problem = replace(run.problem(thetas), curvature_weight=raced.problem.curvature_weight)
        outcome = run.iterate(problem, problem.start, run.options)
        if _cost(problem.plain, outcome.p) < _cost(best.problem.plain, best.outcome.p):
            best = replace(raced, problem=problem, outcome=outcome, agreed=1)
    members = (*raced.members, "linear") if raced.members else ()
    return replace(best, members=members, costs=(*raced.costs, best.outcome.cost))


def _linear_model(run: Run, known: np.ndarray) -> tuple[Chain, np.ndarray]:
    """The best linear model of all experiments, as a chain, and its theta (K, p); `known` (p,) is one start of two."""
    chain, part = Chain((run.model.linear,)), longest(run.data)
    found = output_error_start(run.model.linear, part.u[:, 0], part.y[:, 0])
    there = replace(run, model=chain)
    ends = []
    for start in (found, known):
        problem = there.problem(with_initial_states(chain, start, run.data))
        outcome = iterate(problem, problem.start, LevenbergMarquardt(), run.options)
        ends.append((outcome.cost, problem.thetas(outcome.p)))
    return chain, min(ends, key=lambda end: end[0])[1]


def squares(chain: Chain, thetas: np.ndarray, data: IOData) -> float:
    """The sum of the squared errors of free runs from theta (K, P), one row for each experiment."""
    runs = [chain.outputs(theta, e.u) for theta, e in zip(thetas, data.experiments, strict=True)]
    return float(np.sum((data.y - np.concatenate(runs))[data.observed] ** 2))


def _around_linear(chain: Chain, rows: np.ndarray, data: IOData, straight: bool) -> np.ndarray:
    """thetas (K, P) of the chain with this linear model (K, p) between maps near a straight line."""
    linear, theta = chain.linear, np.zeros(len(chain.names))
    k = chain.blocks.index(linear)
    start_maps(chain, theta, chain.blocks[:k], data.u[:, 0], data.u[:, 0], straight)
    thetas = np.tile(theta, (len(rows), 1))
    thetas[:, chain.index(linear)] = rows
    x = np.concatenate([chain.through(t, e.u[:, 0], 0, k + 1) for t, e in zip(thetas, data.experiments, strict=True)])
    start_maps(chain, theta, chain.blocks[k + 1 :], x, x, straight)
    for block in chain.blocks[k + 1 :]:
        thetas[:, chain.index(block)] = theta[chain.index(block)]
    return thetas


def less_smoothed(
    run: Run, problem: ChainProblem, outcome: Outcome, first: ChainProblem | None
) -> tuple[ChainProblem, Outcome]:
    """The fit with a smaller weight of the kinks where that weight keeps its errors above those of `first`.

    The linear start has curves of its own, which are not smoothed. On a short or noisy record the weight may be large.
    """
    if first is None or not problem.curvature_weight:
        return problem, outcome
    limit = _cost(first.plain, first.start)
    for _ in range(_EASED):
        if _cost(problem.plain, outcome.p) <= limit:
            return problem, outcome
        problem = replace(problem, curvature_weight=_EASE * problem.curvature_weight)
        outcome = outcome.then(run.iterate(problem, outcome.p, run.options))
    if _cost(problem.plain, outcome.p) <= limit:
        return problem, outcome
    return first, outcome.then(run.iterate(first, first.start, run.options))


def _cost(problem: ChainProblem, p: np.ndarray) -> float:
    e = problem.residual(p)
    return float(e @ e) if e is not None and np.all(np.isfinite(e)) else np.inf


def worse_than_constant(data: IOData, mse: float) -> tuple[str, ...]:
    """A warning where the free run with this mean square error is further from the output than its own mean."""
    parts = [column[seen] for column, seen in zip(data.y.T, data.observed.T, strict=True)]
    squares = sum(float(np.sum((part - part.mean()) ** 2)) for part in parts)
    if not mse * data.observed.sum() > _CLEAR * squares:
        return ()
    return (
        "the free run is further from the output than the output's own mean: remove the offsets of the record "
        "(sysid.data.preprocess.detrend), or choose another structure or other orders",
    )
