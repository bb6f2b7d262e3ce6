"""The starts of a nonlinear ARX fit and the results of their searches."""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from sysid.base.errors import InputError
from sysid.blocks import TransferFunction
from sysid.data.record import IOData
from sysid.estimation.fit import fit_chain
from sysid.model.chain import Chain
from sysid.nlarx.model import Network, Nlarx
from sysid.nlarx.problem import AnyProblem, Piece, PredictionProblem, SimulationProblem, rows
from sysid.nlarx.start import empty_network, network_start
from sysid.solver.iterate import Options, Outcome, iterate
from sysid.solver.searches import search as make_search

_TRIAL, _LEADERS = 15, 2  # iterations that every start gets, and number of starts that then continue to the end
_MANY = 10000  # samples that these first iterations use


@dataclass(frozen=True)
class Run:
    """One start and the state of its search."""

    problem: AnyProblem
    outcome: Outcome
    ended: bool = False  # False after the first iterations only, on a part of a long record

    @property
    def network(self) -> Network:
        """The network of this start."""
        return self.problem.network

    @cached_property
    def loss(self) -> float:
        """e'e / N of the record alone, without the ridge."""
        e = self.problem.residual(self.outcome.p)
        return np.inf if e is None else float(np.mean(e[: self.problem.N] ** 2))


Linear = tuple[np.ndarray, float, float] | None


def runs_of(
    model: Nlarx,
    data: IOData,
    search: str,
    starts: int,
    seed: int,
    options: Options,
    ridge: float,
    linear: Linear = None,
    leaders: int = _LEADERS,
) -> list[Run]:
    """All starts with the results of their searches: all get a few iterations, then the best continue to the end.

    On a long record they continue on its first part, and only the best of them goes on with the whole. `linear` is a
    start that is known already, see `linear_start`.
    """
    pieces = Piece.of(data)
    linear = linear_start(model, data) if linear is None else linear
    trial = replace(options, max_iterations=min(_TRIAL, options.max_iterations))
    runs, whole = [], []
    for prediction, theta in _starts(model, pieces, starts, seed, ridge):
        points: list[np.ndarray] = [theta]
        problem: AnyProblem = prediction
        short: AnyProblem = prediction.thinned(_MANY)
        if model.focus == "simulation":
            problem = SimulationProblem(prediction.network, pieces, model.lag, ridge)
            points += _more_points(prediction, theta, linear, trial)
            short = problem.shortened(_MANY)
        runs += [Run(short, iterate(short, point, make_search(search), trial)) for point in points]
        whole += [problem] * len(points)
    best = [k for k in sorted(range(len(runs)), key=lambda k: runs[k].loss)[:leaders] if np.isfinite(runs[k].loss)]
    for k in best:
        runs[k] = _continued(runs[k], runs[k].problem, search, options)
    if any(runs[k].problem.N < whole[k].N for k in best):
        best = sorted(best, key=lambda k: runs[k].loss)[:1]
        runs[best[0]] = _continued(runs[best[0]], whole[best[0]], search, options)
    for k in best:
        runs[k] = replace(runs[k], ended=True)
    return runs


def _continued(run: Run, problem: AnyProblem, search: str, options: Options) -> Run:
    then = iterate(problem, run.outcome.p, make_search(search), options)
    return Run(problem, run.outcome.then(then))


def _starts(
    model: Nlarx, pieces: tuple[Piece, ...], starts: int, seed: int, ridge: float
) -> list[tuple[PredictionProblem, np.ndarray]]:
    """Initial networks for the records: the one-step problem and theta (P,) of each."""
    found = []
    Phi, y = rows(model, pieces)
    empty = empty_network(model, Phi)
    for k in range(starts):
        rng = None if k == 0 else np.random.default_rng([seed, k])
        network, theta = network_start(empty, Phi, y, rng)
        found.append((PredictionProblem(network, Phi, y, ridge), theta))
        if not network.units:
            break  # a linear ARX model: least squares has only one optimum
    return found


def _more_points(
    prediction: PredictionProblem,
    theta: np.ndarray,
    linear: Linear,
    trial: Options,
) -> list[np.ndarray]:
    """Further starts of a search on the free run besides the initial theta (P,).

    One is refined one step ahead. The other has zero weights and the linear model with the least free-run error, which
    is stable even if the one-step optimum is not.
    """
    network = prediction.network
    points = [iterate(prediction.thinned(_MANY), theta, make_search("lm"), trial).p]
    if linear is not None:
        flat = theta.copy()
        flat[network.dilations - 1] = 0.0
        flat[: 1 + network.n] = _centred(network, linear)
        points.append(flat)
    return points


def linear_start(model: Nlarx, data: IOData) -> Linear:
    """L (n,) of the output-error model with these orders, and the means of y and u that it refers to.

    None where the focus is on the prediction, or without inputs.
    """
    if not model.nb or model.focus != "simulation":
        return None
    u0, y0 = float(data.u.mean()), float(data.y.mean())
    linear = Chain((TransferFunction(model.nb, model.na, model.nk, role="linear"),), structure="output_error")
    centred = replace(data, u=data.u - u0, y=data.y - y0)
    try:
        found = fit_chain(linear, centred, search="lm", starts=1)
    except InputError:
        return None
    b, f = found.theta[: model.nb], found.theta[model.nb : model.nb + model.na]
    return np.concatenate([-f, b]), y0, u0


def _centred(network: Network, linear: tuple[np.ndarray, float, float]) -> np.ndarray:
    """y0 and L (1 + n,) of the linear model about its own means, for a network about mu."""
    L, y0, u0 = linear
    about = np.concatenate([np.full(network.model.na, y0), np.full(network.model.nb, u0)])
    return np.concatenate([[y0 + float(L @ (network.mu - about))], L])
