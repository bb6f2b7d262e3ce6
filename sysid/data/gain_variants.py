"""A record as it might have been under another supply or another friction: for fits that must hold on another day."""

from dataclasses import replace

import numpy as np

from sysid.base.errors import InputError
from sysid.data.record import IOData


def gain_variants(data: IOData, share: float) -> IOData:
    """The record three times, its input multiplied by 1 - share, 1 and 1 + share, as experiments of one fit.

    A chain that integrates adds up every error of its friction, and friction and gain differ from day to day by
    more than one record can show. A fit to all three prefers, among models that explain the record alike, the one whose
    free run leans least on either. `share` is best read from the scatter of a model fitted to parts of the record;
    covariances and criteria of such a fit count every sample three times.
    """
    if not 0.0 < share < 1.0:
        raise InputError(f"share is {share}; give the expected scatter of the gain between 0 and 1, for example 0.03")
    return IOData.merge(*(replace(data, u=factor * data.u) for factor in np.array([1.0 - share, 1.0, 1.0 + share])))
