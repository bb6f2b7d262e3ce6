"""Starts of a motor with a free friction profile from the record: the voltage balance over short windows."""

from itertools import product

import numpy as np
from scipy.optimize import lsq_linear

from sysid.blocks import ProfiledMotor
from sysid.data.record import IOData
from sysid.estimation.starts._start import Start, generators
from sysid.model.chain import Chain

_WINDOWS = (400, 250, 100, 40)  # windows a record: few where the output is noisy, many where it is clean
_DELAYS = (0, 1, 2, 3, 5, 8)  # whole samples
_STATE = 20  # samples that give position and speed at the beginning
_CALM = 0.1  # a profile's bend by its own level weighs as much as this share of an error that large in one window


class Profile(Start):
    """One motor with a friction profile and no other block."""

    blocks = (ProfiledMotor,)

    def suits(self, chain: Chain) -> bool:
        return len(chain.blocks) == 1

    def starts(self, chain: Chain, data: IOData, count: int, seed: int) -> list[np.ndarray]:
        first, block = _from_balance(chain, data), chain.blocks[0]
        return [first, *(block.vary(first, rng) for rng in generators(count, seed))]


def _from_balance(chain: Chain, data: IOData) -> np.ndarray:
    """theta (P,) of a chain of one `ProfiledMotor`, for the first experiment of the record.

    The voltage balance over a window of W samples is inertia (v_end - v_begin) / W + drag mean v + sign(v) mean
    friction = mean u, linear in all parameters but the delay. Several W, and of a delayed motor several whole delays,
    are tried; the best free run over all experiments is used.
    """
    block = chain.blocks[0]
    assert isinstance(block, ProfiledMotor)
    best, least = block.start(data.u[:, 0]), np.inf
    N = max(data.lengths)
    for delay, W in product(_DELAYS if block.delayed else (0,), sorted({max(4, N // count) for count in _WINDOWS})):
        theta, cost = _balance(block, data, W, delay), 0.0
        for e in reversed(data.experiments):  # the first experiment's state stays
            theta[-2:] = first_state(e.y[:, 0])
            cost += float(np.sum((e.y[:, 0] - chain.simulate(theta, e.u[:, 0])) ** 2))
        if cost < least:
            best, least = theta, cost
    return best


def first_state(y: np.ndarray, n: int = _STATE) -> tuple[float, float]:
    """Position and speed [1/sample] at the first sample, from a parabola through the first n outputs y (N,)."""
    n = min(n, len(y))
    if n < 3:
        return float(y[0]), 0.0
    c = np.polyfit(np.arange(n), y[:n], 2)
    return float(c[2]), float(c[1])


def _balance(block: ProfiledMotor, data: IOData, W: int, delay: int) -> np.ndarray:
    """theta (P,) from windows of W samples of all experiments, with the output `delay` samples late."""
    rows, sides = [], []
    for e in data.experiments:
        if 4 * W + delay <= e.N:
            A, b = _windows(block, e.u[: e.N - delay, 0], e.y[delay:, 0], W)
            rows.append(A)
            sides.append(b)
    A, b = np.concatenate(rows), np.concatenate(sides)
    D = np.vstack(block.bends(A.shape[1]))
    A, b = np.concatenate([A, _CALM * D]), np.concatenate([b, np.zeros(len(D))])
    scale = np.maximum(np.linalg.norm(A, axis=0), 1e-12)
    free = np.full(A.shape[1], -np.inf)
    plain = np.linalg.lstsq(A / scale, b, rcond=1e-9)[0]
    free[:3] = 1e-3 * np.maximum(np.abs(plain[:3]), 1e-3 * np.abs(plain).max())
    with np.errstate(over="ignore", invalid="ignore"):  # its steps towards bounds that are far away
        values = lsq_linear(A / scale, b, (free, np.inf)).x / scale
    return block.repair(np.concatenate([values, [float(delay)] if block.delayed else [], [0.0, 0.0]]))


def _windows(block: ProfiledMotor, u: np.ndarray, y: np.ndarray, W: int) -> tuple[np.ndarray, np.ndarray]:
    """Rows of the balance (windows, 3 + 2 knots) and mean volts (windows,)."""
    half = max(2, W // 6)
    k = np.arange(-half, half + 1)
    v = np.convolve(y, k[::-1] / np.sum(k**2), "same")
    ends = np.arange(half, len(y) - half, W)
    rising, falling = (v > 0).astype(float), (v < 0).astype(float)
    s = (y - block.ends[0]) * block.density
    if block.periodic:
        s = np.abs((s[:, None] - np.arange(block.knots) + 0.5 * block.knots) % block.knots - 0.5 * block.knots).T
    else:
        s = np.abs(np.clip(s, 0.0, block.knots - 1.0) - np.arange(block.knots)[:, None])
    hats = np.maximum(1.0 - s, 0.0)
    columns = [v * rising, v * falling, *(hat * rising for hat in hats), *(-hat * falling for hat in hats)]

    def means(x: np.ndarray) -> np.ndarray:
        total = np.concatenate([[0.0], np.cumsum(x)])
        return np.diff(total[ends]) / W

    return np.column_stack([np.diff(v[ends]) / W, *map(means, columns)]), means(u)
