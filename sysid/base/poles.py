"""Poles: what they make of a motion, the match of an estimate with the truth, and unstable ones mirrored inside."""

from dataclasses import dataclass
from enum import StrEnum

import numpy as np

ROUNDING = 1e-14  # of F(1), which leaves a pole at 1
ON_CIRCLE = 1e-9  # distance from the unit circle that a search leaves to a pole which it holds there


class Motion(StrEnum):
    """What remains of a motion after its cause, in words for "the model ..."."""

    STABLE = "is stable"
    INTEGRATES = "integrates"
    UNSTABLE = "is not stable"


def motion(poles: np.ndarray) -> Motion:
    """The motion that poles in z (n,) make; those on the circle but for rounding integrate at 1 and swing elsewhere."""
    lasting = poles[np.abs(poles) >= 1.0 - ON_CIRCLE]
    if not len(lasting):
        return Motion.STABLE
    return Motion.INTEGRATES if np.all(np.abs(lasting - 1.0) <= ON_CIRCLE) else Motion.UNSTABLE


def time_constant(size: float, Ts: float) -> float:
    """-Ts / ln|z| [s], in which a motion falls to 37 %: monotone in |z|, 0 at 0 and below, infinite on the circle."""
    if not size > 0.0:
        return 0.0
    return float(-Ts / np.log(size)) if size < 1.0 - ON_CIRCLE else np.inf


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
    from scipy.optimize import linear_sum_assignment  # a fifth of a second, which no help text waits for

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
