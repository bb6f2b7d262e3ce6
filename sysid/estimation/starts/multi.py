"""Starts of chains with several channels or with two transfer functions."""

import itertools

import numpy as np

from sysid.base.errors import InputError
from sysid.block.block import Block, StaticBlock
from sysid.blocks import Channels, TransferFunction, TransferMatrix
from sysid.data.record import IOData
from sysid.estimation.starts.linear import output_error_start, solve_linear
from sysid.estimation.starts.static_maps import start_maps
from sysid.model.chain import Chain


def multi_starts(chain: Chain, data: IOData, draws: list[np.random.Generator]) -> list[np.ndarray]:
    """The first start and one variation for each generator."""
    if chain.channels == (1, 1) and len(chain.dynamics) == 2:
        return _two_filters(chain, data.u[:, 0], data.y[:, 0], draws)
    if any(isinstance(b, TransferMatrix) for b in chain.blocks) and len(chain.blocks) <= 3:
        return _matrix(chain, data, draws)
    raise InputError("this chain has no automatic start; give fit() a start of one value for each parameter")


def _two_filters(chain: Chain, u: np.ndarray, y: np.ndarray, draws: list[np.random.Generator]) -> list[np.ndarray]:
    """Wiener-Hammerstein: one linear model of all orders, its poles dealt to both filters in every possible way.

    Starts differ in who gets which poles (Sjoberg and Schoukens 2012, Automatica 48); after all deals come variations
    of the map between.
    """
    (_, first), (_, second) = chain.dynamics
    whole = TransferFunction(first.nb + second.nb - 1, first.nf + second.nf, first.nk + second.nk)
    poles = whole.poles(output_error_start(whole, u - u.mean(), y - y.mean()))
    deals = _deals(poles, first.nf)
    found = []
    for k in range(len(draws) + 1):
        mine = deals[k % len(deals)]
        rng = draws[k - 1] if k >= len(deals) else None
        found.append(_dealt(chain, poles, mine, u, y, rng))
    return found


def _deals(poles: np.ndarray, n: int) -> list[tuple[int, ...]]:
    """Ways to pick n of the poles with complex pairs kept together; any n where there is none."""
    whole = []
    for mine in itertools.combinations(range(len(poles)), n):
        picked = poles[list(mine)]
        if abs(np.poly(picked).imag).max() < 1e-9:
            whole.append(mine)
    return whole or [tuple(range(n))]


def _dealt(
    chain: Chain,
    poles: np.ndarray,
    mine: tuple[int, ...],
    u: np.ndarray,
    y: np.ndarray,
    rng: np.random.Generator | None,
) -> np.ndarray:
    (at_first, first), (at_second, second) = chain.dynamics
    theta = np.zeros(len(chain.names))
    others = [i for i in range(len(poles)) if i not in mine]
    part = np.zeros(first.n_parameters)
    F = np.real(np.poly(poles[list(mine)]))
    part[first.nb : first.nb + first.nf] = F[1:]
    part[0] = F.sum() if abs(F.sum()) > 1e-9 else 1.0  # gain 1, so that the map between sees the scale of u
    theta[at_first] = part
    x = first.output(part, u)
    between = chain.blocks[chain.blocks.index(first) + 1 : chain.blocks.index(second)]
    x = start_maps(chain, theta, between, x, x - x.mean())
    if rng is not None:
        for b in between:
            theta[chain.index(b)] = b.vary(theta[chain.index(b)], rng)
    part = np.zeros(second.n_parameters)
    part[second.nb : second.nb + second.nf] = np.real(np.poly(poles[others]))[1:]
    solve_linear(second, part, x, y)
    theta[at_second] = part
    return theta


def _matrix(chain: Chain, data: IOData, draws: list[np.random.Generator]) -> list[np.ndarray]:
    """Several channels: finite impulse responses from all inputs at once, then one linear start for each entry."""
    matrix = next(b for b in chain.blocks if isinstance(b, TransferMatrix))
    k = chain.blocks.index(matrix)
    theta = np.zeros(len(chain.names))
    W = _lay(chain, theta, chain.blocks[:k], data.u - data.u.mean(axis=0), data.u)
    W = W - W.mean(axis=0)
    parts = iter(matrix.parts())
    start = chain.index(matrix).start
    for j, row in enumerate(matrix.entries):
        shares = _shares(W, data.y[:, j] - data.y[:, j].mean())
        for i, entry in enumerate(row):
            part, _ = next(parts)
            theta[start + part.start : start + part.stop] = output_error_start(entry, W[:, i], shares[i])
    x = Chain(chain.blocks[: k + 1]).outputs(theta[: chain.index(matrix).stop], data.u)
    _lay(chain, theta, chain.blocks[k + 1 :], x + (data.y - x).mean(axis=0), x)
    found = [theta]
    for rng in draws:
        fresh = theta.copy()
        for b in chain.blocks[:k] + chain.blocks[k + 1 :]:
            fresh[chain.index(b)] = b.vary(theta[chain.index(b)], rng)
        found.append(fresh)
    return found


def _shares(W: np.ndarray, y: np.ndarray) -> list[np.ndarray]:
    """What each input (columns of W (N, nu)) contributes to y (N,), by one least-squares fit of finite responses."""
    N, nu = W.shape
    length = max(2, min(80, N // (4 * nu)))
    lagged = [np.concatenate([np.zeros(k), W[: N - k, i]]) for i in range(nu) for k in range(length)]
    regressors = np.column_stack(lagged)
    response = np.linalg.lstsq(regressors, y, rcond=1e-10)[0]
    return [regressors[:, i * length : (i + 1) * length] @ response[i * length : (i + 1) * length] for i in range(nu)]


def _lay(chain: Chain, theta: np.ndarray, blocks: tuple[Block, ...], target: np.ndarray, x: np.ndarray) -> np.ndarray:
    """Lay the maps of every channel from x towards target (N, n), write them into theta and return their output."""
    for b in blocks:
        if not isinstance(b, Channels):
            raise InputError(f"block {b.role!r} has no automatic start in this place; give fit() a start")
        part = chain.index(b)
        columns = []
        for i, (own, m) in enumerate(b.parts()):
            assert isinstance(m, StaticBlock)
            local = Chain((m,))
            piece = np.zeros(m.n_parameters)
            columns.append(start_maps(local, piece, (m,), np.ascontiguousarray(x[:, i]), target[:, i]))
            theta[part.start + own.start : part.start + own.stop] = piece
        x = np.column_stack(columns)
    return x
