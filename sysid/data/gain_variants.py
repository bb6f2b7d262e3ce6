"""Gain variants of a record: fits that must hold for another supply voltage or another friction."""

from dataclasses import replace

import numpy as np

from sysid.base.errors import InputError
from sysid.data.record import IOData


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
