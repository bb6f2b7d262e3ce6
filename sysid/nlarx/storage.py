"""Read a saved nonlinear ARX model: every entry is checked, and the model is bit for bit the same."""

from dataclasses import replace
from typing import Any

import numpy as np

from sysid.base.errors import InputError
from sysid.estimation.origin import FREE_RUN, ONE_STEP
from sysid.estimation.storage import build_checked, check_numbers, check_offsets, check_sizes, check_span, version_of
from sysid.nlarx.result import VERSION, NlarxFit


def build_fit(document: dict[str, Any]) -> NlarxFit:
    """The fit of a document; raises InputError for entries that are missing, wrong or do not belong together."""
    version_of(document, VERSION)
    fit, names = build_checked(NlarxFit, document)
    if not fit.network.T.size:  # a table without rows does not tell the number of its columns
        fit = replace(fit, network=replace(fit.network, T=np.empty((0, len(fit.model.regressors)))))
    _check(fit, names)
    return fit


def _check(fit: NlarxFit, names: list[str]) -> None:
    """Consistency checks between the fields."""
    network, n = fit.network, len(fit.model.regressors)
    model = replace(network.model, units=fit.model.units)  # the network has the number that units='auto' came to
    if network.mu.shape != (n,) or network.T.ndim != 2 or network.T.shape[1] != n or model != fit.model:
        raise InputError(f"the network does not belong to a model of {n} regressors; save the fit again")
    counted = min(network.wavelets, network.scaling) >= 0 and network.size == len(names)
    if not counted or names != list(network.names):  # names of units that only a damaged file counts fill any memory
        raise InputError(f"theta does not name the network's {network.size} parameters; save the fit again")
    if fit.theta.dtype != float or not np.all(np.isfinite(np.concatenate([fit.theta, network.mu, network.T.ravel()]))):
        raise InputError("the parameters are not all finite numbers; save the fit again")
    if not 0 < fit.Ts < np.inf or fit.n_init < 0 or fit.criteria_of not in (ONE_STEP, FREE_RUN):
        raise InputError(f"Ts is {fit.Ts}, n_init {fit.n_init} and criteria_of {fit.criteria_of!r}; save the fit again")
    check_span("u_span", fit.u_span)
    check_span("y_span", fit.y_span)
    check_numbers(fit.theta, fit.covariance, fit.criteria)
    check_sizes(np.concatenate([network.mu, network.T.ravel()]))
    check_offsets(fit.u_offset, fit.y_offset, (1, 1))
