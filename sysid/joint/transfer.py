"""The band of a joint's free run over inputs of another kind than those of its record.

A model lacks something of every joint, and what it lacks acts differently at other levels, rates and ends of the way:
its parameters then differ from part to part of a record by more than the noise explains. The joint is fitted to parts
that differ in kind. Their deviations from the fit to the whole are directions along which the parameters may be off on
yet another kind, beside those of the noise: with half of the record each, their variance is that of the whole
(subsampling: Politis, Romano and Wolf, Subsampling, Springer 1999, chapter 2). The band comes from draws that are
simulated: a joint stands or moves, which no tangent tells.
"""

from dataclasses import replace

import numpy as np

from sysid.base.errors import InputError
from sysid.base.parallel import one_blas_thread
from sysid.data.record import IOData
from sysid.estimation.result import Fit
from sysid.joint.holdout import refit
from sysid.selection.folds import folds_of_other_kinds
from sysid.uncertainty.bands import OutputBand, monte_carlo
from sysid.uncertainty.information import Information, information

_DRAWS = 200


def joint_information(fit: Fit, data: IOData) -> Information:
    """The information of a joint fitted to `data`, with what its parameters change between parts of another kind.

    A record that is too short for such parts gives that of the noise alone. Raises the errors of `information`.
    """
    info = information(fit, data, lags="auto")
    try:
        parts = [fold.estimation for fold in folds_of_other_kinds(data)]
    except InputError:
        return info
    changes = np.zeros((len(info.theta), len(parts)))
    with one_blas_thread(), np.errstate(all="ignore"):
        for k, part in enumerate(parts):
            changes[info.own, k] = refit(fit.model, fit.theta, part, fit.prior) - fit.theta
    changes[info.chain.initial] = 0.0  # a part begins elsewhere
    return replace(info, factor=np.hstack([info.factor, changes / np.sqrt(len(parts))]))


def joint_band(fit: Fit, data: IOData, record: IOData, level: float = 0.95, noise: bool = True) -> OutputBand:
    """The band of the free run of a joint, fitted to `data`, over a record of the same or of another kind of input.

    The first outputs of `record` give its initial state, as in `sysid.uncertainty.bands`; `noise`: whether new
    measurements should lie in the band. Raises the errors of `information` and `monte_carlo`.
    """
    with np.errstate(all="ignore"):  # a draw may run away, which the band's note says
        return monte_carlo(joint_information(fit, data), record, level, noise, draws=_DRAWS)
