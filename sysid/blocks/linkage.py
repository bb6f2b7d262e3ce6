"""Linkage of an actuator that is one side of a triangle: exact, with three numbers, also near a dead centre."""

from dataclasses import dataclass
from math import acos, cos, pi, sin, sqrt
from typing import ClassVar

import numpy as np

from sysid.base.checks import checked
from sysid.base.errors import InputError
from sysid.block.block import Slot
from sysid.block.compiler.recursion import Map
from sysid.blocks.travel_map import Travel

SHAPE = ("angle0", "angle1", "stroke")
_NEAREST = 0.02  # rad of a dead centre, where the slope has no bound
_LEAST = 0.05  # rad of a swing: a shorter one is a straight line
_MOST = np.pi - _NEAREST
SHAPE_SLOTS = (
    Slot("angle0", "rad", _NEAREST, _MOST - _LEAST),
    Slot("angle1", "rad", _NEAREST + _LEAST, _MOST),
    Slot("stroke", lower=-1.9, upper=1.9),
)
_KINKS = 8
_PLACES = np.linspace(0.0, 1.0, 101)


def cosine_at(x, p):
    """Of the enclosed angle, by the law of cosines."""
    h = x - 0.5 * p.stroke * x * (1.0 - x)
    return cos(p.angle0) - h * (cos(p.angle0) - cos(p.angle1))


def share_of(cosine, p):
    """What of the swing the angle with this cosine is past its start."""
    return (acos(cosine) - p.angle0) / (p.angle1 - p.angle0)


def slope_at(x, cosine, p):
    """Of that share over the stroke."""
    reach = cos(p.angle0) - cos(p.angle1)
    return reach * (1.0 + p.stroke * (x - 0.5)) / ((p.angle1 - p.angle0) * sqrt(1.0 - cosine * cosine))


def value(x, p, block):
    inside = min(max(x, 0.0), 1.0)
    cosine = cosine_at(inside, p)
    s = share_of(cosine, p) + (x - inside) * slope_at(inside, cosine, p)
    for k in range(block.bends):
        wave = (k + 1) * pi
        s += p.d[k] * (sin(wave * inside) + (x - inside) * wave * cos(wave * inside))
    return p.low + (p.high - p.low) * s


@checked
@dataclass(frozen=True)
class Linkage(Map, Travel):
    """y = low + (high - low) s(x): the angle of a triangle whose side opposite it is an actuator, x of its stroke out.

    With the enclosed angles `angle0` and `angle1` [rad] at x = 0 and 1, s = (a(x) - angle0) / (angle1 - angle0) and by
    the law of cosines cos a = (1 - h) cos angle0 + h cos angle1, h = x - stroke x (1 - x) / 2. `stroke` is the stroke
    by the actuator's mean length; it is negative where the actuator retracts as x rises. A straight linkage is the
    limit of a small swing. Beyond its ends s goes on straight. d_1, ..., d_bends are what a real linkage is off by:
    s + d_k sin(k pi x).
    """

    functions: ClassVar = {"value": value}

    bends: int = 0

    def __post_init__(self) -> None:
        if self.bends < 0:
            raise InputError(f"a linkage has {self.bends} bends; give 0 or more")

    @property
    def is_line(self) -> bool:
        return False

    def slots(self) -> tuple[Slot, ...]:
        return (Slot("low"), Slot("high"), *SHAPE_SLOTS, *(Slot(f"d{k}") for k in range(1, self.bends + 1)))

    def start(self, x: np.ndarray) -> np.ndarray:
        return np.array([0.0, 1.0, 0.8, 2.3, 0.0, *np.zeros(self.bends)])

    def admissible(self, theta: np.ndarray) -> bool:
        return bool(theta[3] - theta[2] >= 0.999 * _LEAST and np.all(self._steps(theta) > 0.0))

    def _steps(self, theta: np.ndarray) -> np.ndarray:
        """What s grows by between places over the stroke; it is monotone without bends."""
        return np.diff(self.output(np.array([0.0, 1.0, *theta[2:]]), _PLACES)) if self.bends else np.ones(1)

    def repair(self, theta: np.ndarray) -> np.ndarray:
        """Angles that are too near are set apart around their middle, and bends taken back until s rises."""
        if not np.all(np.isfinite(theta)):
            return theta
        fixed = theta.copy()
        if theta[3] - theta[2] < _LEAST:
            middle = np.clip(0.5 * (theta[2] + theta[3]), _NEAREST + 0.5 * _LEAST, np.pi - _NEAREST - 0.5 * _LEAST)
            fixed[2:4] = middle - 0.5 * _LEAST, middle + 0.5 * _LEAST
        while not np.all(self._steps(fixed) > 0.0):
            fixed[5:] = 0.5 * fixed[5:] if np.abs(fixed[5:]).max() > 1e-6 else 0.0
        return fixed

    def kinks(self, theta: np.ndarray, tangent: bool = True) -> tuple[np.ndarray, np.ndarray]:
        """Change of slope of s over `_KINKS` equal steps, as of a travel map: what no data show is nearly straight."""
        J = np.zeros((_KINKS + 1, len(theta) if tangent else 0))
        s, _ = self.evaluate(np.array([0.0, 1.0, *theta[2:]]), np.linspace(0.0, 1.0, _KINKS + 1), J, 0)
        d = np.diff(J, 2, axis=0) * _KINKS if tangent else np.zeros((_KINKS - 1, len(theta)))
        d[:, :2] = 0.0
        return np.diff(s, 2) * _KINKS, d

    def vary(self, theta: np.ndarray, rng: np.random.Generator) -> np.ndarray:
        middle, swing = 0.5 * np.pi + 0.4 * rng.normal(), np.exp(rng.uniform(*np.log([0.3, 2.0])))
        ends = np.clip([middle - 0.5 * swing, middle + 0.5 * swing], _NEAREST, np.pi - _NEAREST)
        return np.array([*theta[:2], *ends, rng.uniform(-0.7, 0.7), *theta[5:]])
