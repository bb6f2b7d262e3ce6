"""Starts of a wavelet network, and the searches from them.

Scaling from the data, a library of units, orthogonal least squares: Zhang 1997, Using wavelet network in nonparametric
estimation, IEEE Trans. Neural Networks 8(2): units of a dyadic grid that cover data are the candidates, orthogonal
least squares (Chen, Cowan and Grant 1991) selects them one by one, and generalised cross-validation gives their number.
"""

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
from sysid.solver.iterate import Options, Outcome, iterate
from sysid.solver.searches import search as make_search

_LEVELS = 4  # dyadic levels of the library, from one cell over all data
_PER_LEVEL = 150  # the fullest cells of a level
_ROWS = 4000  # rows that the selection uses
_FLAT = 1e-6  # a principal axis with less than this share of the widest one's spread holds no information
_STRETCH = 0.1  # axes narrower than this share of the widest keep their proportion to it
_TRIAL, _LEADERS = 15, 2  # iterations that every start gets, and number of starts that then continue to the end
_MANY = 10000  # samples that these first iterations use


def empty_network(model: Nlarx, Phi: np.ndarray) -> Network:
    """The network without units, with scaling from the regressors Phi (N, n)."""
    mu, spread = Phi.mean(axis=0), Phi.std(axis=0)
    names = model.regressors if model.nonlinear is None else model.nonlinear
    take = [
        i for i, name in enumerate(model.regressors) if name in names and spread[i] > 1e-12 * np.abs(Phi[:, i]).max()
    ]
    T = np.zeros((len(take), Phi.shape[1]))
    if take:
        T[np.arange(len(take)), take] = 1.0 / spread[take]
        _, s, Vt = np.linalg.svd((Phi - mu) @ T.T / np.sqrt(len(Phi)), full_matrices=False)
        keep = s > _FLAT * s[0]
        # Full whitening would amplify the noise of the narrowest axes to the level of the signal.
        T = (Vt[keep] / np.maximum(s[keep], _STRETCH * s[0])[:, None]) @ T
    return Network(model, mu, np.ascontiguousarray(T))


def dyadic_library(X: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Dilations b (M,) and centres c (M, m): the cells of a dyadic grid that hold data X (N, m), level by level."""
    lo, span = X.min(axis=0), np.ptp(X, axis=0)
    span = np.where(span > 0, span, 1.0)
    width = float(span.mean())
    b, c = [], []
    for level in range(_LEVELS):
        cells = np.minimum(((X - lo) / span * 2**level).astype(int), 2**level - 1)
        occupied, count = np.unique(cells, axis=0, return_counts=True)
        occupied = occupied[np.argsort(-count, kind="stable")[:_PER_LEVEL]]
        c.append(lo + (occupied + 0.5) / 2**level * span)
        b.append(np.full(len(occupied), 2.0**level * 2.0 / width))
    return np.concatenate(b), np.concatenate(c)


def random_library(X: np.ndarray, rng: np.random.Generator, count: int = 300) -> tuple[np.ndarray, np.ndarray]:
    """Another library: centres among the data X (N, m), dilations over the same range as `dyadic_library`."""
    c = X[rng.integers(0, len(X), count)] + 0.1 * rng.normal(size=(count, X.shape[1]))
    width = float(np.mean(np.where(np.ptp(X, axis=0) > 0, np.ptp(X, axis=0), 1.0)))
    return 2.0 / width * np.exp(rng.uniform(np.log(0.5), np.log(2.0 ** (_LEVELS - 1)), count)), c


def network_start(
    empty: Network, Phi: np.ndarray, y: np.ndarray, rng: np.random.Generator | None = None
) -> tuple[Network, np.ndarray]:
    """The network and theta (P,) for Phi (N, n), y (N,): library, selection, weights by least squares over all rows.

    The library is the dyadic grid, or drawn by `rng`.
    """
    base = np.column_stack([np.ones(len(Phi)), Phi - empty.mu])
    theta = np.linalg.lstsq(base, y, rcond=None)[0]
    limit = min(empty.model.max_units, (len(y) - base.shape[1]) // (2 * (empty.m + 2)))
    if limit <= 0 or not empty.m or float(np.sum((y - base @ theta) ** 2)) <= 1e-20 * float(y @ y):
        return empty, theta
    X = empty.coordinates(Phi)
    b, c = dyadic_library(X) if rng is None else random_library(X, rng)
    rows = np.unique(np.linspace(0, len(y) - 1, _ROWS).astype(int)) if len(y) > _ROWS else np.arange(len(y))
    values = _values(X[rows], b, c)
    columns = _orthogonal(base[rows], values, y[rows], limit, empty.m, empty.model.units == "auto")
    columns = np.concatenate([columns[columns < len(b)], columns[columns >= len(b)]])  # wavelets first
    wavelets = int(np.sum(columns < len(b)))
    network = empty.with_units(wavelets, len(columns) - wavelets)
    b, c = b[columns % len(b)], c[columns % len(b)]
    theta_start = np.zeros(network.size)
    for k, dilation in enumerate(network.dilations):
        theta_start[dilation], theta_start[dilation + 1 : dilation + 1 + network.m] = b[k], c[k]
    return network, weights(network, theta_start, Phi, y)


def weights(network: Network, theta: np.ndarray, Phi: np.ndarray, y: np.ndarray) -> np.ndarray:
    """theta (P,) with all linear parameters (y0, L, s) by least squares, for Phi (N, n), y (N,)."""
    enters = np.concatenate([np.arange(1 + network.n), network.dilations - 1]).astype(int)
    theta_solved = theta.copy()
    _, J = network.predict(theta, Phi, own=True)
    columns = J[:, enters]
    norm = np.linalg.norm(columns, axis=0)
    scale = np.where(norm > 0, norm, 1.0)
    theta_solved[enters] = np.linalg.lstsq(columns / scale, y, rcond=1e-10)[0] / scale
    return theta_solved


def _values(X: np.ndarray, b: np.ndarray, c: np.ndarray) -> np.ndarray:
    """Columns (N, 2 M): each candidate as a wavelet, then each as a scaling function."""
    r2 = np.sum(X**2, axis=1)[:, None] - 2.0 * X @ c.T + np.sum(c**2, axis=1)
    z2 = b**2 * np.maximum(r2, 0.0)
    e = np.exp(-0.5 * z2)
    return np.concatenate([(X.shape[1] - z2) * e, e], axis=1)


def _orthogonal(base: np.ndarray, G: np.ndarray, y: np.ndarray, limit: int, m: int, prune: bool) -> np.ndarray:
    """Columns of G (N, M) that explain y (N,) best beside `base`, greedily; with `prune` as many as GCV allows.

    GCV = N RSS / (N - d)^2 (Craven and Wahba 1979). Each unit counts as its m + 2 parameters plus ln M for the
    selection from M: the best of M columns of pure noise explains about 2 ln M of its variance.
    """
    N = len(y)
    Q = np.linalg.qr(base)[0]
    G, e = G - Q @ (Q.T @ G), y - Q @ (Q.T @ y)
    norm0 = np.sum(G**2, axis=0)
    usable = norm0 > 1e-12 * norm0.max(initial=0.0)
    columns: list[int] = []
    scores, cost = [N * float(e @ e) / (N - base.shape[1]) ** 2], m + 2 + np.log(G.shape[1])
    while len(columns) < limit:
        norm = np.sum(G**2, axis=0)
        usable &= norm > 1e-8 * norm0  # already explained by others
        if not usable.any() or float(e @ e) <= 1e-24 * float(y @ y):
            break
        k = int(np.argmax(np.where(usable, (e @ G) ** 2 / np.where(usable, norm, 1.0), -1.0)))
        q = G[:, k] / np.sqrt(norm[k])
        e = e - q * (q @ e)
        G -= np.outer(q, q @ G)
        usable[k] = False
        columns.append(k)
        freedom = N - base.shape[1] - len(columns) * cost
        scores.append(N * float(e @ e) / freedom**2 if freedom > 0 else np.inf)
    return np.array(columns[: int(np.argmin(scores))] if prune else columns, dtype=int)


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
        short: AnyProblem = prediction.thin(_MANY)
        if model.focus == "simulation":
            problem = SimulationProblem(prediction.network, pieces, model.lag, ridge)
            points += _more_points(prediction, theta, linear, trial)
            short = problem.shorten(_MANY)
        runs += [Run(short, iterate(short, point, make_search(search), trial)) for point in points]
        whole += [problem] * len(points)
    best = [k for k in sorted(range(len(runs)), key=lambda k: runs[k].loss)[:leaders] if np.isfinite(runs[k].loss)]
    for k in best:
        runs[k] = _continue(runs[k], runs[k].problem, search, options)
    if any(runs[k].problem.N < whole[k].N for k in best):
        best = sorted(best, key=lambda k: runs[k].loss)[:1]
        runs[best[0]] = _continue(runs[best[0]], whole[best[0]], search, options)
    for k in best:
        runs[k] = replace(runs[k], ended=True)
    return runs


def _continue(run: Run, problem: AnyProblem, search: str, options: Options) -> Run:
    continuation = iterate(problem, run.outcome.p, make_search(search), options)
    return Run(problem, run.outcome.then(continuation))


def _starts(
    model: Nlarx, pieces: tuple[Piece, ...], starts: int, seed: int, ridge: float
) -> list[tuple[PredictionProblem, np.ndarray]]:
    """Initial networks for the records: the one-step problem and theta (P,) of each."""
    points = []
    Phi, y = rows(model, pieces)
    empty = empty_network(model, Phi)
    for k in range(starts):
        rng = None if k == 0 else np.random.default_rng([seed, k])
        network, theta = network_start(empty, Phi, y, rng)
        points.append((PredictionProblem(network, Phi, y, ridge), theta))
        if not network.units:
            break  # a linear ARX model: least squares has only one optimum
    return points


def _more_points(prediction: PredictionProblem, theta: np.ndarray, linear: Linear, trial: Options) -> list[np.ndarray]:
    """Further starts of a search on the free run besides the initial theta (P,).

    One is refined one step ahead. The other has zero weights and the linear model with the least free-run error, which
    is stable even if the one-step optimum is not.
    """
    network = prediction.network
    points = [iterate(prediction.thin(_MANY), theta, make_search("lm"), trial).p]
    if linear is not None:
        flat = theta.copy()
        flat[network.dilations - 1] = 0.0
        flat[: 1 + network.n] = _recentre(network, linear)
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
    deviations = replace(data, u=data.u - u0, y=data.y - y0)
    try:
        fit = fit_chain(linear, deviations, search="lm", starts=1)
    except InputError:
        return None
    b, f = fit.theta[: model.nb], fit.theta[model.nb : model.nb + model.na]
    return np.concatenate([-f, b]), y0, u0


def _recentre(network: Network, linear: tuple[np.ndarray, float, float]) -> np.ndarray:
    """y0 and L (1 + n,) of the linear model about its own means, for a network about mu."""
    L, y0, u0 = linear
    means = np.concatenate([np.full(network.model.na, y0), np.full(network.model.nb, u0)])
    return np.concatenate([[y0 + float(L @ (network.mu - means))], L])
