"""Inputs before a record that a delay lets through: parameters of the record, where its first outputs show them.

A record that begins at rest has one input before it. Of one that is cut out of a run the delay still holds others, and
a model without them leaves errors at its beginning that no noise explains.
"""

from dataclasses import replace

import numpy as np
from scipy.stats import f as f_distribution

from sysid.data.record import IOData
from sysid.estimation.finer_maps import search_finer
from sysid.estimation.normal import Normal
from sysid.estimation.search import SearchContext, SearchResult
from sysid.model.chain import Chain

_FALSE_ALARMS = 1e-3  # of the test for errors at the beginning
_SHARE = 10  # samples of a record for each of its past inputs


def past_inputs(
    model: Chain, data: IOData, normal: Normal, result: SearchResult, context: SearchContext
) -> tuple[Chain, Normal, SearchResult]:
    """The model with past inputs, its normal units, and the end of its search; as given where it needs none."""
    thetas = normal.restore(model, data, result.problem, result.outcome)[0].theta0
    changed = [(b, b.recalling(model.part(thetas[0], b))) for b in model.blocks]
    found = [(b, wider) for b, wider in changed if wider is not None]
    if not found or model.predicts or not _begins_worse(model, thetas, data, sum(w.n_parameters for _, w in found)):
        return model, normal, result
    blocks = tuple(wider or b for b, wider in changed)
    chain = replace(model, blocks=blocks)
    places = [_place(model, name) for name in chain.names]
    return chain, *search_finer(chain, thetas[:, places], data, normal, result, context, None)


def _place(model: Chain, name: str) -> int:
    """The place of a parameter in the model as it was: that of u0 for a further past input."""
    return model.names.index(name if name in model.names else f"{name.rpartition('.')[0]}.u0")


def _begins_worse(model: Chain, thetas: np.ndarray, data: IOData, count: int) -> bool:
    """Whether the errors of the first `count` samples of the experiments are larger than those of the others."""
    first, later = [], []
    for theta, record in zip(thetas, data.experiments, strict=True):
        e = np.where(record.observed, record.y - model.outputs(theta, record.u), np.nan)[:, 0]
        first.append(e[:count])
        later.append(e[count:])
    a, b = (part[np.isfinite(part)] for part in map(np.concatenate, (first, later)))
    if not len(a) or len(b) < (_SHARE - 1) * len(a):
        return False
    ratio = float(np.mean(a**2)) / max(float(np.mean(b**2)), 1e-300)
    return ratio > f_distribution.isf(_FALSE_ALARMS, len(a), len(b))
