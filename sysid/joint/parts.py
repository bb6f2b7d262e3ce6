"""What a record shows of each part of a joint: its posterior beside what is usual.

A part is shown where the record makes its absence much less probable than it was: the odds are the density of the prior
at zero over that of the posterior (Dickey, Annals of Mathematical Statistics 42, 1971). Odds of 20 to 1 count as strong
(Kass and Raftery, J. Amer. Statist. Assoc. 90, 1995).
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.stats import norm

from sysid.blocks import CoastingPlay, Motor, Play, ServoMotor
from sysid.data.record import IOData
from sysid.estimation.result import Fit
from sysid.joint.prior import known_of, units_of, usual_values
from sysid.joint.transfer import joint_information
from sysid.motor_parts import TABLE

_STRONG = 20.0  # odds
WORDS: dict[type, dict[str, str]] = {
    Motor: {
        "stick": "higher friction at rest upward",
        "stick_down": "higher friction at rest downward",
        "loss": "friction proportional to the load",
        "jam": "jamming at a struck stop",
    },
    ServoMotor: {"sag": "a supply that sags"},
    Play: {"width": "backlash"},
    CoastingPlay: {"width": "backlash"},
}


@dataclass(frozen=True)
class PartEvidence:
    """A parameter that is zero without its part: estimate and deviation, beside centre and deviation of what is usual.

    `odds` are those of the part against its absence. `verdict`: "shown", "absent", or "open" where the odds are not
    strong either way.
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
        return "shown" if self.odds > _STRONG else "absent" if self.odds * _STRONG < 1.0 else "open"

    def as_dict(self) -> dict[str, Any]:
        """Ready for JSON."""
        finite = {key: float(np.clip(v, -1e300, 1e300)) for key, v in vars(self).items() if isinstance(v, float)}
        return {**vars(self), **finite, "verdict": self.verdict}


def parts_of(fit: Fit, data: IOData) -> tuple[PartEvidence, ...]:
    """The parts of a joint that was fitted to `data` with a prior; none of another joint.

    The posterior has the deviations of `sysid.joint.transfer.joint_information`.
    """
    if fit.prior is None:
        return ()
    chain = fit.model
    usual, deviations = usual_values(chain, units_of(chain, fit.theta, data)), joint_information(fit, data).std_of_fit
    found = []
    for block in chain.blocks:
        for slot in block.slots():
            name, words = f"{block.role}.{slot.name}", known_of(block, slot.name, WORDS)
            if isinstance(block, Motor):
                words = next((TABLE[p].words for p in block.further if TABLE[p].shown == slot.name), words)
            if words is None or name not in usual:
                continue
            k = chain.names.index(name)
            normals = float(fit.theta[k]), float(deviations(np.eye(len(chain.names))[k])), *usual[name]
            found.append(PartEvidence(name, words, slot.unit, *normals, _odds(*normals)))
    return tuple(found)


def _odds(value: float, std: float, usual: float, spread: float) -> float:
    """Of a parameter that is zero or more against zero: density of the prior at zero over that of the posterior."""
    if not (np.isfinite(std) and std > 0.0):
        return 1.0
    logs = [norm.logpdf(0.0, m, s) - norm.logsf(0.0, m, s) for m, s in ((usual, spread), (value, std))]
    return float(np.exp(np.clip(logs[0] - logs[1], -600.0, 600.0)))
