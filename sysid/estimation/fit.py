"""The fit of a chain to a record: a sequence of stages from a model and data to a `Fit`.

1. Check: the record suits the model, before anything expensive begins (`_check`).
2. Normal units: the fit takes place where signals have a spread near 1, so that it does not depend on the units of the
   record (`Normal`).
3. Starts: a portfolio of candidates for chains of filters and maps, else those that the chain's table entry draws, each
   with an initial state for every experiment (`sysid.estimation.starts`).
4. Race: every start is searched a little, the best to the end (`search_starts`).
5. Guard: the search goes on from a linear model where that is better; a portfolio and the longest experiment may miss
   it (`continue_from_reference`, `continue_from_linear_model`).
6. Refine: the search goes on while the thresholds that are set in noise deviations follow the noise, and with less
   smoothing where smoothing costs more than a linear start has (`follow_noise`, `ease_curvature`).
7. Finer maps, where the objective asks for them: many break points, with a prior that the record chooses
   (`finer_maps`).
8. Named maps: shapes of few numbers instead, where the record says that a map has one (`named_maps`).
9. Past inputs: one where BIC is lower with it, all that a delay holds where the first outputs show them.
10. Result: in the units of the record, with covariance, criteria and warnings (`_result`).
"""

import time
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from sysid.base.checks import checked
from sysid.base.criteria import criteria
from sysid.base.errors import InputError, TooFewSamplesError
from sysid.base.parallel import one_blas_thread
from sysid.base.poles import Motion, motion
from sysid.blocks import Offset
from sysid.data.record import IOData, check_magnitudes
from sysid.estimation.finer_maps import becomes_finer, finer_maps, has_finer_maps, on_break_points, smoothing
from sysid.estimation.free_run import autoregression, warn_of_divergence
from sysid.estimation.guard import (
    continue_from_linear_model,
    continue_from_reference,
    ease_curvature,
    follow_noise,
    linear_reference,
    missing_offset,
    turned_signal,
    worse_than_constant,
)
from sysid.estimation.initial_state import with_initial_states
from sysid.estimation.named_maps import named_maps
from sysid.estimation.normal import Normal
from sysid.estimation.objective import LEAST_SQUARES, Objective
from sysid.estimation.origin import Origin, check_channels, share_explained
from sysid.estimation.past_inputs import past_inputs
from sysid.estimation.problem import ChainProblem
from sysid.estimation.result import Fit, check_complete
from sysid.estimation.search import (
    ENOUGH,
    SAME,
    SearchContext,
    SearchResult,
    race,
    search_portfolio,
    set_curvature_weight,
)
from sysid.estimation.starts import starts as make_starts
from sysid.estimation.starts.portfolio.candidates import applies
from sysid.model.chain import Chain
from sysid.solver.covariance import Covariance
from sysid.solver.iterate import Options, Outcome, time_limit
from sysid.solver.linearisation import order_of
from sysid.solver.searches import search as make_search

AUTO = "auto"
_USUAL = 5  # starts of a chain for which there is no portfolio


@checked(deferred=("start", "starts"))
def fit_chain(
    model: Chain,
    data: IOData,
    search: str = "auto",
    starts: int | str = AUTO,
    seed: int = 0,
    options: Options | None = None,
    start: "np.ndarray | Fit | None" = None,
    objective: Objective | None = None,
    progress: Callable[[str], None] | None = None,
) -> Fit:
    """Fit a chain to a record; see `sysid.fit` for the arguments and errors."""
    began = time.perf_counter()
    objective = objective or LEAST_SQUARES
    points: list[np.ndarray] = []
    if start is None:
        model = model.scaled(data.u, data.y)
    else:
        model = _model_at(model, start)
        model, points = on_break_points(model, _given_points(model, start), data, objective.knots)
    model = model.sampled(data.Ts)
    search, options = make_search(search).name, (options or Options()).begun()
    _check(model, data, objective)
    normal = Normal.choose(model, data, objective) if start is None else Normal.keep(model, data)
    if starts != AUTO and (isinstance(starts, str) or starts < 1):
        raise InputError(f"starts is {starts!r}; give {AUTO!r} or a number of at least 1")
    context = SearchContext(normal.chain, normal.data, objective, search, options, progress, unit=normal.size)
    with one_blas_thread():
        if start is None:
            result = search_starts(context, starts, seed)
            reference = linear_reference(context, result, seed)
            result = continue_from_reference(context, result, reference)
            result = continue_from_linear_model(context, result)
        elif has_finer_maps(model):  # without their prior a search would follow the noise: stage 7 is the search
            still = replace(options, max_iterations=0)
            result = search_from_points(replace(context, options=still), points)
            reference = None
        else:
            result = search_from_points(context, points)
            reference = _given_reference(context, result)
        has_prior = becomes_finer(model, objective) or has_finer_maps(model)  # instead of a curvature weight
        if not has_prior or (objective.huber_threshold is not None and not has_finer_maps(model)):
            result = follow_noise(context, result)
        if not has_prior:
            result = ease_curvature(context, result, reference)
        if objective.knots and not objective.ridge:
            weights = start.smoothing if isinstance(start, Fit) else None
            model, normal, result = finer_maps(model, data, normal, result, context, weights)
            model, normal, result = named_maps(model, data, normal, result, context)
        model, normal, result = past_inputs(model, data, normal, result, context)
    fit = _result(model, data, normal, result)
    fit = replace(fit, warnings=without_agreement(result, starts) + fit.warnings)
    fit = replace(fit, search=search, seconds=time.perf_counter() - began, prior=objective.prior)
    departs = warn_of_divergence(model, data, fit.criteria.mse, lambda: fit.runs(data), fit.n_init)
    turned = turned_signal(model, data, fit.criteria.mse)
    return replace(fit, warnings=turned + fit.warnings + _unsettled(fit) + departs)


def search_starts(context: SearchContext, starts: int | str, seed: int) -> SearchResult:
    """The best of the portfolio where there is one for this chain, or of the chain's own starts."""
    if applies(context.model):
        result = search_portfolio(context, seed, None if isinstance(starts, str) else starts)
        if result is not None:
            return result
    count = _USUAL if isinstance(starts, str) else starts
    with time_limit(context.options.deadline):
        points = make_starts(context.model, context.data, count, seed)
    result = search_from_points(context, points)
    return replace(result, agreed=sum(c <= SAME * result.outcome.cost for c in result.costs))


def search_from_points(context: SearchContext, points: list[np.ndarray]) -> SearchResult:
    """The best of a race from these points theta (P,); raises InputError where none gives a valid model."""
    problems = [context.problem(with_initial_states(context.model, theta, context.data)) for theta in points]
    problems = set_curvature_weight(context, problems)
    outcomes = race(context, problems)
    costs = [o.cost for o in outcomes]
    best = int(order_of(costs)[0])
    if not np.isfinite(costs[best]):
        raise InputError(
            f"none of {len(points)} start(s) gives a valid model: {outcomes[best].stop.reason}; "
            "detrend the data or lower the orders"
        )
    return SearchResult(problems[best], outcomes[best], tuple(costs))


def _given_reference(context: SearchContext, result: SearchResult) -> ChainProblem | None:
    """The problem around the start that was given, without smoothing: the fit is not worse than it by its plain errors.

    None where an objective was chosen: its penalties may cost plain errors.
    """
    if context.objective != LEAST_SQUARES:
        return None
    return replace(result.problem, curvature_weight=0.0, scratch={})


def _result(model: Chain, data: IOData, normal: Normal, result: SearchResult) -> Fit:
    """The fit in the units of the record; the search's name and the seconds are left open."""
    with one_blas_thread():
        covariance, d = result.problem.uncertainty(result.outcome.p)
        problem, outcome = normal.restore(model, data, result.problem, result.outcome)
        thetas = problem.thetas(outcome.p)
        theta, noise = thetas[0], _noise(model, thetas, data)
        covariance = normal.covariance(covariance)
    N = int(data.observed.sum())
    e, plain = problem.bare.residual(outcome.p), problem.plain.residual(outcome.p)
    assert e is not None
    assert plain is not None
    mse = float(plain @ plain) / N
    return Fit(
        model=model,
        theta=theta,
        Ts=data.Ts,
        criteria=criteria(float(e @ e) / N, N, d, mse=mse),
        covariance=covariance,
        stop=outcome.stop,
        history=outcome.history,
        warnings=(
            *_warnings(model, theta, covariance, outcome),
            *_few_samples(N, d),
            *(worse_than_constant(model, data, mse) or missing_offset(problem, outcome.p)),
        ),
        losses=tuple(c * normal.size**2 / N for c in result.costs),
        members=result.members,
        agreed=result.agreed,
        seconds=0.0,
        search="",
        n_init=_n_init(model, data),
        u_span=(float(data.u.min()), float(data.u.max())),
        y_span=(float(data.y[data.observed].min()), float(data.y[data.observed].max())),
        u_offset=data.u_offset.copy(),
        y_offset=data.y_offset.copy(),
        origin=Origin.of(data, share_explained(data, mse)),
        noise=noise,
        smoothing=smoothing(model, problem.prior),
    )


def _noise(model: Chain, thetas: np.ndarray, data: IOData) -> tuple[tuple[float, ...], ...]:
    """Autoregression of each output's residuals; theta (K, P) has the initial states of each experiment."""
    runs = [model.outputs(theta, e.u, e.y) for theta, e in zip(thetas, data.experiments, strict=True)]
    errors = np.where(data.observed, data.y - np.concatenate(runs), 0.0)
    sizes = np.std(data.y, axis=0)
    return tuple(autoregression(v, data.lengths, float(s)) for v, s in zip(errors.T, sizes, strict=True))


def without_agreement(result: SearchResult, starts: int | str) -> tuple[str, ...]:
    """A warning where the portfolio ended without agreement: of `starts` that were asked, those that differ go on."""
    n = len(result.members)
    if n < ENOUGH or result.agreed >= ENOUGH:
        return ()
    asked = f"of {starts} starts {n} were searched to the end" if starts != AUTO else f"{n} starts were searched"
    return (f"{asked}, and only one came to this loss, so a better optimum may exist; try another seed or more starts",)


def _n_init(model: Chain, data: IOData) -> int:
    """Samples that give the initial state of a free run: a twentieth of a record, because slow states need many."""
    N, limit = min(data.lengths), 1000
    # Chosen by hand: at least 50 samples and four for each state, at most 1000 and a quarter of the record. A zero of
    # the record's own looks like a slow state, so it has all of them.
    least = max(50, 4 * max((b.n_state for _, b in model.dynamics), default=0))
    own_zero = any(isinstance(part, Offset) and part.each for b in model.blocks for _, part in b.parts())
    return min(max(least, limit if own_zero else min(N // 20, limit)), N // 4)


def _model_at(model: Chain, start: Any) -> Chain:
    """The model, with the finer maps of a fit of it from which it starts."""
    if not isinstance(start, Fit) or replace(start.model, blocks=start.model.asked).names != model.names:
        return model
    return replace(start.model, fixed=model.fixed, bounds=model.bounds)


def _given_points(model: Chain, start: Any) -> list[np.ndarray]:
    """The points theta (P,) of a start that was given: one row, several, or a fit of the same parameters."""
    if isinstance(start, Fit):
        if start.model.names != model.names:
            raise InputError(
                f"start is a fit of a {start.model.structure} with {len(start.model.names)} parameters, and those of "
                f"this model ({len(model.names)}) are others; give a fit with the same ones, or numbers"
            )
        start = start.theta
    try:
        points = np.array(start, dtype=float, ndmin=2)
    except (TypeError, ValueError):
        kind = type(start).__name__
        raise InputError(
            f"start is of type {kind}; give {len(model.names)} numbers, several such rows, or a fit"
        ) from None
    if points.ndim != 2 or not len(points) or points.shape[1] != len(model.names) or not np.all(np.isfinite(points)):
        raise InputError(
            f"start has shape {np.shape(start)}; give {len(model.names)} finite values, one for each parameter, or "
            "several such rows"
        )
    return list(points)


def _check(model: Chain, data: IOData, objective: Objective) -> None:
    """Raises InputError for a record that does not suit the model or is too short, and for weights of other outputs."""
    check_channels(model, data)
    check_magnitudes(data)
    if model.predicts:
        check_complete(data)
    if objective.weights and len(objective.weights) != data.y.shape[1]:
        raise InputError(f"{len(objective.weights)} weights for {data.y.shape[1]} output(s); give one for each")
    for kind, signals in (("input", data.u), ("output", data.y)):
        for column in signals.T:
            if np.ptp(column) == 0.0:
                raise InputError(
                    f"the {kind} is constant ({column[0]:g}) over all {len(column)} samples; record one that varies"
                )
    n_states = int((model.free & model.initial).sum())  # which each experiment has separately
    minimum = int(model.free.sum()) + (len(data.lengths) - 1) * n_states + 1
    if data.observed.sum() < minimum:
        raise TooFewSamplesError(
            f"{int(data.observed.sum())} samples are too few for {minimum - 1} free parameters ({model.structure}); "
            f"give at least {minimum} samples or lower the orders",
            *(minimum - 1, minimum, model.structure),
        )


def _warnings(model: Chain, theta: np.ndarray, cov: Covariance, outcome: Outcome) -> tuple[str, ...]:
    """Warnings on the search, on bounds, on what the data do not determine, and on poles of the unit circle."""
    warnings = []
    if not outcome.stop.converged:
        warnings.append(f"the search did not converge: {outcome.stop.reason}")
    if names_outside := _outside_bounds(model, theta):
        warnings.append(
            f"{', '.join(names_outside)} ended outside the bounds, since the block has limits of its own; widen them"
        )
    # An input before the record may have no effect.
    before = np.array([slot.initial and slot.name[0] == "u" for slot in model.slots])
    lost = cov.unidentifiable & ~before
    counts = [(b, int(lost[model.index(b)].sum())) for b in model.blocks]
    parameters = [f"{n} of {b.n_parameters} parameters of {b.role}" for b, n in counts if n]
    if parameters:
        warnings.append(
            f"the data do not determine {', '.join(parameters)}; excite more levels or choose a smaller model"
        )
    poles = np.concatenate([np.empty(0), *(b.poles(theta[part]) for part, b in model.dynamics)])
    if not model.predicts and motion(poles) != Motion.STABLE:
        warnings.append("a pole lies on the unit circle: the model integrates, or the data drift")
    return tuple(warnings)


def _few_samples(N: int, d: float) -> tuple[str, ...]:
    """A warning where errors on other records have three times the noise's variance or more (FPE, Ljung 1999)."""
    if 2 * d < N:
        return ()
    return (
        f"the model has {d:.0f} effective parameters and the record {N} samples: it follows the noise; lower the "
        "orders, choose a smaller structure, or record more",
    )


def _unsettled(fit: Fit) -> tuple[str, ...]:
    """A warning of a model that predicts and does not settle: its free run says little of it."""
    if not fit.predicts or fit.settles:
        return ()
    largest = float(np.abs(fit.poles).max())
    state = "the model is not stable" if largest > 1.0 else "the model may integrate"
    return (
        f"{state} (largest pole {largest:.5g}): its free run adds up every error, however good it is; the fit that "
        "counts is that of its prediction, one step and some steps ahead",
    )


def _outside_bounds(model: Chain, theta: np.ndarray) -> list[str]:
    """Parameters that are outside the bounds that the model gives them, but for rounding."""
    low, high = model.limits
    tolerance = 1e-6 * np.maximum(np.abs(theta), 1e-6 * np.abs(theta).max(initial=0.0))
    is_outside_all = (theta < low - tolerance) | (theta > high + tolerance)
    return [
        name
        for name, is_outside in zip(model.names, is_outside_all, strict=True)
        if is_outside and name in model.bounds
    ]
