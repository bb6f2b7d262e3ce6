"""Gauge freedom of a chain: parameter directions that do not change its output.

A gain or an offset can move between neighbouring blocks. Each block declares the affine changes of its signals that it
can compensate or cause (`Symmetry`); this module combines them so that input and output of the chain do not change. It
is the only place for gauges: criteria and covariance use this module.
"""

import numpy as np
from scipy.linalg import null_space

from sysid.block.block import Block

_RCOND = 1e-9


def gauge(blocks: tuple[Block, ...], thetas: list[np.ndarray], free: np.ndarray) -> np.ndarray:
    """Basis (P, g) of the redundant directions among the `free` (P,) parameters, for block parameters `thetas`."""
    columns, conditions = [], []
    offsets = np.concatenate([[0], np.cumsum([len(t) for t in thetas])])
    widths = [blocks[0].channels[0], *(b.channels[1] for b in blocks)]
    at = np.concatenate([[0], np.cumsum(2 * np.array(widths))])  # positions of an interface's scales and shifts
    for i, (block, theta) in enumerate(zip(blocks, thetas, strict=True)):
        for s in block.symmetries(theta):
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
    D, C = np.array(columns).T, np.array(conditions).T
    rows = np.linalg.norm(D, axis=1, keepdims=True)
    rows = np.where(rows > 0, rows, 1.0)  # parameters differ in unit; what counts as zero must not
    C = np.vstack([C, (D / rows)[~free]])  # a fixed parameter must not move either
    directions = (D / rows) @ null_space(C, rcond=_RCOND)
    if directions.shape[1] == 0:
        return directions
    U, sv, _ = np.linalg.svd(directions, full_matrices=False)
    return rows * U[:, sv > _RCOND * max(sv[0], 1e-300)]


def _affine(scale: float | np.ndarray, shift: float | np.ndarray, n: int) -> np.ndarray:
    return np.concatenate([np.broadcast_to(scale, (n,)), np.broadcast_to(shift, (n,))])
