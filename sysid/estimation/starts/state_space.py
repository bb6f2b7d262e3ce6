"""Starts of a nonlinear state space: the best linear one, with networks that look in drawn directions."""

from dataclasses import replace

import numpy as np

from sysid.block.block import StaticBlock
from sysid.blocks import StateSpace, TransferFunction
from sysid.data.record import IOData
from sysid.estimation.initial_state import with_initial_states
from sysid.estimation.problem import ChainProblem, search_best
from sysid.estimation.starts._start import Start, denominators, generators, solve_linear, start_maps
from sysid.model.chain import Chain
from sysid.solver.iterate import Options, iterate
from sysid.solver.searches import LevenbergMarquardt

# Chosen by hand.
_DRAWN, _SHORT, _TRIAL = 4, 4000, Options(max_iterations=15)
_HELD = (1.0, 0.4, 0.15)  # shares of the correction by the measured output, on the way from prediction to free run
_POLISH = Options(max_iterations=40, tolerance=0.05)
_WIDEST = 20  # block rows of a Hankel matrix


class StateSpaces(Start):
    """A state space, alone or with a static map behind it.

    The weights from features to states begin at zero, so that every start is the linear model; the first step of a
    search then is the least-squares fit of these weights to what the linear model leaves. Of several draws, the best
    after a few steps are the starts. Every second one takes its steps as a predictor first, see `_search_as_predictor`.
    """

    blocks = (StateSpace,)

    def suits(self, chain: Chain) -> bool:
        first, *maps = chain.blocks
        return isinstance(first, StateSpace) and all(isinstance(b, StaticBlock) for b in maps)

    def starts(self, chain: Chain, data: IOData, count: int, seed: int) -> list[np.ndarray]:
        block = chain.blocks[0]
        assert isinstance(block, StateSpace)
        u0, u_scale, y0, y_scale = block.scales()
        on_scale = IOData(
            (data.u - u0) / u_scale, (data.y - y0) / y_scale, data.Ts, missing=data.missing, lengths=data.lengths
        )
        linear, theta_linear = linear_state_space(block.nx, on_scale)
        plain, m = block.split(np.zeros(block.n_parameters)), linear.split(theta_linear)
        first = block.joined(plain._replace(A=m.A, B=m.B, C=m.C, D=m.D, d=m.d, x0=m.x0))
        theta = np.zeros(len(chain.names))
        theta[chain.index(block)] = first
        if chain.blocks[1:]:
            e = data.experiments[0]
            x = Chain((block,)).simulate(first, e.u)
            start_maps(chain, theta, chain.blocks[1:], x, e.y[:, 0])
        if not block.features:
            return [theta]
        points = []
        for k, rng in enumerate([np.random.default_rng([seed, 0]), *generators(_DRAWN * count, seed)]):
            fresh, part = theta.copy(), block.vary(first, rng)
            if k % 2 and len(chain.blocks) == 1 and not block.degree:
                part = _search_as_predictor(block, part, on_scale)
            fresh[chain.index(block)] = part
            points.append(fresh)
        if not block.units:
            return points[:1]
        return _rank_by_search(chain, theta, points, data)[:count]


def _rank_by_search(chain: Chain, linear: np.ndarray, candidates: list[np.ndarray], data: IOData) -> list[np.ndarray]:
    """The drawn starts after a few iterations over the beginning of the record, the best first.

    The network's prior has a weight of a tenth of what the linear model leaves: with all of it most networks stay 0.
    """
    short = data.experiments[0].select(0, min(data.experiments[0].N, _SHORT))
    error = float(np.std(short.y - chain.outputs(linear, short.u)))
    searches = [_steps(chain, theta, short, chain.free, 0.1 * error) for theta in candidates]
    return [theta for _, theta in sorted(searches, key=lambda pair: pair[0])]


def _search_as_predictor(block: StateSpace, theta: np.ndarray, data: IOData) -> np.ndarray:
    """theta (P,) after steps as a predictor, x(t+1) = ... + K (y - C x - ...), whose K then goes to zero in steps.

    Its errors do not add up over time, so that its cost has fewer valleys than that of a free run (Ljung, System
    Identification, section 7.2, and, on the way between both, Ribeiro et al. 2020, Automatica 121). A predictor is a
    state space with the output as a further input; data are on the block's scale.
    """
    short = data.experiments[0].select(0, min(data.experiments[0].N, _SHORT))
    predictor_data = IOData(np.column_stack([short.u, short.y]), short.y, short.Ts, missing=short.missing)
    wide = replace(block, nu=block.nu + block.ny, u_centre=(), u_scale=(), y_centre=(), y_scale=())
    chain, m = Chain((wide,)), block.split(theta)
    moving, K = np.ones(wide.n_parameters, dtype=bool), np.zeros((block.nx, block.ny))
    for name, n in (("D", block.ny), ("V", block.units)):  # the output now is known to the next state alone
        moving[wide.places[name]] = np.tile(np.arange(wide.nu) < block.nu, n)
    for share in _HELD:
        L = share * K
        F = m.F if block.readout else np.zeros((block.ny, block.features))
        start = m._replace(A=m.A - L @ m.C, B=np.column_stack([m.B - L @ m.D, L]), E=m.E - L @ F)
        start = start._replace(
            D=np.column_stack([m.D, np.zeros((block.ny, block.ny))]),
            V=np.column_stack([m.V, np.zeros((block.units, block.ny))]),
        )
        moves = moving.copy()
        if share < _HELD[0]:
            moves[wide.places["B"]] = np.tile(np.arange(wide.nu) < block.nu, block.nx)
        cost, theta_end = _steps(chain, wide.repair(wide.joined(start)), predictor_data, moves, 0.05)
        if not np.isfinite(cost):
            return theta
        w = wide.split(theta_end)
        L = w.B[:, block.nu :]
        K = L if share == _HELD[0] else K
        F = w.F if block.readout else np.zeros((block.ny, block.features))
        D = w.D[:, : block.nu]
        m = w._replace(A=w.A + L @ w.C, B=w.B[:, : block.nu] + L @ D, D=D, E=w.E + L @ F, V=w.V[:, : block.nu])
    return block.repair(block.joined(m))


def _steps(chain: Chain, theta: np.ndarray, data: IOData, moving: np.ndarray, prior: float) -> tuple[float, np.ndarray]:
    """Cost and parameters (P,) after a few iterations from theta (P,); infinite where theta gives no run."""
    weight = prior if np.isfinite(prior) else 0.0
    problem = ChainProblem(chain, theta[None, :], (data,), moving, curvature_weight=weight)
    out = iterate(problem, problem.start, LevenbergMarquardt(), _TRIAL)
    return out.cost, problem.thetas(out.p)[0]


def linear_state_space(nx: int, data: IOData) -> tuple[StateSpace, np.ndarray]:
    """The best linear state space of order nx of a record on the block's scale, and its theta (P,).

    Candidates: subspace estimates over several horizons, and for one input and output the models of refined
    instrumental variables at several rates; each is polished by output error, and the best free run is returned with
    states of covariance 1 over the record.
    """
    block = StateSpace(nx, 0, nu=data.u.shape[1], ny=data.y.shape[1], role="linear")
    chain = Chain((block,))
    thetas = (_complete(block, A, C, data) for A, C in _candidates(nx, data))
    problems = (
        ChainProblem(chain, with_initial_states(chain, theta, data), data.experiments, chain.free)
        for theta in thetas
        if block.admissible(theta)
    )
    best, _ = search_best(problems, _POLISH, block.start(data.u[:, 0]))
    return block, normalise_states(block, best, data)


def normalise_states(block: StateSpace, theta: np.ndarray, data: IOData) -> np.ndarray:
    """theta (P,) of a linear block in coordinates in which the states have covariance 1 over the record."""
    m = block.split(theta)
    states = StateSpace(block.nx, 0, nu=block.nu, ny=block.nx, role="states")
    zero = states.split(np.zeros(states.n_parameters))
    X = Chain((states,)).outputs(states.joined(zero._replace(A=m.A, B=m.B, C=np.eye(block.nx), x0=m.x0)), data.u)
    if not np.all(np.isfinite(X)):
        return theta
    _, s, Vt = np.linalg.svd(X / np.sqrt(len(X)), full_matrices=False)
    s = np.maximum(s, 1e-6 * max(s[0], 1e-300))
    T, inverse = Vt / s[:, None], Vt.T * s
    return block.joined(m._replace(A=T @ m.A @ inverse, B=T @ m.B, C=m.C @ inverse, x0=T @ m.x0))


def subspace(nx: int, data: IOData, rows: int, canonical: bool) -> tuple[np.ndarray, np.ndarray] | None:
    """A (nx, nx) and C (ny, nx) from the past outputs and inputs as instruments; None where the record is too short.

    PO-MOESP (Verhaegen 1994, Automatica 30, section 4); with `canonical` the weighting of canonical variates (Larimore;
    Van Overschee and De Moor 1996, Subspace Identification, section 4.3).
    """
    blocks = [_hankel(np.column_stack([e.u, e.y]), 2 * rows) for e in data.experiments if 2 * rows < e.N]
    if not blocks or sum(len(h) for h in blocks) < 3 * rows * 2 * (data.u.shape[1] + data.y.shape[1]):
        return None
    H, nu, ny = np.concatenate(blocks), data.u.shape[1], data.y.shape[1]
    signals = H.reshape(len(H), 2 * rows, nu + ny)
    past, future = signals[:, :rows], signals[:, rows:]
    parts = [future[:, :, :nu], past, future[:, :, nu:]]
    sizes = np.cumsum([rows * nu, rows * (nu + ny)])
    R = np.asarray(np.linalg.qr(np.column_stack([p.reshape(len(H), -1) for p in parts]), mode="r")).T
    middle, low = R[sizes[1] :, sizes[0] : sizes[1]], R[sizes[1] :, sizes[0] :]
    weight = np.eye(len(low))
    if canonical:
        vectors, s, _ = np.linalg.svd(low, full_matrices=False)
        keep = s > 1e-9 * s[0]
        weight = (vectors[:, keep] / s[keep]) @ vectors[:, keep].T
    U, s, _ = np.linalg.svd(weight @ middle, full_matrices=False)
    if len(s) < nx or not s[nx - 1] > 0.0:
        return None
    observability = (np.linalg.pinv(weight) if canonical else weight) @ (U[:, :nx] * np.sqrt(s[:nx]))
    return np.linalg.lstsq(observability[:-ny], observability[ny:], rcond=None)[0], observability[:ny]


def _candidates(nx: int, data: IOData) -> list[tuple[np.ndarray, np.ndarray]]:
    """A (nx, nx) and C (ny, nx) of every estimate: subspaces over several horizons, and transfer functions."""
    pairs = []
    horizons = sorted({min(nx + 2, _WIDEST), min(2 * nx + 6, _WIDEST), _WIDEST})
    for rows in horizons:
        for canonical in (False, True):
            pair = subspace(nx, data, rows, canonical)
            if pair is not None:
                pairs.append((_stable(pair[0]), pair[1]))
    if data.u.shape[1] == data.y.shape[1] == 1:
        e = max(data.experiments, key=lambda e: e.N)
        u, y = e.u[:, 0] - e.u.mean(), e.y[:, 0] - e.y.mean()
        linear = TransferFunction(nx + 1, nx, 0, role="linear")
        for f in denominators(linear, u, y):
            theta = solve_linear(linear, f, u, y)
            b = theta[: nx + 1]
            if np.all(np.isfinite(theta)):
                A = np.eye(nx, k=-1)
                A[0] = -f
                pairs.append((_stable(A), (b[1:] - b[0] * f)[None, :]))
    return pairs


def _complete(block: StateSpace, A: np.ndarray, C: np.ndarray, data: IOData) -> np.ndarray:
    """theta (P,) with B, D, d and the initial state by least squares over the longest experiment, for given A and C."""
    e = max(data.experiments, key=lambda e: e.N)
    theta = block.joined(block.split(np.zeros(block.n_parameters))._replace(A=A, C=C))
    y, J = Chain((block,)).sensitivities(theta, e.u)
    enters = np.concatenate([np.r_[block.places[k]] for k in ("B", "D", "d", "x0")])
    keep = e.observed.T.ravel()
    target = (e.y - y).T.ravel()
    if np.all(np.isfinite(J[:, enters])):
        theta[enters] = np.linalg.lstsq(J[keep][:, enters], target[keep], rcond=1e-10)[0]
    return theta


def _stable(A: np.ndarray) -> np.ndarray:
    """A with eigenvalues outside the unit circle mirrored into it."""
    values, vectors = np.linalg.eig(A)
    size = np.abs(values)
    if size.max() <= 1.0:
        return A
    mirrored_values = np.where(size > 1.0, values / np.maximum(size, 1e-300) ** 2, values)
    return np.real(vectors @ np.diag(mirrored_values) @ np.linalg.pinv(vectors))


def _hankel(X: np.ndarray, rows: int) -> np.ndarray:
    """Windows of X (N, n) of `rows` samples, one a row (N - rows + 1, rows * n)."""
    windows = np.lib.stride_tricks.sliding_window_view(X, rows, axis=0)
    return np.swapaxes(windows, 1, 2).reshape(len(windows), -1)
