"""A fitted chain at another sampling time, and the sampling time that a joint needs."""

import numpy as np

from sysid.estimation.joint_parts import motor_of
from sysid.estimation.result import Fit
from sysid.model.chain import Chain

_PARTS = (1, 2, 4, 5)  # of the first sampling time: an estimate of lag and delay by a slow record goes no further
MOST = 20  # times: a motor knows a delay of so many samples
_NEEDED = 3.0  # samples of lag and delay together, at least


def exponent(unit: str) -> int:
    """Power of the sample in a parameter's unit: 1 for "samples", -2 for "y/sample^2", 0 without one."""
    for part in unit.split("/"):
        if part.startswith("sample"):
            power = int(part.partition("^")[2] or 1)
            return power if unit.startswith("sample") else -power
    return 0


def at_rate(chain: Chain, theta: np.ndarray, times: float) -> np.ndarray:
    """theta (P,) of the same chain for samples that are `times` times shorter.

    Holds for chains whose dynamics are solved in continuous time, as a motor's, a backlash's and a spring's.
    """
    powers = np.array([exponent(slot.unit) for slot in chain.slots])
    return np.clip(theta * times ** powers.astype(float), *chain.limits)


def times_faster(fit: Fit) -> int:
    """How many times faster to sample, 1 to 5, so that lag and delay together last three samples."""
    motor = motor_of(fit.model)
    part = fit.model.part(fit.theta, motor)
    lasts = motor.value(part, "lag") + motor.value(part, "delay")
    return next((k for k in _PARTS if k * lasts >= _NEEDED), _PARTS[-1])
