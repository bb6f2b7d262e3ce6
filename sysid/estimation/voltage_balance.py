"""A motor's parameters from the balance of voltages over short windows of a record, linear in all but the delay."""

import numpy as np
from scipy.optimize import lsq_linear

from sysid.blocks import Motor

_WINDOWS = (400, 150, 50)  # windows a record: few where the output is noisy, many where it is clean
_DELAYS = (0, 1, 2, 4)  # whole samples
_NEAR = 0.02  # of the range: beside an end a stop may hold the motor


def balances(motor: Motor, u: np.ndarray, y: np.ndarray, ends: tuple[float, float]) -> list[dict[str, float]]:
    """The motor's parameters by name, once for each window and delay tried; u (N,) [V], and y (N,), its position.

    Over a window the mean of u is lag / gain times the mean acceleration + 1 / gain times the mean speed + rise or fall
    by the direction + the mean of the load. Windows beside an end of the record's range are left out where the motor
    has a stop there.
    """
    found = []
    for late in _DELAYS if motor.delayed else (0,):
        for W in sorted({max(4, len(y) // count) for count in _WINDOWS}):
            one = _balance(motor, u[: len(u) - late], y[late:], W, ends)
            if one is not None:
                found.append(one | {"delay": float(late), "x0": float(y[0])})
    return found


def _balance(motor: Motor, u: np.ndarray, y: np.ndarray, W: int, ends: tuple[float, float]) -> dict[str, float] | None:
    half = max(2, W // 6)
    k = np.arange(-half, half + 1)
    if len(y) < 8 * W or len(y) < 4 * half:
        return None
    smooth = np.convolve(y, np.ones(len(k)) / len(k), "same")
    v = np.convolve(y, k[::-1] / np.sum(k**2), "same")
    up, down = (v > 0.0).astype(float), (v < 0.0).astype(float)
    loads = _loads(motor, smooth)
    edges = np.arange(half, len(y) - half, W)

    def means(x: np.ndarray) -> np.ndarray:
        total = np.concatenate([[0.0], np.cumsum(x)])
        return np.diff(total[edges]) / W

    A = np.column_stack([np.diff(v[edges]) / W, *map(means, (v, up, -down, *loads.values()))])
    b, inner = means(u), np.ones(len(edges) - 1, dtype=bool)
    margin = _NEAR * (ends[1] - ends[0])
    if "lower" in motor.ends:
        inner &= means((y < ends[0] + margin).astype(float)) == 0.0
    if "upper" in motor.ends:
        inner &= means((y > ends[1] - margin).astype(float)) == 0.0
    if inner.sum() < 2 * A.shape[1]:
        return None
    A, b = A[inner], b[inner]
    scale = np.maximum(np.linalg.norm(A, axis=0), 1e-12)
    least = np.full(A.shape[1], -np.inf)
    least[:4] = 0.0
    inertia, drag, rise, fall, *rest = lsq_linear(A / scale, b, (least, np.inf)).x / scale
    if drag <= 0.0:
        return None
    return {
        "gain": 1.0 / drag,
        "lag": inertia / drag,
        "rise": rise,
        "fall": fall,
        **dict(zip(loads, rest, strict=True)),
    }


def _loads(motor: Motor, y: np.ndarray) -> dict[str, np.ndarray]:
    """The load over the position, by its coefficients; a constant load is a difference between the frictions."""
    found = {f"load{i}": (y - motor.at) ** i for i in range(1, motor.load)}
    waves = {"s": np.sin, "c": np.cos}
    return found | {name: waves[name[0]](int(name[-1]) * motor.turn * y) for name in motor.waves}
