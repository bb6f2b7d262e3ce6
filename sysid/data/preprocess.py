"""Preprocessing: means, halves (the 'quick start' of the paper's section III.B), gain variants, and re-exports.

Trends with kinks are in `sysid.data.trends`, filters in `sysid.data.filters`, other rates in `sysid.data.resampling`,
outliers in `sysid.data.outliers`, missing data in `sysid.data.missing`, an angle's wraps in `sysid.data.wraps`. Each
returns a sentence that says what it did.
"""

from dataclasses import replace

import numpy as np

from sysid.base.checks import checked
from sysid.base.errors import InputError, unknown
from sysid.data.filters import butterworth
from sysid.data.missing import fill, record
from sysid.data.outliers import hampel, outliers
from sysid.data.record import IOData
from sysid.data.resampling import resample
from sysid.data.trends import Trend
from sysid.data.wraps import unwrapped

DETREND = ("mean", "linear", "steady", "none")
ZERO = ("mean", "steady")  # of which both are levels


@checked
def detrend(data: IOData, kind: str = "mean") -> IOData:
    """The record without its means ('mean'), its levels before the first movement ('steady'), straight lines
    ('linear', one for each channel and experiment), or unchanged ('none').

    Removed constants are added to `u_offset` and `y_offset`. Lines are not: a record stores only constant offsets, and
    `Trend` restores lines.
    """
    if kind not in DETREND:
        raise unknown("detrend", kind, DETREND)
    return data if kind == "none" else Trend.of(data, kind).remove(data)


@checked
def retrend(data: IOData) -> IOData:
    """The record in its original scale: the constants that `detrend` removed are added again."""
    return replace(
        data,
        u=data.u + data.u_offset,
        y=data.y + data.y_offset,
        u_offset=0 * data.u_offset,
        y_offset=0 * data.y_offset,
    )


@checked
def quick_start(data: IOData, split: float = 0.5, kind: str = "mean") -> tuple[IOData, IOData]:
    """Removes the means of the whole record, then splits it: the first part for estimation, the rest for validation."""
    return detrend(data, kind).split(split)


def gain_variants(data: IOData, share: float) -> IOData:
    """The record three times, its input multiplied by 1 - share, 1 and 1 + share, as experiments of one fit.

    A chain that integrates accumulates every error of its friction, and friction and gain change from day to day by
    more than one record shows. Among models that explain the record equally well, a fit to all three prefers the one
    whose free run is least sensitive to both. Take `share` from the scatter of a model fitted to parts of the record.
    Covariances and criteria of such a fit count every sample three times.
    """
    if not 0.0 < share < 1.0:
        raise InputError(f"share is {share}; give the expected scatter of the gain between 0 and 1, for example 0.03")
    return IOData.merge(*(replace(data, u=factor * data.u) for factor in np.array([1.0 - share, 1.0, 1.0 + share])))


__all__ = [
    "Trend",
    "butterworth",
    "detrend",
    "fill",
    "gain_variants",
    "hampel",
    "outliers",
    "quick_start",
    "record",
    "resample",
    "retrend",
    "unwrapped",
]
