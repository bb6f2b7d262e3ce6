"""fit(structure, data) -> Fit: starts, searches, the best of them, and everything that an engineer asks of it."""

import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np

from sysid.chain import Chain
from sysid.criteria import Criteria, criteria, fit_percent
from sysid.data import IOData, siso
from sysid.errors import InputError
from sysid.initial import estimate_initial
from sysid.initial import starts as make_starts
from sysid.iterate import Options, Outcome, Stop, iterate
from sysid.problem import ChainProblem
from sysid.residuals import ResidualTests, residual_tests
from sysid.searches import search as make_search
from sysid.threads import available, one_blas_thread
from sysid.uncertainty import Covariance, pole_std


@dataclass(frozen=True)
class Parameter:
    """One parameter of a fit; std is None where it is fixed or the data do not determine it."""

    name: str
    value: float
    std: float | None
    unit: str
    free: bool
    lower: float
    upper: float


@dataclass(frozen=True)
class Fit:
    """An identified chain: theta (P,), criteria on the estimation record, covariance, and why the search stopped."""

    model: Chain
    theta: np.ndarray
    Ts: float
    criteria: Criteria
    covariance: Covariance
    stop: Stop
    history: tuple[dict[str, Any], ...]
    warnings: tuple[str, ...]
    losses: tuple[float, ...]  # of every start, so that a lonely optimum is seen
    seconds: float
    search: str
    n_init: int
    u_span: tuple[float, float] = field(default=(0.0, 0.0))  # range of the input that the fit has seen

    def simulate(self, data: IOData | np.ndarray, n_init: int | None = None) -> np.ndarray:
        """Free run (N,). For a record, its initial state is fitted to the first `n_init` outputs; for u alone, rest."""
        if isinstance(data, IOData):
            u, y = siso(data)
            self._same_rate(data)
            n = min(self.n_init if n_init is None else n_init, len(u))
            with one_blas_thread():
                theta = estimate_initial(self.model, self.theta, u[:n], y[:n])
        else:
            u = np.asarray(data, dtype=float).ravel()
            theta = np.where(self.model.initial, 0.0, self.theta)
        return self.model.simulate(theta, u)

    def fit_percent(self, data: IOData, n_init: int | None = None) -> float:
        """Free-run fit [%] on a record; the first n_init samples give the initial state and are not scored."""
        n = self._scored(data, n_init)
        return fit_percent(data.y[n:, 0], self.simulate(data, n)[n:])

    def residuals(self, data: IOData) -> np.ndarray:
        """e = y - free run on a record, without its first n_init samples (N - n_init,)."""
        n = self._scored(data, None)
        return data.y[n:, 0] - self.simulate(data, n)[n:]

    def residual_tests(self, data: IOData, max_lag: int = 25, level: float = 0.99) -> ResidualTests:
        """Whiteness of the free-run residuals on a record and their independence of its input."""
        return residual_tests(
            self.residuals(data), data.u[len(data.u) - len(self.residuals(data)) :, 0], max_lag, level
        )

    @property
    def poles(self) -> np.ndarray:
        """Poles of the linear block in z (nf,), complex."""
        return self.model.linear.poles(self._linear)

    @property
    def zeros(self) -> np.ndarray:
        """Finite zeros of the linear block in z, complex."""
        return self.model.linear.zeros(self._linear)

    @cached_property
    def pole_std(self) -> np.ndarray:
        """Standard deviation of each pole (nf,), nan where the data do not determine it."""
        linear = self.model.linear
        start = self.model.index(linear).start + linear.nb
        f = slice(start, start + linear.nf)
        return pole_std(self.theta[f], self.covariance.cov[f, f])

    @cached_property
    def parameters(self) -> tuple[Parameter, ...]:
        """All parameters with value, standard deviation, unit and bounds."""
        std = self.covariance.std()
        rows = zip(self.model.names, self.model.slots, self.theta, std, self.model.free, strict=True)
        return tuple(
            Parameter(
                n, float(v), float(s) if f and np.isfinite(s) else None, slot.unit, bool(f), slot.lower, slot.upper
            )
            for n, slot, v, s, f in rows
        )

    def curve(self, role: str, x: np.ndarray) -> np.ndarray | None:
        """The static map with this role ('input' or 'output') at x (N,); None where the chain has no such map."""
        block = self.model.block(role)
        if block is None or block.n_parameters == 0:
            return None
        x = np.ascontiguousarray(x, dtype=float)
        return block.propagate(self.model.part(self.theta, block), x, np.empty((len(x), 0)), 0)

    def summary(self) -> dict[str, Any]:
        """What the fit says, ready for JSON: values that are not finite become None."""
        poles = [
            {"re": z.real, "im": z.imag, "std": s}
            for z, s in zip(self.poles.tolist(), self.pole_std.tolist(), strict=True)
        ]
        return plain(
            {
                "structure": self.model.structure,
                "search": self.search,
                "criteria": self.criteria.as_dict(),
                "poles": poles,
                "zeros": [{"re": z.real, "im": z.imag} for z in self.zeros.tolist()],
                "parameters": [vars(p) for p in self.parameters],
                "stop": vars(self.stop),
                "starts": {"losses": list(self.losses)},
                "warnings": list(self.warnings),
                "seconds": self.seconds,
            }
        )

    @property
    def _linear(self) -> np.ndarray:
        return self.model.part(self.theta, self.model.linear)

    def _scored(self, data: IOData, n_init: int | None) -> int:
        n = self.n_init if n_init is None else n_init
        if n + 2 > data.N:
            raise InputError(
                f"the record has {data.N} samples and {n} of them give the initial state; give a longer one"
            )
        return n

    def _same_rate(self, data: IOData) -> None:
        if abs(data.Ts - self.Ts) > 1e-6 * self.Ts:
            raise InputError(
                f"the record is sampled every {data.Ts} s and the model every {self.Ts} s; resample it first"
            )


def fit(
    model: Chain,
    data: IOData,
    search: str = "auto",
    starts: int = 5,
    seed: int = 0,
    options: Options | None = None,
    start: np.ndarray | None = None,
    progress: Callable[[str], None] | None = None,
) -> Fit:
    """Fit a chain to a record by least squares on its free-run output.

    search: a name of `sysid.searches.TABLE`; starts: how many starting points, the first from a linear model, the
    others varied with `seed`; start (P,): a starting point of your own. Equal seeds give equal numbers whatever the
    number of threads. Raises InputError for a record that is too short or whose input or output is constant.
    """
    began = time.perf_counter()
    u, y = siso(data)
    method, options = make_search(search), options or Options()
    _check(model, u, y)
    if starts < 1:
        raise InputError(f"starts is {starts}; give at least 1")
    with one_blas_thread():
        points = [np.asarray(start, dtype=float)] if start is not None else make_starts(model, u, y, starts, seed)
        outcomes = _search_all(model, points, u, y, search, options, progress)
        costs = [o.cost for o in outcomes]
        best = int(np.argmin(costs))
        if not np.isfinite(costs[best]):
            raise InputError(
                f"none of {len(points)} start(s) gives a usable model: {outcomes[best].stop.reason}; "
                "detrend the data or lower the orders"
            )
        problem = ChainProblem.whole(model, points[best], u, y)
        theta, cov = problem.thetas(outcomes[best].p)[0], problem.covariance(outcomes[best].p)
    return Fit(
        model=model,
        theta=theta,
        Ts=data.Ts,
        criteria=criteria(costs[best] / len(y), len(y), model.count(theta)),
        covariance=cov,
        stop=outcomes[best].stop,
        history=outcomes[best].history,
        warnings=_warnings(model, theta, cov, outcomes[best].stop),
        losses=tuple(c / len(y) for c in costs),
        seconds=time.perf_counter() - began,
        search=method.name,
        n_init=min(max(50, 4 * model.linear.n_state), len(y) // 4),
        u_span=(float(u.min()), float(u.max())),
    )


def plain(value: Any) -> Any:
    """The same without NumPy types and without numbers that JSON does not know: these become None."""
    if isinstance(value, dict):
        return {k: plain(v) for k, v in value.items()}
    if isinstance(value, (list, tuple)):
        return [plain(v) for v in value]
    if isinstance(value, np.ndarray):
        return plain(value.tolist())
    if isinstance(value, (bool, np.bool_)):
        return bool(value)
    if isinstance(value, (float, np.floating)):
        return float(value) if np.isfinite(value) else None
    return int(value) if isinstance(value, np.integer) else value


def _search_all(
    model: Chain,
    points: list[np.ndarray],
    u: np.ndarray,
    y: np.ndarray,
    search: str,
    options: Options,
    progress: Callable[[str], None] | None,
) -> list[Outcome]:
    problems = [ChainProblem.whole(model, theta, u, y) for theta in points]

    def run(job: tuple[ChainProblem, np.ndarray, Options]) -> Outcome:
        problem, p, limits = job
        outcome = iterate(problem, p, make_search(search), limits)
        if progress is not None:
            progress(f"{model.structure}: loss {outcome.cost / len(y):.4g} after {outcome.stop.iterations} iterations")
        return outcome

    if len(points) == 1:
        return [run((problems[0], problems[0].start, options))]
    # Threads, not processes: the loops over samples release the interpreter's lock and nothing is copied.
    with ThreadPoolExecutor(min(len(points), available())) as pool:
        trial = replace(options, max_iterations=min(_TRIAL, options.max_iterations))
        outcomes = list(pool.map(run, [(problem, problem.start, trial) for problem in problems]))
        leaders = [int(k) for k in np.argsort([o.cost for o in outcomes], kind="stable")[:_LEADERS]]
        ends = pool.map(run, [(problems[k], outcomes[k].p, options) for k in leaders])
        for k, end in zip(leaders, ends, strict=True):
            outcomes[k] = _joined(outcomes[k], end)
    return outcomes


# Every start gets a few iterations, then only the leaders go on: a start that is far behind by then seldom wins.
_TRIAL, _LEADERS = 15, 2


def _joined(first: Outcome, then: Outcome) -> Outcome:
    iterations = first.stop.iterations + then.stop.iterations
    stop = replace(then.stop, iterations=iterations, evaluations=first.stop.evaluations + then.stop.evaluations)
    rows = tuple({**row, "iteration": row["iteration"] + first.stop.iterations} for row in then.history)
    return Outcome(then.p, then.cost, stop, first.history + rows)


def _check(model: Chain, u: np.ndarray, y: np.ndarray) -> None:
    for name, signal in (("input", u), ("output", y)):
        if np.ptp(signal) == 0.0:
            raise InputError(
                f"the {name} is constant ({signal[0]:g}) over all {len(signal)} samples; record one that moves"
            )
    needed = int(model.free.sum()) + 1
    if len(y) < needed:
        raise InputError(
            f"{len(y)} samples are too few for {needed - 1} free parameters ({model.structure}); "
            f"give at least {needed} samples or lower the orders"
        )


def _warnings(model: Chain, theta: np.ndarray, cov: Covariance, stop: Stop) -> tuple[str, ...]:
    found = []
    if not stop.converged:
        found.append(f"the search did not converge: {stop.reason}")
    lost = [n for n, bad in zip(model.names, cov.unidentifiable, strict=True) if bad]
    if lost:
        shown = ", ".join(lost[:6]) + (f" and {len(lost) - 6} more" if len(lost) > 6 else "")
        found.append(f"the data do not determine {shown}; excite more levels or choose a smaller map")
    poles = model.linear.poles(model.part(theta, model.linear))
    if len(poles) and np.max(np.abs(poles)) >= 1.0 - 1e-9:
        found.append("a pole lies on the unit circle: the model integrates, or the data drift")
    return tuple(found)
