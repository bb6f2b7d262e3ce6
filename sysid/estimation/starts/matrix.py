"""Starts of a matrix of filters with maps of every channel before and after it."""

import numpy as np

from sysid.base.errors import InputError
from sysid.block.block import Block, StaticBlock
from sysid.blocks import TransferMatrix
from sysid.data.record import IOData
from sysid.estimation.starts._start import Start, delay, generators, longest, output_error_start, start_maps
from sysid.model.chain import Chain


class Matrix(Start):
    """Several channels: finite impulse responses from all inputs at once, then one linear start for each entry."""

    blocks = (TransferMatrix,)

    def suits(self, chain: Chain) -> bool:
        return len(chain.blocks) <= 4

    def starts(self, chain: Chain, data: IOData, count: int, seed: int) -> list[np.ndarray]:
        record, draws = longest(data), generators(count, seed)
        matrix = next(b for b in chain.blocks if isinstance(b, TransferMatrix))
        k = chain.blocks.index(matrix)
        theta = np.zeros(len(chain.names))
        W = _start_channels(chain, theta, chain.blocks[:k], record.u - record.u.mean(axis=0), record.u)
        W = W - W.mean(axis=0)
        parts = iter(matrix.parts())
        start = chain.index(matrix).start
        for j, row in enumerate(matrix.entries):
            shares = _shares(W, record.y[:, j] - record.y[:, j].mean())
            for i, entry in enumerate(row):
                part, _ = next(parts)
                theta[start + part.start : start + part.stop] = output_error_start(entry, W[:, i], shares[i])
        x = Chain(chain.blocks[: k + 1]).outputs(theta[: chain.index(matrix).stop], record.u)
        _start_channels(chain, theta, chain.blocks[k + 1 :], x + (record.y - x).mean(axis=0), x)
        points = [theta]
        for rng in draws:
            fresh = theta.copy()
            for b in chain.blocks[:k] + chain.blocks[k + 1 :]:
                fresh[chain.index(b)] = b.vary(theta[chain.index(b)], rng)
            points.append(fresh)
        return points


def _shares(W: np.ndarray, y: np.ndarray) -> list[np.ndarray]:
    """Contribution of each input (columns of W (N, nu)) to y (N,), by one least-squares fit of finite responses."""
    N, nu = W.shape
    length = max(2, min(80, N // (4 * nu)))
    columns = [delay(W[:, i], k) for i in range(nu) for k in range(length)]
    regressors = np.column_stack(columns)
    response = np.linalg.lstsq(regressors, y, rcond=1e-10)[0]
    return [regressors[:, i * length : (i + 1) * length] @ response[i * length : (i + 1) * length] for i in range(nu)]


def _start_channels(
    chain: Chain, theta: np.ndarray, blocks: tuple[Block, ...], target: np.ndarray, x: np.ndarray
) -> np.ndarray:
    """Start the maps of all channels from x to target (N, n), write them into theta and return their output."""
    for b in blocks:
        if not all(isinstance(part, StaticBlock) for _, part in b.parts()):
            raise InputError(f"block {b.role!r} has no automatic start in this place; give fit() a start")
        part = chain.index(b)
        columns = []
        for i, (place, m) in enumerate(b.parts()):
            assert isinstance(m, StaticBlock)
            local = Chain((m,))
            piece = np.zeros(m.n_parameters)
            columns.append(start_maps(local, piece, (m,), np.ascontiguousarray(x[:, i]), target[:, i]))
            theta[part.start + place.start : part.start + place.stop] = piece
        x = np.column_stack(columns)
    return x
