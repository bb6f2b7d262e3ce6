"""Poles: match an estimate with the truth, the error in the s-plane, and unstable ones mirrored inside."""

from dataclasses import dataclass

import numpy as np
from scipy.optimize import linear_sum_assignment


@dataclass(frozen=True)
class PoleMatch:
    """One estimated pole in z, the true one it belongs to, and |s_est - s_true| / |s_true| (s = ln z / Ts).

    The error of a true integrator (s = 0) is relative to the slowest other true pole, or to 1/s if there is none; it is
    infinite for an estimate at z = 0 whose true pole is elsewhere.
    """

    estimated: complex
    true: complex
    s_error: float


def to_s(z: np.ndarray, Ts: float) -> np.ndarray:
    """s = ln(z) / Ts for poles z (n,); -inf for z = 0."""
    z = np.asarray(z, dtype=complex)
    with np.errstate(divide="ignore"):
        return np.log(z) / Ts


def monic(roots: np.ndarray) -> np.ndarray:
    """f (n,) of F = 1 + f1 z^-1 + ... with these roots (n,), complex ones in pairs; empty for none."""
    return np.atleast_1d(np.real(np.poly(roots)))[1:]  # of no root np.poly gives a plain number


def mirrored(f: np.ndarray) -> np.ndarray:
    """f (n,) of F = 1 + f1 z^-1 + ... with roots outside the unit circle mirrored inside; 0 if it is not finite."""
    if not len(f) or not np.all(np.isfinite(f)):
        return np.zeros(len(f))
    poles = np.roots(np.concatenate([[1.0], f])).astype(complex)
    outside = np.abs(poles) > 1.0
    poles[outside] = 1.0 / np.conj(poles[outside])
    return monic(poles)


def pairs(estimated: np.ndarray, true: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Numbers of the estimated and of the true poles that belong together: least total distance in the z-plane."""
    return linear_sum_assignment(np.abs(estimated[:, None] - true[None, :]))


def match(estimated: np.ndarray, true: np.ndarray, Ts: float) -> list[PoleMatch]:
    """Pairs of poles with the least total distance in the z-plane; surplus poles on either side stay unmatched."""
    estimated, true = np.asarray(estimated, dtype=complex), np.asarray(true, dtype=complex)
    if not len(estimated) or not len(true):
        return []
    rows, columns = pairs(estimated, true)
    s_true = to_s(true, Ts)
    moving = np.abs(s_true[np.isfinite(s_true) & (np.abs(s_true) > 1e-9)])
    floor = float(moving.min()) if len(moving) else 1.0
    out = []
    for i, j in zip(rows, columns, strict=True):
        error = abs(to_s(estimated[i], Ts) - s_true[j]) / (abs(s_true[j]) if abs(s_true[j]) > 1e-9 else floor)
        out.append(PoleMatch(complex(estimated[i]), complex(true[j]), float(error)))
    return out
