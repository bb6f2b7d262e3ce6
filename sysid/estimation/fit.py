"""fit_chain(model, data) -> Fit: starts, searches, the best of them, its covariance and warnings."""

import time
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from sysid.base.checks import checked
from sysid.base.criteria import criteria
from sysid.base.errors import InputError
from sysid.base.threads import one_blas_thread
from sysid.data.magnitudes import check_magnitudes
from sysid.data.record import IOData
from sysid.estimation.free_run import autoregression, departing
from sysid.estimation.guard import (
    guarded,
    less_smoothed,
    linear_start,
    not_above_linear,
    worse_than_constant,
)
from sysid.estimation.initial_state import with_initial_states
from sysid.estimation.normal import Normal
from sysid.estimation.objective import Objective
from sysid.estimation.origin import Origin, share_explained
from sysid.estimation.problem import ChainProblem
from sysid.estimation.result import Fit, check_channels
from sysid.estimation.search import ENOUGH, SAME, Raced, Run, noise_of, portfolio, race, with_curvature_weight
from sysid.estimation.starts import starts as make_starts
from sysid.estimation.starts.portfolio.candidates import applies
from sysid.model.chain import Chain
from sysid.solver.covariance import Covariance
from sysid.solver.iterate import Options, Outcome, until
from sysid.solver.searches import search as make_search

AUTO = "auto"
_USUAL = 5  # starts of a chain for which there is no portfolio
_PASSES = 4  # the standard deviation of the residuals converges within this many


@checked(own=("start", "starts"))
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
    model = model if start is not None else model.scaled(data.u, data.y)
    run = Run(model, data, objective or Objective(), make_search(search).name, (options or Options()).begun(), progress)
    _check(model, data, run.objective)
    normal = Normal.of(model, data, run.objective) if start is None else Normal.kept(model, data)
    if starts != AUTO and (isinstance(starts, str) or starts < 1):
        raise InputError(f"starts is {starts!r}; give {AUTO!r} or a number of at least 1")
    with one_blas_thread():
        there = replace(run, model=normal.chain, data=normal.data, size=normal.size)
        raced = _raced(there, starts, seed, start)
        first = linear_start(there, raced, seed) if start is None else _given(there, raced)
        raced = guarded(there, raced, first)
        raced = not_above_linear(there, raced) if start is None else raced
        ended = less_smoothed(there, *_follow_noise(there, raced.problem, raced.outcome), first)
        cov, d = ended[0].uncertainty(ended[1].p)
        problem, outcome = normal.back(model, data, *ended)
        thetas = problem.thetas(outcome.p)
        theta, noise = thetas[0], _noise(model, thetas, data)
    N = int(data.observed.sum())
    e, plain = problem.bare.residual(outcome.p), problem.plain.residual(outcome.p)
    assert e is not None
    assert plain is not None
    mse = float(plain @ plain) / N
    fit = Fit(
        model=model,
        theta=theta,
        Ts=data.Ts,
        criteria=criteria(float(e @ e) / N, N, d, mse=mse),
        covariance=normal.covariance(cov),
        stop=outcome.stop,
        history=outcome.history,
        warnings=_warnings(model, theta, normal.covariance(cov), outcome)
        + _alone(raced)
        + worse_than_constant(data, mse),
        losses=tuple(c * normal.size**2 / N for c in raced.costs),
        members=raced.members,
        agreed=raced.agreed,
        seconds=time.perf_counter() - began,
        search=run.search,
        n_init=_n_init(model, data),
        u_span=(float(data.u.min()), float(data.u.max())),
        u_offset=data.u_offset.copy(),
        y_offset=data.y_offset.copy(),
        origin=Origin.of(data, share_explained(data, mse)),
        noise=noise,
    )
    return replace(fit, warnings=fit.warnings + departing(model, data, mse, lambda: fit.runs(data), fit.n_init))


def _noise(model: Chain, thetas: np.ndarray, data: IOData) -> tuple[tuple[float, ...], ...]:
    """Autoregression of each output's residuals; theta (K, P) has the initial states of each experiment."""
    runs = [model.outputs(theta, e.u) for theta, e in zip(thetas, data.experiments, strict=True)]
    errors = np.where(data.observed, data.y - np.concatenate(runs), 0.0)
    sizes = np.std(data.y, axis=0)
    return tuple(autoregression(v, data.lengths, float(s)) for v, s in zip(errors.T, sizes, strict=True))


def _raced(run: Run, starts: int | str, seed: int, start: "np.ndarray | Fit | None") -> Raced:
    """The best of the given starts, of the portfolio where there is one for this chain, or of its own starts."""
    if start is None and applies(run.model):
        found = portfolio(run, seed, None if isinstance(starts, str) else starts)
        if found is not None:
            return found
    count = _USUAL if isinstance(starts, str) else starts
    with until(run.options.deadline):
        points = _own_starts(run.model, start) if start is not None else make_starts(run.model, run.data, count, seed)
    problems = [run.problem(with_initial_states(run.model, theta, run.data)) for theta in points]
    problems = with_curvature_weight(run, problems)
    outcomes = race(run, problems)
    costs = [o.cost for o in outcomes]
    best = int(np.argmin(costs))
    if not np.isfinite(costs[best]):
        raise InputError(
            f"none of {len(points)} start(s) gives a valid model: {outcomes[best].stop.reason}; "
            "detrend the data or lower the orders"
        )
    agreed = sum(c <= SAME * costs[best] for c in costs) if start is None else 0
    return Raced(problems[best], outcomes[best], tuple(costs), agreed=agreed)


def _given(run: Run, raced: Raced) -> ChainProblem | None:
    """The problem around the start that was given, without smoothing: the fit is not worse than it by its plain errors.

    None where an objective was chosen: its penalties may cost plain errors.
    """
    return replace(raced.problem, curvature_weight=0.0, scratch={}) if run.objective == Objective() else None


def _alone(raced: Raced) -> tuple[str, ...]:
    """A warning where the portfolio ended without agreement."""
    if not raced.members or len(raced.members) < ENOUGH or raced.agreed >= ENOUGH:
        return ()
    return (
        f"only one of {len(raced.members)} starts came to this loss: a better optimum may exist; give more starts, for "
        f"example starts={4 * len(raced.members)}",
    )


def _follow_noise(run: Run, problem: ChainProblem, outcome: Outcome) -> tuple[ChainProblem, Outcome]:
    """Continue the search while Huber's threshold and the curvature weight follow the spread of the residuals."""
    threshold, curvature = run.objective.huber_threshold, run.objective.curvature_weight
    for _ in range(_PASSES):
        noise = noise_of(problem, outcome.p, threshold is not None)
        # A rough curvature weight is sufficient; the threshold needs a little more accuracy.
        steady = threshold is None or abs(problem.huber_threshold / threshold - noise) < 0.05 * noise
        known = problem.curvature_weight
        if steady and (known == 0.0 or curvature * noise < known * 1.25 < 2.0 * curvature * noise):
            break
        huber = np.inf if threshold is None else threshold * noise
        problem = replace(problem, huber_threshold=huber, curvature_weight=curvature * noise if known else 0.0)
        outcome = outcome.then(run.iterate(problem, outcome.p, run.options))
    return problem, outcome


def _n_init(model: Chain, data: IOData) -> int:
    """Samples that give the initial state of a free run: a twentieth of a record, because slow states need many."""
    N = min(data.lengths)
    least = max(50, 4 * max((b.n_state for _, b in model.dynamics), default=0))
    return min(max(least, min(N // 20, 1000)), N // 4)


def _own_starts(model: Chain, start: Any) -> list[np.ndarray]:
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
    check_channels(model, data)
    check_magnitudes(data)
    if objective.weights and len(objective.weights) != data.y.shape[1]:
        raise InputError(f"{len(objective.weights)} weights for {data.y.shape[1]} output(s); give one for each")
    for kind, signals in (("input", data.u), ("output", data.y)):
        for column in signals.T:
            if np.ptp(column) == 0.0:
                raise InputError(
                    f"the {kind} is constant ({column[0]:g}) over all {len(column)} samples; record one that varies"
                )
    own = int((model.free & model.initial).sum())
    needed = int(model.free.sum()) + (len(data.lengths) - 1) * own + 1
    if data.observed.sum() < needed:
        raise InputError(
            f"{int(data.observed.sum())} samples are too few for {needed - 1} free parameters ({model.structure}); "
            f"give at least {needed} samples or lower the orders"
        )


def _warnings(model: Chain, theta: np.ndarray, cov: Covariance, outcome: Outcome) -> tuple[str, ...]:
    found = []
    if not outcome.stop.converged:
        found.append(f"the search did not converge: {outcome.stop.reason}")
    if beside := _beside(model, theta):
        found.append(f"{', '.join(beside)} ended outside the bounds, since the block has limits of its own; widen them")
    lost = [(b, int(cov.unidentifiable[model.index(b)].sum())) for b in model.blocks]
    shown = [f"{n} of {b.n_parameters} parameters of {b.role}" for b, n in lost if n]
    if shown:
        found.append(f"the data do not determine {', '.join(shown)}; excite more levels or choose a smaller map")
    poles = np.concatenate([np.empty(0), *(b.poles(theta[part]) for part, b in model.dynamics)])
    if len(poles) and np.max(np.abs(poles)) >= 1.0 - 1e-9:
        found.append("a pole lies on the unit circle: the model integrates, or the data drift")
    return tuple(found)


def _beside(model: Chain, theta: np.ndarray) -> list[str]:
    """Parameters that are outside the bounds that the model gives them, but for rounding."""
    low, high = model.limits
    room = 1e-6 * np.maximum(np.abs(theta), 1e-6 * np.abs(theta).max(initial=0.0))
    outside = (theta < low - room) | (theta > high + room)
    return [name for name, out in zip(model.names, outside, strict=True) if out and name in model.bounds]
