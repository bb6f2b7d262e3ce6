"""The fit of a chain to a frequency response: least squares of the complex errors, each by its own deviation."""

import time
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from scipy.special import chdtrc

from sysid.base.criteria import criteria
from sysid.base.errors import InputError
from sysid.base.handlers import Shown
from sysid.blocks.offset import is_offset
from sysid.data.frequency import FrequencyData
from sysid.data.record import IOData
from sysid.estimation.frequency_starts import starts
from sysid.estimation.problem import ChainProblem
from sysid.estimation.result import Fit
from sysid.model.chain import Chain
from sysid.model.frequency import linear_block, response
from sysid.solver.covariance import Covariance
from sysid.solver.iterate import Options, Outcome, iterate
from sysid.solver.linearisation import Linearisation
from sysid.solver.searches import search as make_search

GIVEN, SAME, SHARE = "as given", "the same at all frequencies", "a share of the response"
_CHANCE = 0.01  # below it the errors are larger than the given deviations explain
_ROUNDS = 3  # of the weights, which follow the model's response


@dataclass(frozen=True, repr=False)
class ResponseFit(Shown):
    """A `fit` to frequency response data; std (n,): the deviation that it gave each part of the errors.

    `errors` says what was taken for it. `excess`: the squared errors by what the given deviations explain, where these
    are known; where chance does not explain it, the covariance of `fit` counts the larger errors. Else 1. `fit` takes
    no record, but runs on one of its sampling time, is saved and exported.
    """

    fit: Fit
    data: FrequencyData
    std: np.ndarray
    errors: str = GIVEN
    excess: float = 1.0

    def response(self, w: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The model's response (n,) at w (n,) [rad/s], and its gradient (n, P)."""
        return response(self.fit.model, self.fit.theta, w, self.data.Ts)

    @cached_property
    def misfit(self) -> np.ndarray:
        """Data less model (n,), complex, by `std`."""
        return np.asarray((self.data.response - self.response(self.data.w)[0]) / self.std)

    @property
    def share(self) -> float:
        """The middle size of the error, as a share of the response."""
        size = np.abs(self.data.response)
        return float(np.median(np.abs(self.misfit * self.std)[size > 0.0] / size[size > 0.0]))

    @property
    def random(self) -> bool:
        """Whether neighbouring errors are alike only as chance makes them, at 99 %: their correlation at lag one."""
        e = self.misfit
        alike = float(np.real(np.vdot(e[:-1], e[1:]))) / max(float(np.sum(np.abs(e) ** 2)), 1e-300)
        return alike < 2.33 / np.sqrt(2.0 * len(e))


@dataclass(frozen=True)
class _Problem(ChainProblem):
    """min over p of the squared parts of the errors by `std` (n,); `records` are not used."""

    data: FrequencyData | None = None
    std: np.ndarray = field(default_factory=lambda: np.empty(0))

    @property
    def size(self) -> float:
        assert self.data is not None
        return float(np.sum(np.abs(self.data.response / self.std) ** 2))

    def residual(self, p: np.ndarray) -> np.ndarray | None:
        theta = self.thetas(p)[0]
        return self._parts(theta)[0] if self.chain.admissible(theta) else None

    def linearise(self, p: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        e, J = self._parts(self.thetas(p)[0])
        return e, J @ self.chain.basis[:, self.moving]

    def compact(self, p: np.ndarray) -> Linearisation | None:
        return None

    def _parts(self, theta: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        assert self.data is not None
        value, gradient = response(self.chain, theta, self.data.w, self.data.Ts)
        e, J = (self.data.response - value) / self.std, gradient / self.std[:, None]
        return np.concatenate([e.real, e.imag]), np.concatenate([J.real, J.imag])


def fit_response(
    model: Chain,
    data: FrequencyData,
    search: str = "auto",
    options: Options | None = None,
    start: np.ndarray | Fit | None = None,
) -> ResponseFit:
    """Fit a process, or with a sampling time an output error chain, to a frequency response; see `sysid.fit`.

    Where the data do not say their errors, these are the same at all frequencies or a share of the response, whichever
    is likelier; their size is then that of what is left. Raises InputError for other chains.
    """
    began, block = time.perf_counter(), linear_block(model)
    if block is not model.blocks[0] or len(model.blocks) > 1:  # an offset has no frequency
        model = replace(model, blocks=tuple(b for b in model.blocks if not is_offset(b)))
    model = model.sampled(data.Ts or float(np.pi / data.w[-1]))
    response(model, np.where(model.initial, 0.0, 1.0), data.w[:1], data.Ts)  # says what is missing
    moving = model.free & ~model.initial
    if 2 * len(data.w) <= moving.sum():
        raise InputError(f"{len(data.w)} frequencies are too few for {moving.sum()} parameters; give more of them")
    search, options = make_search(search).name, (options or Options()).begun()

    def best(std: np.ndarray, points: list[np.ndarray]) -> tuple[_Problem, Outcome, list[float]]:
        problems = [_Problem(model, p[None, :], _NO_RECORD, moving, data=data, std=std) for p in points]
        outcomes = [iterate(problem, problem.start, make_search(search), options) for problem in problems]
        costs = [outcome.cost for outcome in outcomes]
        k = int(np.argmin(costs))
        if not np.isfinite(costs[k]):
            raise InputError(f"no start gives a valid model: {outcomes[k].stop.reason}; choose another order or kind")
        return problems[k], outcomes[k], costs

    given = None if start is None else [start.theta if isinstance(start, Fit) else np.asarray(start, dtype=float)]
    candidates = []
    for errors, std in _deviations(data):
        problem, outcome, costs = best(std, given or starts(model, data, std))
        for _ in range(_ROUNDS if errors == SHARE else 0):  # by the model: a small response may be small by chance
            theta = problem.thetas(outcome.p)[0]
            std = np.maximum(np.abs(response(model, theta, data.w, data.Ts)[0]), std * 1e-3)
            problem, outcome, _ = best(std, [theta])
        n = 2 * len(std)
        likelihood = n * np.log(outcome.cost / n) + 4.0 * float(np.sum(np.log(std))) if outcome.cost > 0 else -np.inf
        candidates.append((likelihood, errors, problem, outcome, costs))
    _, errors, problem, outcome, costs = min(candidates, key=lambda each: each[0])
    return _result(model, data, problem, outcome, errors, costs, search, time.perf_counter() - began)


_NO_RECORD = (IOData(np.zeros(2), np.zeros(2)),)


def _deviations(data: FrequencyData) -> list[tuple[str, np.ndarray]]:
    """What the errors may be, and a deviation (n,) of each."""
    if data.std is not None:
        return [(GIVEN, data.std)]
    size = np.abs(data.response)
    same = (SAME, np.full(len(size), float(np.sqrt(np.mean(size**2)))))
    return [same, (SHARE, size)] if np.all(size > 0.0) else [same]


def _slowest_first(model: Chain, theta: np.ndarray) -> np.ndarray:
    """Numbers of the parameters (P,) with the time constants of a process in falling order, where none is held."""
    order = np.arange(len(theta))
    own = [k for k, name in enumerate(model.names) if name.rpartition(".")[2] in ("T1", "T2", "T3")]
    if not any(model.names[k] in (*model.fixed, *model.bounds) for k in own):
        order[own] = np.array(own, dtype=int)[np.argsort(-theta[own])]
    return order


def _result(
    model: Chain,
    data: FrequencyData,
    problem: _Problem,
    outcome: Outcome,
    errors: str,
    costs: list[float],
    search: str,
    seconds: float,
) -> ResponseFit:
    covariance, d = problem.uncertainty(outcome.p)
    known, std = data.std is not None and data.absolute, problem.std
    n, excess, warnings = 2 * len(data.w), 1.0, list[str]()
    if known:
        excess = outcome.cost / max(n - d, 1)
        by_chance = chdtrc(max(n - d, 1), outcome.cost) >= _CHANCE
        factor = 1.0 / covariance.noise_variance if by_chance else 1.0
        covariance = Covariance(covariance.cov * factor, covariance.unidentifiable, 1.0, covariance.at_bound)
        if not by_chance:
            warnings.append(
                f"the errors are {np.sqrt(excess):.3g} times the given deviations, which chance does not explain: the "
                "model lacks something, or the deviations are too small; the intervals count the larger errors"
            )
    if not outcome.stop.converged:
        warnings.append(f"the search did not converge: {outcome.stop.reason}")
    theta = problem.thetas(outcome.p)[0]
    order = _slowest_first(model, theta)
    theta = theta[order]
    cov, lost_at, bounded = covariance.cov[np.ix_(order, order)], covariance.unidentifiable[order], covariance.bounded
    covariance = Covariance(cov, lost_at, covariance.noise_variance, bounded[order])
    lost = [name for name, gone in zip(model.names, covariance.unidentifiable & problem.moving, strict=True) if gone]
    if lost:
        warnings.append(f"the data do not determine {', '.join(lost)}; choose a smaller model or more frequencies")
    parts = std * problem.residual(outcome.p).reshape(2, -1)  # type: ignore[union-attr]
    fit = Fit(
        model=model,
        theta=theta,
        Ts=data.Ts or float(np.pi / data.w[-1]),
        criteria=criteria(outcome.cost / n, n, d, mse=float(np.mean(parts**2))),
        covariance=covariance,
        stop=outcome.stop,
        history=outcome.history,
        warnings=tuple(warnings),
        losses=tuple(cost / n for cost in costs),
        seconds=seconds,
        search=search,
        n_init=0,
        u_offset=np.zeros(1),
        y_offset=np.zeros(1),
    )
    std = std if known else std * np.sqrt(max(covariance.noise_variance, 1e-300))
    return ResponseFit(fit, data, std, errors, excess)
