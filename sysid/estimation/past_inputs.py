"""Inputs before a record that a delay lets through: parameters of the record, where its first outputs show them.

The input before a record is taken for its first one, as of a step from rest. Of a record that is cut out of a run the
delay still holds others, and a model without them leaves errors at its beginning that no noise explains.
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
    """The model with past inputs, its normal units, and the end of its search; as given where it needs none.

    First one that stands for all, as where a record begins with a step, if BIC is lower with it; then all that a delay
    holds, if the first outputs still show that.
    """
    for every in (False, True):
        thetas = normal.restore(model, data, result.problem, result.outcome)[0].theta0
        pairs = [(b, model.part(thetas[0], b)) for b in model.blocks]
        longest = [b.recalling(theta, every=True) for b, theta in pairs]
        count = sum(b.n_parameters for b in longest if b is not None)
        if not count or model.predicts or (every and not _begins_worse(model, thetas, data, count)):
            break
        chain = replace(model, blocks=tuple(b.recalling(theta, every) or b for b, theta in pairs))
        points = np.array([_point(model, chain, *each) for each in zip(thetas, data.experiments, strict=True)])
        further = search_finer(chain, points, data, normal, result, context, None)
        N, before = int(data.observed.sum()), result.outcome.cost * normal.size**2
        now = further[1].outcome.cost * further[0].size ** 2
        if every or N * np.log(before / max(now, 1e-300)) > len(points) * np.log(N):
            model, (normal, result) = chain, further
    return model, normal, result


def _point(model: Chain, wider: Chain, theta: np.ndarray, record: IOData) -> np.ndarray:
    """theta (P,) of an experiment with the first input that each block meets for those before it."""
    known, signals = dict(zip(model.names, theta.tolist(), strict=True)), model.signals(theta, record.u)
    first = {b.role: float(x.flat[0]) for b, x in zip(wider.blocks, signals, strict=False)}
    return np.array([known.get(name, first[name.partition(".")[0]]) for name in wider.names])


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
