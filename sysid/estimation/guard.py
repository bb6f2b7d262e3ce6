"""Stages after the race: the search follows the noise that it finds, and no fit is worse than a linear one."""

from dataclasses import replace

import numpy as np
from scipy.stats import chi2

from sysid.base.errors import InputError
from sysid.block.block import StaticBlock
from sysid.blocks import Motor, Offset, ProfiledMotor, ServoMotor
from sysid.data.record import IOData
from sysid.diagnosis.direction import direction
from sysid.estimation.initial_state import filters_only, with_initial_states
from sysid.estimation.noise_model import noise_model
from sysid.estimation.origin import share_explained
from sysid.estimation.problem import ChainProblem
from sysid.estimation.search import SAME, SearchContext, SearchResult, residual_noise
from sysid.estimation.starts import starts as make_starts
from sysid.estimation.starts._start import (
    filter_blocks,
    longest,
    output_error_start,
    signals_of,
    start_maps,
)
from sysid.estimation.starts.portfolio.candidates import applies
from sysid.model.chain import Chain
from sysid.model.recipes import hold_offset
from sysid.solver.iterate import SMALL, iterate, time_limit
from sysid.solver.searches import LevenbergMarquardt

_SHOWN = 20_000  # samples that give the linear start
_QUICK = 5000  # samples whose linear start takes less than a second: also where the time is over
_EASED, _EASE = 3, 0.1  # times that the weight of the kinks is made smaller, and the share that is left of it
_BELOW = 0.999  # times a loss: what is a better linear model
_CLEAR = 1.0 + 1e-6  # times the mean square of the output, above which a fit explains less than a constant
_HELD = 1e-3  # of a constant, left by a chain that holds it
_FALSE_ALARMS = 1e-3  # of the test for an offset
_FOLLOWED = 90.0  # [%] of the output, above which a fit has the right sign
_PASSES = 4  # the standard deviation of the residuals converges within this many


def linear_reference(context: SearchContext, result: SearchResult, seed: int) -> ChainProblem | None:
    """The problem around the chain's linear start, without smoothing: no fit shall be worse.

    None where a race of starts contained it and nothing is smoothed, where there is none, or no time for it.
    """
    record = longest(context.data)
    needs_reference = result.members or result.problem.curvature_weight
    if not needs_reference or (context.out_of_time and record.N > _QUICK):
        return None
    try:
        with time_limit(context.options.deadline):
            theta = make_starts(context.model, record.select(0, min(record.N, _SHOWN)), 1, seed)[0]
    except (InputError, np.linalg.LinAlgError):
        return None
    problem = context.problem(with_initial_states(context.model, theta, context.data))
    return problem if np.isfinite(_cost(problem, problem.start)) else None


def continue_from_reference(
    context: SearchContext, result: SearchResult, reference: ChainProblem | None
) -> SearchResult:
    """The result, or that of a search from the linear start where it ends lower.

    A portfolio need not contain that start: its candidates come from curves, and a map may not come near to them. A
    race of starts contains it.
    """
    if reference is None or not result.members:
        return result
    problem = replace(reference, curvature_weight=result.problem.curvature_weight)
    if not _cost(problem, problem.start) < result.outcome.cost:
        return result
    outcome = context.iterate(problem, problem.start, context.options)
    members, costs = (*result.members, "linear"), (*result.costs, outcome.cost)
    one_optimum = result.outcome.cost <= SAME * outcome.cost  # to which one start more has come
    agreed = result.agreed + 1 if one_optimum else 1
    return replace(result, problem=problem, outcome=outcome, members=members, costs=costs, agreed=agreed)


def continue_from_linear_model(context: SearchContext, result: SearchResult) -> SearchResult:
    """The result, or that of a search from the best linear model of all experiments where that model is better.

    Starts come from the longest experiment; a map that suits its range may be flat over the others. Of 120 fits of a
    near-integrating plant in three experiments, 20 had twice the error of the linear model without this stage.
    """
    chain, objective = context.model, context.objective
    plain = objective.huber_threshold is None and not objective.ridge and not objective.weights
    several = len(context.data.lengths) > 1
    if not several or not plain or not applies(chain) or len(filter_blocks(chain)) != 1 or context.out_of_time:
        return result
    theta = result.problem.thetas(result.outcome.p)[0]
    linear, rows = _best_linear_model(context, theta)
    if not squared_errors(linear, rows, context.data) < _BELOW * _cost(result.problem.plain, result.outcome.p):
        return result
    best = result
    for straight in (False, True):
        thetas = _around_linear(chain, rows, context.data, straight)
        problem = replace(context.problem(thetas), curvature_weight=result.problem.curvature_weight)
        outcome = context.iterate(problem, problem.start, context.options)
        if _cost(problem.plain, outcome.p) < _cost(best.problem.plain, best.outcome.p):
            best = replace(result, problem=problem, outcome=outcome, agreed=1)
    members = (*result.members, "linear") if result.members else ()
    return replace(best, members=members, costs=(*result.costs, best.outcome.cost))


def _best_linear_model(context: SearchContext, theta: np.ndarray) -> tuple[Chain, np.ndarray]:
    """The best linear model of all experiments, with the offset that the chain has, and its theta (K, p).

    `theta` (P,) of the chain gives one of two starts.
    """
    (linear,), (u, y) = filter_blocks(context.model), signals_of(longest(context.data))
    offset = tuple(block for block in context.model.blocks if isinstance(block, Offset))
    chain = Chain((linear, *offset))
    linear_context = replace(context, model=chain)
    u0, y0 = (u.mean(axis=0), y.mean()) if offset else (0.0, 0.0)
    first = output_error_start(linear, u - u0, y - y0)
    second = np.concatenate([context.model.part(theta, block) for block in chain.blocks])
    ends = []
    for start in (np.append(first, [np.mean(y - Chain((linear,)).through(first, u))] * len(offset)), second):
        problem = linear_context.problem(with_initial_states(chain, start, context.data))
        outcome = iterate(problem, problem.start, LevenbergMarquardt(), context.options)
        ends.append((outcome.cost, problem.thetas(outcome.p)))
    return chain, min(ends, key=lambda end: end[0])[1]


def squared_errors(chain: Chain, thetas: np.ndarray, data: IOData) -> float:
    """The sum of the squared errors of free runs from theta (K, P), one row for each experiment."""
    runs = [chain.outputs(theta, e.u) for theta, e in zip(thetas, data.experiments, strict=True)]
    return float(np.sum((data.y - np.concatenate(runs))[data.observed] ** 2))


def _around_linear(chain: Chain, rows: np.ndarray, data: IOData, straight: bool) -> np.ndarray:
    """thetas (K, P) of the chain with this linear model (K, p) between maps near a straight line."""
    (linear,), theta = filter_blocks(chain), np.zeros(len(chain.names))
    k = chain.blocks.index(linear)
    start_maps(chain, theta, chain.blocks[:k], data.u, data.u, straight)
    thetas = np.tile(theta, (len(rows), 1))
    thetas[:, chain.index(linear)] = rows[:, : linear.n_parameters]
    x = np.concatenate([chain.through(t, e.u, 0, k + 1) for t, e in zip(thetas, data.experiments, strict=True)])
    start_maps(chain, theta, chain.blocks[k + 1 :], x, x + rows[0, linear.n_parameters :].sum(), straight)
    for block in chain.blocks[k + 1 :]:
        thetas[:, chain.index(block)] = theta[chain.index(block)]
    return thetas


def follow_noise(context: SearchContext, result: SearchResult) -> SearchResult:
    """The search continued while Huber's threshold and the curvature weight follow the spread of the residuals.

    Both are set in standard deviations of the noise, which is not known before the fit.
    """
    threshold, curvature = context.objective.huber_threshold, context.objective.curvature_weight
    problem, outcome = result.problem, result.outcome
    for _ in range(_PASSES):
        noise = residual_noise(problem, outcome.p, threshold is not None)
        # A rough curvature weight is sufficient; the threshold needs a little more accuracy.
        steady = threshold is None or abs(problem.huber_threshold / threshold - noise) < 0.05 * noise
        weight = problem.curvature_weight
        if steady and (weight == 0.0 or curvature * noise < weight * 1.25 < 2.0 * curvature * noise):
            break
        huber = np.inf if threshold is None else threshold * noise
        problem = replace(problem, huber_threshold=huber, curvature_weight=curvature * noise if weight else 0.0)
        outcome = outcome.then(context.iterate(problem, outcome.p, context.options))
    return replace(result, problem=problem, outcome=outcome)


def ease_curvature(context: SearchContext, result: SearchResult, reference: ChainProblem | None) -> SearchResult:
    """The fit with a smaller weight of the kinks where that weight keeps its errors above those of the reference.

    The linear start has curves of its own, which are not smoothed. On a short or noisy record the weight may be large.
    """
    problem, outcome = result.problem, result.outcome
    if reference is None or not problem.curvature_weight:
        return result
    limit = _cost(reference.plain, reference.start)
    for _ in range(_EASED):
        if _cost(problem.plain, outcome.p) <= limit:
            break
        problem = replace(problem, curvature_weight=_EASE * problem.curvature_weight)
        outcome = outcome.then(context.iterate(problem, outcome.p, context.options))
    if not _cost(problem.plain, outcome.p) <= limit:
        problem, outcome = reference, outcome.then(context.iterate(reference, reference.start, context.options))
    return replace(result, problem=problem, outcome=outcome)


def _cost(problem: ChainProblem, p: np.ndarray) -> float:
    e = problem.residual(p)
    return float(e @ e) if e is not None and np.all(np.isfinite(e)) else np.inf


def worse_than_constant(model: Chain, data: IOData, mse: float) -> tuple[str, ...]:
    """A warning where the free run with this mean square error is further from the output than its own mean."""
    columns = [y[observed] for y, observed in zip(data.y.T, data.observed.T, strict=True)]
    squares = sum(float(np.sum((y - y.mean()) ** 2)) for y in columns)
    if not mse * data.observed.sum() > _CLEAR * squares:
        return ()
    offset = "" if hold_offset(model.blocks) else f"{_OFFSET.format('free')}, or "
    return (
        f"the free run is further from the output than the output's own mean: {offset}choose another structure or "
        "other orders",
    )


def turned_signal(chain: Chain, data: IOData, mse: float) -> tuple[str, ...]:
    """A warning where a motor, whose gain has one sign, does not follow a record in which one signal is turned.

    A map behind the motor may fall, and takes the sign up. Nothing is said of a fit that explains the output.
    """
    motors = [k for k, block in enumerate(chain.blocks) if isinstance(block, Motor | ServoMotor | ProfiledMotor)]
    behind = [b for b in chain.blocks[motors[0] :] if isinstance(b, StaticBlock) and b.n_parameters] if motors else []
    falls = any(not isinstance(b, Offset) for b in behind)
    if not motors or falls or share_explained(data, mse) > _FOLLOWED or direction(data) >= 0:
        return ()
    return (
        "the output falls where the input rises, and a motor with a gain below zero is none: one of the two signals is "
        "turned; turn it back with sign = -1 of its channel in a mapping (qpal info FILE --write-map MAP.toml), or in "
        "Python with dataclasses.replace(data, y=-data.y)",
    )


def missing_offset(problem: ChainProblem, p: np.ndarray) -> tuple[str, ...]:
    """A warning where an offset of the output, which the chain does not hold, would lower the loss.

    A score test: what the linearised chain leaves of a constant is fitted to what it leaves of the errors. The errors
    are seldom white, so their mean is as uncertain as their autoregression makes it. Where a filter holds a
    constant and no map does, a pole near 1 has taken the place of the offset.
    """
    record = problem.records[0]
    if record.y.shape[1] > 1 or problem.chain.predicts or not filters_only(problem.chain):
        return ()
    record = record.select(0, min(record.N, _SHOWN))
    moving = int(problem.moving.sum())
    short = replace(problem.plain, theta0=problem.thetas(p)[:1], records=(record,), scratch={})
    e, J = short.linearise(np.zeros(moving))
    if not (np.all(np.isfinite(J)) and np.any(e)):
        return ()
    unit = float(np.abs(e).max())
    left, constant = _rest(J, e / unit), _rest(J, np.ones(len(e)))
    share = float(constant @ constant) / len(e)
    if share < _HELD:
        of_filters = np.zeros(len(problem.moving), dtype=bool)
        for part, _ in problem.chain.dynamics:
            of_filters[part] = True
        by_maps = _rest(J[:, ~of_filters[problem.moving]], np.ones(len(e)))  # but for the filters' transient
        slow = float(by_maps @ by_maps) > 0.5 * len(e)
        return (f"{_SLOW}{_remedy(problem.chain)}",) if slow else ()
    offset = float(left @ constant) / (share * len(e))
    rest = left - offset * constant
    noise = noise_model(rest, np.column_stack([J, constant]), (len(e),))
    variance = float(noise.root(constant[:, None], (len(e),))[0, 0]) ** 2 / (share * len(e)) ** 2
    gain = 100.0 * (1.0 - float(rest @ rest) / float(left @ left))
    if not (gain > SMALL and offset**2 > chi2.isf(_FALSE_ALARMS, 1) * variance):
        return ()
    return (
        f"the structure has no offset of its output, and one would lower the loss by about {gain:.0f} %: give it one "
        '(offset="free")',
    )


_SLOW = (
    "a pole is slower than the record, and its initial state takes the place of an offset: if the plant does not "
    "integrate, "
)
_OFFSET = 'give the structure an offset of its output (offset="{}")'


def _remedy(chain: Chain) -> str:
    """What takes the place of the pole: where a map holds what the filter does not let through, one for each record."""
    if len(chain.dynamics) > 1:
        return "lower the orders, or record for several times its time constant"
    return _OFFSET.format("each" if hold_offset(chain.blocks) else "free")


def _rest(J: np.ndarray, x: np.ndarray) -> np.ndarray:
    """What the columns of J (N, P) leave of x (N,)."""
    size = np.abs(J).max(axis=0, initial=0.0)
    scaled = J / np.where(size > 0.0, size, np.inf)
    return np.asarray(x - scaled @ np.linalg.lstsq(scaled, x, rcond=None)[0])
