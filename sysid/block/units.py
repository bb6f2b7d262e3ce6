"""Matrices of `Law`: how the parameters of a block change with the units of its signals."""

import numpy as np


def in_order(factor: float, n: int, turned: bool) -> np.ndarray:
    """M (n, n) of n values in order of place: by a factor each, and in the other order where the places turn round."""
    M = factor * np.eye(n)
    return M[::-1] if turned else M


def joined(*parts: np.ndarray) -> np.ndarray:
    """The matrices along the diagonal of one."""
    n = sum(len(part) for part in parts)
    M, at = np.zeros((n, n)), 0
    for part in parts:
        M[at : at + len(part), at : at + len(part)] = part
        at += len(part)
    return M
