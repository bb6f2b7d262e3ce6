"""Gauge freedom of a chain: parameter directions that leave its output as it is.

A gain or an offset can move between neighbouring blocks. Each block says which affine changes of its signals it can
undo or cause (`Symmetry`); here they are combined so that input and output of the chain stay untouched. Nothing else
in the library knows of gauges: criteria and covariance ask this module.
"""

import numpy as np
from scipy.linalg import null_space

from sysid.block import Block

_RCOND = 1e-9


def gauge(blocks: tuple[Block, ...], thetas: list[np.ndarray], free: np.ndarray) -> np.ndarray:
    """Basis (P, g) of the redundant directions among the `free` (P,) parameters, for block parameters `thetas`."""
    columns, conditions = [], []
    offsets = np.concatenate([[0], np.cumsum([len(t) for t in thetas])])
    n_interfaces = len(blocks) + 1
    for i, (block, theta) in enumerate(zip(blocks, thetas, strict=True)):
        for s in block.symmetries(theta):
            size = max(abs(s.in_scale), abs(s.in_shift), abs(s.out_scale), abs(s.out_shift)) or 1.0
            column = np.zeros(offsets[-1])
            column[offsets[i] : offsets[i + 1]] = s.d_theta / size
            columns.append(column)
            # What block i asks of the signal before it minus what it does to the one after it.
            condition = np.zeros(2 * n_interfaces)
            condition[2 * i : 2 * i + 2] = s.in_scale, s.in_shift
            condition[2 * i + 2 : 2 * i + 4] = -s.out_scale, -s.out_shift
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
