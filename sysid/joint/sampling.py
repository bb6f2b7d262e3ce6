"""A joint and its record at another sampling time, and a record in stretches, over which a free run bends less.

A joint integrates, so an error of its friction adds up over a whole record, and a small change of a value decides
whether a stop is reached in time. The cost over the whole record has many local minima for that reason; over stretches
it has few (multiple shooting: Bock and Plitt, IFAC Proceedings 17(2), 1984).
"""

import itertools
import re
from dataclasses import replace

import numpy as np

from sysid.blocks import Compliance, ServoMotor
from sysid.data.record import IOData
from sysid.estimation.joint_parts import motor_of
from sysid.estimation.result import Fit
from sysid.model.chain import Chain
from sysid.solver.linearisation import order_of

_SAMPLE = re.compile(r"(/)?samples?(?:\^(\d))?")
_RATES = (1, 2, 4, 5)  # of the first sampling time: an estimate of lag and delay by a slow record goes no further
LONGEST_DELAY = 20  # times: a motor knows a delay of so many samples
_RESPONSE_NEEDED = 3.0  # samples of lag and delay together, at least
ENOUGH_SAMPLES = 2500  # samples that show what a joint is made of
_STROKE_SAMPLES = 25.0  # samples from end to end, at the least: a motor's way is still seen
_FAST_QUANTILE = 0.95  # quantile of the speeds that counts as the joint's
STRETCHES = 6  # of a record
SHORTEST = 400  # samples of a stretch: over shorter ones friction shows less, since its errors do not add up
_CUT_REACH = 0.3  # of a stretch, within which a cut is moved to where the joint rests
_STILL_SHARE = 50  # a joint is still where it hardly moves over this share of a stretch


def sample_powers(chain: Chain) -> np.ndarray:
    """Power (P,) of the sample in each parameter's unit: 1 for "samples", -2 for "y/sample^2", 0 without one."""
    powers = []
    for slot in chain.slots:
        match = _SAMPLE.search(slot.unit)
        powers.append(0 if match is None else (-1 if match[1] else 1) * int(match[2] or 1))
    return np.array(powers)


def chain_at_rate(chain: Chain, times: float) -> Chain:
    """The chain with its bounds for samples that are `times` times shorter."""
    if not chain.bounds:
        return chain
    factors = dict(zip(chain.names, times ** sample_powers(chain).astype(float), strict=True))
    bounds = {name: (low * factors[name], high * factors[name]) for name, (low, high) in chain.bounds.items()}
    return replace(chain, bounds=bounds)


def theta_at_rate(chain: Chain, theta: np.ndarray, times: float) -> np.ndarray:
    """theta (P,) of `rated(chain, times)`, the same joint.

    Holds for chains whose dynamics are solved in continuous time, as a motor's, a backlash's and a spring's.
    """
    return np.clip(theta * times ** sample_powers(chain).astype(float), *chain_at_rate(chain, times).limits)


def response_samples(chain: Chain, theta: np.ndarray) -> float:
    """Lag and delay of the motor together, in samples."""
    motor = motor_of(chain)
    part = chain.part(theta, motor)
    return motor.value(part, "lag") + motor.value(part, "delay")


def rate_needed(fit: Fit) -> int:
    """How many times faster to sample, 1 to 5, so that lag and delay together last three samples."""
    lasts = response_samples(fit.model, fit.theta)
    return next((k for k in _RATES if k * lasts >= _RESPONSE_NEEDED), _RATES[-1])


def thinning_factor(data: IOData, chain: Chain) -> int:
    """How many samples may become one; 1 where the record is short, has gaps, or the chain holds a time of its own."""
    timed_names = {name for name in (*chain.fixed, *chain.bounds) if not name.endswith(".v0")}
    timed = any(power and name in timed_names for name, power in zip(chain.names, sample_powers(chain), strict=True))
    if timed or data.missing is not None:
        return 1
    steps = np.concatenate([np.abs(np.diff(e.y[:, 0])) for e in data.experiments])
    moving = steps[steps > 0.0]
    way = float(np.ptp(data.y)) / float(np.quantile(moving, _FAST_QUANTILE)) if len(moving) else 0.0
    return max(1, min(data.N // ENOUGH_SAMPLES, int(way / _STROKE_SAMPLES)))


def thin(data: IOData, k: int) -> IOData:
    """The record with k samples as one: the mean of the input over them, and the output at their beginning."""
    if k == 1:
        return data
    parts = []
    for e in data.experiments:
        n = e.N // k
        multiple = e.select(0, n * k)
        parts.append(
            IOData(
                multiple.u.reshape(n, k, -1).mean(axis=1),
                multiple.y[::k],
                k * data.Ts,
                **{name: getattr(data, name) for name in ("u_name", "y_name", "u_unit", "y_unit")},
                u_offset=data.u_offset,
                y_offset=data.y_offset,
            )
        )
    return IOData.merge(*parts)


def cut_at_rests(data: IOData, chain: Chain) -> IOData:
    """The record cut where its output rests; the record itself where it is short or the chain has more state at rest.

    The motor's speed and what its delay holds are zero only where it rests.
    """
    if any(isinstance(b, Compliance | ServoMotor) for b in chain.blocks):
        return data
    parts, length = [], max(SHORTEST, data.N // STRETCHES)
    for e in data.experiments:
        edges = [0, *_rest_cuts(e.y[:, 0], length), e.N]
        parts += [e.select(a, b) for a, b in itertools.pairwise(edges)]
    return data if len(parts) == len(data.lengths) else IOData.merge(*parts)


def _rest_cuts(y: np.ndarray, length: int) -> list[int]:
    """Samples (K,) where a new stretch begins: near equal lengths, where y (N,) moves least."""
    count = len(y) // length
    reach, half = round(_CUT_REACH * length), max(2, length // _STILL_SHARE)
    moves = np.convolve(np.abs(np.diff(y, prepend=y[0])), np.ones(2 * half + 1), "same")
    cuts = []
    for k in range(1, count):
        first = round(k * len(y) / count) - reach
        within = moves[first : first + 2 * reach]  # of readings with steps, so that many are alike
        cuts.append(first + int(order_of(within)[0]))
    return cuts
