"""Rounds of growth: in each every part is tried, and the one that lowers BIC most stays, as long as one does."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from sysid.data.record import IOData
from sysid.estimation.result import Fit
from sysid.joint.clock import Clock
from sysid.joint.nearby import searched
from sysid.joint.parts import PARTS, more
from sysid.joint.unseen import Unseen, free_runs, harms
from sysid.selection.folds import Fold
from sysid.solver.iterate import Options

# Three times what counts as very strong evidence (Kass and Raftery, J. Amer. Statist. Assoc. 90, 1995, section 3.2):
# residuals of a model that is not quite the joint are coloured, and BIC takes them as white.
MARGIN = 30.0
_CLOSE = 10.0  # difference of BIC between two parts that is no very strong evidence (the same source)
_TELLING = 2.0  # times the error over the whole record, up to which free runs over unseen parts can judge a part
_SCREENING = Options(max_iterations=15)


@dataclass(frozen=True)
class Step:
    """One part tried in a round: BIC with it, its reduction of BIC, and whether the part was kept.

    `unseen` is the ratio of the free-run error on unseen parts of the record with the part to that without it, nan if
    the part did not lower BIC enough to be asked.
    """

    round: int
    part: str
    bic: float
    earned: float
    kept: bool
    unseen: float = float("nan")


def rounds(
    fit: Fit, data: IOData, pair: tuple[Fold, ...], names: tuple[str, ...], options: dict[str, Any], clock: Clock
) -> tuple[Fit, tuple[Step, ...], tuple[tuple[str, str], ...]]:
    """The grown fit, the parts tried, and pairs (kept, other) of parts that the record does not tell apart.

    A round that the clock ends does not count: parts are judged beside each other.
    """
    steps: list[Step] = []
    undecided: list[tuple[str, str]] = []
    nothing: dict[str, Fit] = {}
    k = 0
    while True:
        tried = clock.within("every part was tried", _tried, nothing, fit, data, names, options)
        earned = {name: float(fit.criteria.bic - other.criteria.bic) for name, other in tried.items()}
        best, ratios = _best(fit, tried, earned, pair)
        steps += [
            Step(k, name, float(other.criteria.bic), earned[name], name == best, ratios.get(name, np.nan))
            for name, other in tried.items()
        ]
        if best is None:
            return fit, tuple(steps), tuple(undecided)
        undecided += [(best, name) for name in tried if _close(best, name, earned)]
        k += 1
        last = (tried[best].model, tried[best].theta[None], data, options)
        fit = clock.within("every part was tried", searched, None, *last) or tried[best]


def _tried(fit: Fit, data: IOData, names: tuple[str, ...], options: dict[str, Any]) -> dict[str, Fit]:
    """The fits with one more part, by its name."""
    tried: dict[str, Fit] = {}
    for name, chain, points in more(fit, data, names):
        other = searched(chain, points, data, options, _SCREENING)
        if other is not None:
            tried[name] = other
    return tried


def _best(
    fit: Fit, tried: dict[str, Fit], earned: dict[str, float], pair: tuple[Fold, ...]
) -> tuple[str | None, dict[str, float]]:
    """The part that lowers BIC most among those that lower it enough and do no harm on unseen parts."""
    ratios: dict[str, float] = {}
    before: Unseen | None = None
    for name in sorted(earned, key=lambda name: -earned[name]):
        if earned[name] <= MARGIN:
            break
        if not pair:
            return name, ratios
        before = before or free_runs(fit.model, fit.theta, pair)
        if before.rms > _TELLING * float(np.sqrt(fit.criteria.mse)):
            return name, ratios  # the folds do not show what a joint needs, with this part or without it
        after = free_runs(tried[name].model, tried[name].theta, pair)
        ratios[name] = after.rms / before.rms
        if not harms(before, after, float(np.sqrt(tried[name].criteria.mse))):
            return name, ratios
    return None, ratios


def _close(best: str, name: str, earned: dict[str, float]) -> bool:
    """Whether the record does not tell the kept part from another one that is not a part of it, or it of that."""
    if name == best or PARTS[name].within(PARTS[best]) or PARTS[best].within(PARTS[name]):
        return False
    return earned[best] - earned[name] < _CLOSE
