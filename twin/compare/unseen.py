"""What a log does not show of a joint, so that a comparison without a departure says nothing about it."""

import numpy as np

from sysid.base.quantities import display_quantity, number
from sysid.diagnosis.signals import rests
from twin.compare.departure import STILL, noise_of, speed_of

_NEAR = 0.02  # of the way between the ends: backlash and the sensor's curve let a joint at its end read so much less
_FULL = 0.9  # of the supply: a larger voltage is seen
_FEW = 2  # reversals, of which one more may be chance: below, backlash and friction show once or not at all


def unseen(u: np.ndarray, y: np.ndarray, Ts: float, ends: tuple[float, float], supply: float) -> tuple[str, ...]:
    """What inputs u (N,) [V] and angles y (N,) [rad] leave out for a joint with these `ends` [rad] and `supply` [V]."""
    unit, near = display_quantity("", "rad"), _NEAR * (ends[1] - ends[0]) + rests(y, noise_of(y)).band
    gaps = {"lower": float(y.min()) - ends[0], "upper": ends[1] - float(y.max())}
    texts = [
        f"the {end} end ({number(unit.factor * gap, 2)} {unit.unit} away)" for end, gap in gaps.items() if gap > near
    ]
    top = float(np.abs(u).max())
    if np.ptp(u) <= 1e-9 * top:
        texts.append(f"voltages other than {number(float(u[0]), 3)} V")
    elif top < _FULL * supply:
        texts.append(f"voltages beyond {number(top, 3)} V of {number(supply, 3)} V")
    return (*texts, *_unseen_motion(y, Ts))


def _unseen_motion(y: np.ndarray, Ts: float) -> list[str]:
    """Directions in which the joint never moves, or that it hardly reverses."""
    speed, uncertain = speed_of(y, Ts)
    least = max(STILL * float(np.quantile(np.abs(speed), 0.98)), 3.0 * uncertain)
    way = np.sign(speed[np.abs(speed) > least])
    missing = [f"{name} motion" for name, sign in (("upward", 1.0), ("downward", -1.0)) if sign not in way]
    count = int(np.sum(way[1:] != way[:-1]))
    if missing or count >= _FEW:
        return missing
    return ["more than one reversal"]
