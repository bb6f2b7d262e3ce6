"""First-order plants: in continuous time, with the exact output at any time for inputs that change at any time; and a
sampled one.
"""

import numpy as np

GAIN, TAU = 2.0, 0.1  # [rad/V], [s]


def steps(seed: int, dwell: float, seconds: float) -> tuple[np.ndarray, np.ndarray]:
    """Times (m,) [s] and levels (m,) [V] of a drawn staircase."""
    rng = np.random.default_rng(seed)
    t = np.arange(0.0, seconds - 0.5 * dwell, dwell)
    return t, np.round(rng.uniform(-6.0, 6.0, len(t)), 2)


def response(t: np.ndarray, changes: np.ndarray, levels: np.ndarray) -> np.ndarray:
    """The output (n,) at times t (n,) of GAIN / (TAU s + 1) from rest, for levels (m,) that begin at `changes` (m,)."""
    start, y = np.zeros(len(changes) + 1), 0.0
    for k in range(len(changes) - 1):
        final = GAIN * levels[k]
        y = final + (y - final) * np.exp(-(changes[k + 1] - changes[k]) / TAU)
        start[k + 1] = y
    k = np.searchsorted(changes, t, side="right") - 1
    final = np.where(k >= 0, GAIN * levels[np.maximum(k, 0)], 0.0)
    begin = np.where(k >= 0, changes[np.maximum(k, 0)], t)
    return final + (np.where(k >= 0, start[np.maximum(k, 0)], 0.0) - final) * np.exp(-(t - begin) / TAU)


def level_at(t: np.ndarray, changes: np.ndarray, levels: np.ndarray) -> np.ndarray:
    """The level (n,) at times t (n,)."""
    return levels[np.maximum(np.searchsorted(changes, t + 1e-9, side="right") - 1, 0)]


def pole_and_gain(u: np.ndarray, y: np.ndarray, direct: bool = True) -> tuple[float, float]:
    """Pole and static gain of y(k) = a y(k - 1) + b1 u(k - 1), and b0 u(k) where it is `direct`, by least squares."""
    columns = [y[:-1], u[:-1], u[1:]] if direct else [y[:-1], u[:-1]]
    a, *b = np.linalg.lstsq(np.column_stack(columns), y[1:], rcond=None)[0]
    return float(a), float(sum(b) / (1 - a))


def first_order(N: int, seed: int, a: float = 0.7) -> tuple[np.ndarray, np.ndarray]:
    """Levels (N,) held for 10 samples each, and the output (N,) of a lag of gain 1 with its pole at `a`, from rest."""
    u = np.repeat(np.random.default_rng(seed).uniform(-1, 1, N // 10), 10)
    y = np.zeros(N)
    for k in range(1, N):
        y[k] = a * y[k - 1] + (1 - a) * u[k - 1]
    return u, y
