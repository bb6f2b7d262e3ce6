"""What a record shows of each part of a joint: its posterior beside what is usual.

A part is shown where the record makes its absence much less probable than it was: the odds are the density of the prior
at zero over that of the posterior (Dickey, Annals of Mathematical Statistics 42, 1971). The posterior of a joint is not
normal everywhere, so strong odds are held against a search with the part at zero, and odds against it those at its
usual and its largest usual size: they are no stronger than what that lowers the posterior by. Odds of 20 to 1 count as
strong (Kass and Raftery, J. Amer. Statist. Assoc. 90, 1995).
"""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from scipy.stats import norm

from sysid.blocks import CoastingPlay, Motor, Play, ServoMotor
from sysid.data.record import IOData
from sysid.estimation.result import Fit
from sysid.joint.full import colour_level
from sysid.joint.holdout import refit_with_cost
from sysid.joint.physics import way_up
from sysid.joint.prior import known_of, units_of, usual_values
from sysid.joint.transfer import joint_information
from sysid.model.chain import Chain
from sysid.motor_parts import TABLE

STRONG = 20.0  # odds
_SEARCHES = 12  # of a few iterations each
_HOPE = 0.1  # of what strong odds have too much, that a search must bring to be worth a next one
WORDS: dict[type, dict[str, str]] = {
    Motor: {
        "stick": "higher friction at rest upward",
        "stick_down": "higher friction at rest downward",
        "loss": "friction proportional to the load",
        "jam": "jamming at a struck stop",
    },
    ServoMotor: {"sag": "sagging of the supply", "dead": "dead band from whose edge the error counts"},
    Play: {"width": "backlash"},
    CoastingPlay: {"width": "backlash"},
}


@dataclass(frozen=True)
class PartEvidence:
    """A parameter that is zero without its part: estimate and deviation, beside centre and deviation of what is usual.

    `std` is nan where the record gives none. `odds` are those of the part against its absence. `verdict`: "shown",
    "absent", or "open" where the odds are not strong either way.
    """

    name: str
    words: str
    unit: str
    value: float
    std: float
    usual: float
    spread: float
    odds: float

    @property
    def normals(self) -> tuple[tuple[float, float], tuple[float, float]]:
        """Centre and deviation after the record, and before it."""
        return (self.value, self.std), (self.usual, self.spread)

    @property
    def verdict(self) -> str:
        return "shown" if self.odds > STRONG else "absent" if self.odds * STRONG < 1.0 else "open"

    def as_dict(self) -> dict[str, Any]:
        """Ready for JSON."""
        return {**vars(self), "std": self.std if np.isfinite(self.std) else None, "verdict": self.verdict}


def parts_of(fit: Fit, data: IOData) -> tuple[PartEvidence, ...]:
    """The parts of a joint that was fitted to `data` with a prior; none of another joint.

    The posterior has the deviations of `sysid.joint.transfer.joint_information`.
    """
    if fit.prior is None:
        return ()
    chain, info = fit.model, joint_information(fit, data)
    heights = _Heights(fit, data, info.cov[np.ix_(info.own, info.own)])
    usual, deviations = usual_values(chain, units_of(chain, fit.theta, data)), info.std_of_fit
    units = {f"{block.role}.{slot.name}": slot.unit for block in chain.blocks for slot in block.slots()}
    found = []
    for name, words in words_of(chain).items():
        if name not in usual:
            continue
        if way_up(chain, fit.theta) < 0 and words.endswith("ward"):
            words = f"{words.rsplit(' ', 1)[0]} {'downward' if words.endswith('upward') else 'upward'}"
        k = chain.names.index(name)
        normals = float(fit.theta[k]), float(deviations(np.eye(len(chain.names))[k])), *usual[name]
        odds = _odds(*normals)
        if odds > STRONG:
            odds = min(odds, max(1.0, heights.odds_against(name, 0.0)))
        elif odds * STRONG < 1.0:
            usual_sizes = {usual[name][0], sum(usual[name])} - {0.0}
            odds = max(odds, *(min(1.0, 1.0 / heights.odds_against(name, size)) for size in usual_sizes))
        found.append(PartEvidence(name, words, units[name], *normals, odds))
    return tuple(found)


def words_of(chain: Chain) -> dict[str, str]:
    """What the parts of a joint are called, by the names of the parameters that are zero without them."""
    found = {}
    for block in chain.blocks:
        for slot in block.slots():
            words = known_of(block, slot.name, WORDS)
            if isinstance(block, Motor):
                words = next((TABLE[p].words for p in block.further if TABLE[p].shown == slot.name), words)
            if words is not None:
                found[f"{block.role}.{slot.name}"] = words
    return found


class _Heights:
    """By how much the posterior of a joint falls where a parameter is held elsewhere and the others are searched."""

    def __init__(self, fit: Fit, data: IOData, cov: np.ndarray) -> None:
        self.fit, self.data, self.cov = fit, data, cov

    @cached_property
    def _best(self) -> float:
        return refit_with_cost(self.fit.model, self.fit.theta, self.data, self.fit.prior)[1]

    @cached_property
    def _level(self) -> float:
        return colour_level(self.fit, self.data)

    def odds_against(self, name: str, value: float) -> float:
        """Height of the posterior over that with the parameter `name` held at `value`.

        The search begins with the other parameters as they are, and where a normal posterior has them.
        """
        fit, k = self.fit, self.fit.model.names.index(name)
        held, change = replace(fit.model, fixed={**fit.model.fixed, name: value}), np.zeros(len(fit.theta))
        change[k] = value - fit.theta[k]
        with np.errstate(all="ignore"):
            moved = np.nan_to_num(self.cov[:, k] / self.cov[k, k]) * change[k]
            moved[k] = change[k]
            ends = [self._searched(held, np.clip(fit.theta + way, *held.limits)) for way in (change, moved)]
            theta, fall = min(ends, key=lambda end: end[1])
            for _ in range(_SEARCHES):  # until the odds are not strong, or cannot become so any more
                excess, before = fall - np.log(STRONG), fall
                theta, fall = self._searched(held, theta) if excess > 0.0 else (theta, fall)
                if before - fall <= _HOPE * excess:
                    break
        return float(np.exp(np.clip(fall, -600.0, 600.0)))

    def _searched(self, held: Chain, theta: np.ndarray) -> tuple[np.ndarray, float]:
        """theta after a few iterations, and the logarithm of that ratio there."""
        theta, cost = refit_with_cost(held, theta, self.data, self.fit.prior)
        return theta, float(np.nan_to_num((cost - self._best) / (2.0 * self._level**2), nan=0.0))


def _odds(value: float, std: float, usual: float, spread: float) -> float:
    """Of a parameter that is zero or more against zero: density of the prior at zero over that of the posterior."""
    if not (np.isfinite(std) and std > 0.0):
        return 1.0
    logs = [norm.logpdf(0.0, m, s) - norm.logsf(0.0, m, s) for m, s in ((usual, spread), (value, std))]
    return float(np.exp(np.clip(logs[0] - logs[1], -600.0, 600.0)))
