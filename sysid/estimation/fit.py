"""fit_chain(model, data) -> Fit: starts, searches, the best of them, its covariance and warnings."""

import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace

import numpy as np

from sysid.base.criteria import criteria
from sysid.base.errors import InputError, unknown
from sysid.base.threads import available, one_blas_thread
from sysid.data.record import IOData
from sysid.estimation.initial_state import with_initial_states
from sysid.estimation.objective import Objective, spread
from sysid.estimation.problem import ChainProblem
from sysid.estimation.result import Fit, check_channels
from sysid.estimation.starts import starts as make_starts
from sysid.model.chain import Chain
from sysid.solver.covariance import Covariance
from sysid.solver.iterate import Options, Outcome, iterate
from sysid.solver.searches import search as make_search

# Every start gets a few iterations, then only the best go on: a start that is far behind by then seldom wins.
# The first iterations always use Levenberg-Marquardt, the most reliable search far from an optimum.
_TRIAL, _TRIAL_SEARCH, _LEADERS = 15, "lm", 2
_PASSES = 4  # the standard deviation of the residuals converges within this many


@dataclass(frozen=True)
class _Run:
    """The data that all starts of one fit share."""

    model: Chain
    data: IOData
    objective: Objective
    search: str
    options: Options
    progress: Callable[[str], None] | None
    huber_threshold: float = np.inf

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
            loss = outcome.cost / max(int(self.data.observed.sum()), 1)
            self.progress(f"{self.model.structure}: loss {loss:.4g} after {outcome.stop.iterations} iterations")
        return outcome


def fit_chain(
    model: Chain,
    data: IOData,
    search: str = "auto",
    starts: int = 5,
    seed: int = 0,
    options: Options | None = None,
    start: np.ndarray | None = None,
    objective: Objective | None = None,
    progress: Callable[[str], None] | None = None,
) -> Fit:
    """Fit a chain to a record; see `sysid.fit` for the arguments and errors."""
    began = time.perf_counter()
    model = model if start is not None else model.scaled(data.u, data.y)
    run = _Run(
        model, data, objective or Objective(), make_search(search).name, (options or Options()).begun(), progress
    )
    _check(model, data, run.objective)
    if starts < 1:
        raise InputError(f"starts is {starts}; give at least 1")
    with one_blas_thread():
        points = _own_starts(model, start) if start is not None else make_starts(model, data, starts, seed)
        problems = [run.problem(with_initial_states(model, theta, data)) for theta in points]
        problems = _with_curvature_weight(run, problems)
        outcomes = _race(run, problems)
        costs = [o.cost for o in outcomes]
        best = int(np.argmin(costs))
        if not np.isfinite(costs[best]):
            raise InputError(
                f"none of {len(points)} start(s) gives a valid model: {outcomes[best].stop.reason}; "
                "detrend the data or lower the orders"
            )
        problem, outcome = problems[best], outcomes[best]
        problem, outcome = _follow_noise(run, problem, outcome)
        theta, cov, d = problem.thetas(outcome.p)[0], problem.covariance(outcome.p), problem.count(outcome.p)
    N = int(data.observed.sum())
    e, plain = problem.bare.residual(outcome.p), problem.plain.residual(outcome.p)
    assert e is not None
    assert plain is not None
    return Fit(
        model=model,
        theta=theta,
        Ts=data.Ts,
        criteria=criteria(float(e @ e) / N, N, d, mse=float(plain @ plain) / N),
        covariance=cov,
        stop=outcome.stop,
        history=outcome.history,
        warnings=_warnings(model, theta, cov, outcome),
        losses=tuple(c / N for c in costs),
        seconds=time.perf_counter() - began,
        search=run.search,
        n_init=_n_init(model, data),
        u_span=(float(data.u.min()), float(data.u.max())),
    )


def _race(run: _Run, problems: list[ChainProblem]) -> list[Outcome]:
    if len(problems) == 1:
        return [run.iterate(problems[0], problems[0].start, run.options)]
    trial = replace(run.options, max_iterations=min(_TRIAL, run.options.max_iterations))
    # Threads, not processes: the loops over samples release the interpreter's lock, and no data are copied.
    with ThreadPoolExecutor(min(len(problems), available())) as pool:
        outcomes = list(pool.map(lambda problem: run.iterate(problem, problem.start, trial, _TRIAL_SEARCH), problems))
        leaders = [int(k) for k in np.argsort([o.cost for o in outcomes], kind="stable")[:_LEADERS]]
        ends = list(pool.map(lambda k: run.iterate(problems[k], outcomes[k].p, run.options), leaders))
    for k, end in zip(leaders, ends, strict=True):
        outcomes[k] = outcomes[k].then(end)
    return outcomes


def _follow_noise(run: _Run, problem: ChainProblem, outcome: Outcome) -> tuple[ChainProblem, Outcome]:
    """Continue the search while Huber's threshold and the curvature weight follow the spread of the residuals."""
    threshold, curvature = run.objective.huber_threshold, run.objective.curvature_weight
    for _ in range(_PASSES):
        noise = _noise(problem, outcome.p, threshold is not None)
        # A rough curvature weight is sufficient; the threshold needs a little more accuracy.
        steady = threshold is None or abs(problem.huber_threshold / threshold - noise) < 0.05 * noise
        known = problem.curvature_weight
        if steady and (known == 0.0 or curvature * noise < known * 1.25 < 2.0 * curvature * noise):
            break
        huber = np.inf if threshold is None else threshold * noise
        problem = replace(problem, huber_threshold=huber, curvature_weight=curvature * noise if known else 0.0)
        outcome = outcome.then(run.iterate(problem, outcome.p, run.options))
    return problem, outcome


def _with_curvature_weight(run: _Run, problems: list[ChainProblem]) -> list[ChainProblem]:
    """The problems with one curvature weight, from the smallest residuals of any start."""
    weight, kinks = run.objective.curvature_weight, len(run.model.kinks(problems[0].theta0[0])[0])
    if not weight or not kinks:
        return problems
    noise = min(_noise(problem, problem.start, False) for problem in problems)
    if not np.isfinite(noise):
        return problems
    return [replace(problem, curvature_weight=weight * noise) for problem in problems]


def _noise(problem: ChainProblem, p: np.ndarray, robust: bool) -> float:
    """Standard deviation of the residuals at p; infinite if the model is invalid, never exactly zero."""
    e = replace(problem.bare, huber_threshold=np.inf).residual(p)
    if e is None or not np.all(np.isfinite(e)):
        return np.inf
    return max(spread(e) if robust else float(np.std(e)), 1e-12 * np.sqrt(problem.size / len(e)))


def _n_init(model: Chain, data: IOData) -> int:
    """Samples that give the initial state of a free run: a twentieth of a record, because slow states need many."""
    N = min(data.lengths)
    least = max(50, 4 * max((b.n_state for _, b in model.dynamics), default=0))
    return min(max(least, min(N // 20, 1000)), N // 4)


def _own_starts(model: Chain, start: np.ndarray) -> list[np.ndarray]:
    try:
        points = np.array(start, dtype=float, ndmin=2)
    except (TypeError, ValueError):
        raise InputError(f"start is {start!r}; give {len(model.names)} numbers, or several such rows") from None
    if points.ndim != 2 or not len(points) or points.shape[1] != len(model.names) or not np.all(np.isfinite(points)):
        raise InputError(
            f"start has shape {np.shape(start)}; give {len(model.names)} finite values, one for each parameter, or "
            "several such rows"
        )
    return list(points)


def _ridge(model: Chain, objective: Objective) -> tuple[np.ndarray | None, np.ndarray | None]:
    if not objective.ridge:
        return None, None
    for name in objective.nominal:
        if name not in model.names:
            raise unknown("parameter", name, model.names)
    nominal = np.array([objective.nominal.get(name, 0.0) for name in model.names])
    size = np.where(nominal != 0.0, np.abs(nominal), 1.0)
    return np.where(model.free & ~model.initial, np.sqrt(objective.ridge) / size, 0.0), nominal


def _check(model: Chain, data: IOData, objective: Objective) -> None:
    check_channels(model, data)
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
    lost = [(b, int(cov.unidentifiable[model.index(b)].sum())) for b in model.blocks]
    shown = [f"{n} of {b.n_parameters} parameters of {b.role}" for b, n in lost if n]
    if shown:
        found.append(f"the data do not determine {', '.join(shown)}; excite more levels or choose a smaller map")
    poles = np.concatenate([np.empty(0), *(b.poles(theta[part]) for part, b in model.dynamics)])
    if len(poles) and np.max(np.abs(poles)) >= 1.0 - 1e-9:
        found.append("a pole lies on the unit circle: the model integrates, or the data drift")
    return tuple(found)
