"""Preprocessing: means off, halves (the 'quick start' of the paper's section III.B)."""

from dataclasses import replace

from sysid.data import IOData
from sysid.errors import unknown

DETREND = ("mean", "none")


def detrend(data: IOData, kind: str = "mean") -> IOData:
    """The record without its means ('mean') or as it is ('none'); what went off is added to `u_offset`, `y_offset`."""
    if kind not in DETREND:
        raise unknown("detrend", kind, DETREND)
    if kind == "none":
        return data
    u0, y0 = data.u.mean(axis=0), data.y.mean(axis=0)
    return replace(data, u=data.u - u0, y=data.y - y0, u_offset=data.u_offset + u0, y_offset=data.y_offset + y0)


def retrend(data: IOData) -> IOData:
    """The record on its own scale again: what `detrend` took away is added back."""
    return replace(
        data,
        u=data.u + data.u_offset,
        y=data.y + data.y_offset,
        u_offset=0 * data.u_offset,
        y_offset=0 * data.y_offset,
    )


def quick_start(data: IOData, split: float = 0.5, kind: str = "mean") -> tuple[IOData, IOData]:
    """Means of the whole record off, then the first part for estimation and the rest for validation."""
    return detrend(data, kind).split(split)
