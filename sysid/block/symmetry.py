"""How the parameters of a block follow a change of its signals: symmetries, gauge freedom, and laws of units.

A sign that turns with a signal (`direction`) lets a record and its mirror image be told.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

_RANK_TOLERANCE = 1e-9  # of a singular value beside the largest; chosen by hand
_SKEW = 1e-3  # a third moment below this share of the spread's cube may be rounding
_LATE = 1e-6  # the same of the correlation with time


@dataclass(frozen=True)
class Symmetry:
    """A change of the block's parameters that compensates or causes an affine change of its signals.

    If the input moves by (in_scale * x + in_shift) * eps and theta by d_theta * eps, then the output moves by
    (out_scale * y + out_shift) * eps, to first order.
    """

    d_theta: np.ndarray
    in_scale: float | np.ndarray = 0.0  # one value for each channel, a number for one
    in_shift: float | np.ndarray = 0.0
    out_scale: float | np.ndarray = 0.0
    out_shift: float | np.ndarray = 0.0


def gauge(
    symmetries: Sequence[Sequence[Symmetry]], sizes: Sequence[int], widths: list[int], free: np.ndarray
) -> np.ndarray:
    """Basis (P, g) of the redundant directions among the `free` (P,) parameters of blocks in series.

    A gain or an offset can move between neighbouring blocks. Each block declares the affine changes of its signals
    that it can compensate or cause; they are combined so that input and output of the series do not change.
    `symmetries` and the numbers of parameters `sizes` are those of each block; `widths` are the channels of each signal
    from the input to the output. It is the only place for gauges: criteria and covariance use it.
    """
    columns, conditions = [], []
    offsets = np.concatenate([[0], np.cumsum(sizes)])
    at = np.concatenate([[0], np.cumsum(2 * np.array(widths))])  # positions of an interface's scales and shifts
    for i, changes in enumerate(symmetries):
        for s in changes:
            # What block i needs of the signals before it minus what it does to those after it.
            condition = np.zeros(at[-1])
            condition[at[i] : at[i + 1]] = _affine(s.in_scale, s.in_shift, widths[i])
            condition[at[i + 1] : at[i + 2]] = -_affine(s.out_scale, s.out_shift, widths[i + 1])
            size = np.abs(condition).max() or 1.0
            column = np.zeros(offsets[-1])
            column[offsets[i] : offsets[i + 1]] = s.d_theta / size
            columns.append(column)
            conditions.append(condition / size)
    if not columns:
        return np.zeros((offsets[-1], 0))
    from scipy.linalg import null_space  # a tenth of a second, which no help text waits for

    D, C = np.array(columns).T, np.array(conditions).T
    rows = np.linalg.norm(D, axis=1, keepdims=True)
    rows = np.where(rows > 0, rows, 1.0)  # parameters differ in unit; what counts as zero must not
    C = np.vstack([C, (D / rows)[~free]])  # a fixed parameter must not move either
    directions = (D / rows) @ null_space(C, rcond=_RANK_TOLERANCE)
    if directions.shape[1] == 0:
        return directions
    U, sv, _ = np.linalg.svd(directions, full_matrices=False)
    return rows * U[:, sv > _RANK_TOLERANCE * max(sv[0], 1e-300)]


def _affine(scale: float | np.ndarray, shift: float | np.ndarray, n: int) -> np.ndarray:
    return np.concatenate([np.broadcast_to(scale, (n,)), np.broadcast_to(shift, (n,))])


def diagonal(factor: float, n: int, turned: bool) -> np.ndarray:
    """M (n, n) of n values in order of place: by a factor each, and in the other order where the places turn round."""
    M = factor * np.eye(n)
    return M[::-1] if turned else M


def block_diagonal(*parts: np.ndarray) -> np.ndarray:
    """The matrices along the diagonal of one."""
    n = sum(len(part) for part in parts)
    M, at = np.zeros((n, n)), 0
    for part in parts:
        M[at : at + len(part), at : at + len(part)] = part
        at += len(part)
    return M


def direction(x: np.ndarray) -> float:
    """1.0 or -1.0 of a signal x (N,), and the other one of -x; 1.0 of a constant.

    The sign of the third central moment; of a symmetric signal that of its correlation with time, and where there is
    none either, that of the first sample that is clearly away from the mean. Nothing but the sign of x changes what
    this is: no gain, and no offset but for rounding.
    """
    largest = float(np.abs(x).max(initial=0.0))
    x = x / largest if largest > 0.0 else x
    z = x - np.mean(x) if len(x) else x
    size = float(np.sqrt(np.mean(z * z))) if len(x) else 0.0
    if not size > 0.0:
        return 1.0
    skew = float(np.mean(z * z * z)) / size**3
    if abs(skew) > _SKEW:
        return float(np.sign(skew))
    ramp = np.arange(len(z)) - 0.5 * (len(z) - 1.0)
    late = float(z @ ramp) / (size * len(z) * float(np.std(ramp)))
    if abs(late) > _LATE:
        return float(np.sign(late))
    return float(np.sign(z[np.argmax(np.abs(z) > 0.5 * size)]))
