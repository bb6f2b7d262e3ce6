"""Levels of a record: the same signals counted from other offsets."""

from dataclasses import replace

import numpy as np

from sysid.data.record import IOData


def counted_from(data: IOData, u_offset: np.ndarray | None, y_offset: np.ndarray | None) -> IOData:
    """The record with u (N, nu) and y (N, ny) counted from these offsets (nu,), (ny,); u + u_offset stays what it is.

    The record itself, bit for bit, if it is counted from them already, or if they are None (unknown).
    """
    if u_offset is None or y_offset is None:
        return data
    du, dy = data.u_offset - u_offset, data.y_offset - y_offset
    if not (du.any() or dy.any()):
        return data
    return replace(data, u=data.u + du, y=data.y + dy, u_offset=u_offset, y_offset=y_offset)


def counted_back(y: np.ndarray, own: IOData, data: IOData) -> np.ndarray:
    """Outputs y (N, ny) or (N,) of the record `own` at the level of `data`, from which `counted_from` made it."""
    if own is data:
        return y
    dy = own.y_offset - data.y_offset
    return y + (dy if y.ndim == 2 else dy[0])
