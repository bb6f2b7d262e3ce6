"""A fitted chain at another sampling time, and the sampling time that a joint needs."""

import re
from dataclasses import replace

import numpy as np

from sysid.estimation.joint_parts import motor_of
from sysid.estimation.result import Fit
from sysid.model.chain import Chain

_SAMPLE = re.compile(r"(/)?samples?(?:\^(\d))?")
_PARTS = (1, 2, 4, 5)  # of the first sampling time: an estimate of lag and delay by a slow record goes no further
MOST = 20  # times: a motor knows a delay of so many samples
_NEEDED = 3.0  # samples of lag and delay together, at least


def powers(chain: Chain) -> np.ndarray:
    """Power (P,) of the sample in each parameter's unit: 1 for "samples", -2 for "y/sample^2", 0 without one."""
    found = []
    for slot in chain.slots:
        seen = _SAMPLE.search(slot.unit)
        found.append(0 if seen is None else (-1 if seen[1] else 1) * int(seen[2] or 1))
    return np.array(found)


def rated(chain: Chain, times: float) -> Chain:
    """The chain with its bounds for samples that are `times` times shorter."""
    if not chain.bounds:
        return chain
    factors = dict(zip(chain.names, times ** powers(chain).astype(float), strict=True))
    bounds = {name: (low * factors[name], high * factors[name]) for name, (low, high) in chain.bounds.items()}
    return replace(chain, bounds=bounds)


def at_rate(chain: Chain, theta: np.ndarray, times: float) -> np.ndarray:
    """theta (P,) of `rated(chain, times)`, the same joint.

    Holds for chains whose dynamics are solved in continuous time, as a motor's, a backlash's and a spring's.
    """
    return np.clip(theta * times ** powers(chain).astype(float), *rated(chain, times).limits)


def response(chain: Chain, theta: np.ndarray) -> float:
    """Lag and delay of the motor together, in samples."""
    motor = motor_of(chain)
    part = chain.part(theta, motor)
    return motor.value(part, "lag") + motor.value(part, "delay")


def times_faster(fit: Fit) -> int:
    """How many times faster to sample, 1 to 5, so that lag and delay together last three samples."""
    lasts = response(fit.model, fit.theta)
    return next((k for k in _PARTS if k * lasts >= _NEEDED), _PARTS[-1])
