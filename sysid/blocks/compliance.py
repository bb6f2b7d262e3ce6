"""Compliance: a link that hangs on its drive by a spring and a damper."""

from dataclasses import dataclass
from math import cos, exp, sin, sqrt
from typing import ClassVar

import numpy as np

from sysid.base.checks import checked
from sysid.block.block import Slot
from sysid.block.compiler.recursion import Recursion
from sysid.block.symmetry import Symmetry
from sysid.block.writing import Writer

_SLOWEST, _FASTEST = 1e-3, 30.0  # rad/sample; the fastest swings five times between two samples
_MOST = 20.0  # damping ratio
NEAR = 1e-4  # rad^2; square of the frequency below which a series takes the place of sine and hyperbolic sine


def begin(s, x, p):
    s.drive = x
    s.position, s.speed = x + p.lead0, p.speed0


def step(s, x, p):
    decay = p.damping * p.omega
    rate = x - s.drive
    # About what follows the ramp of the drive for ever: x - 2 damping rate / omega.
    lag = 2.0 * p.damping * rate / p.omega
    e, v = s.position - s.drive + lag, s.speed - rate
    square = p.omega * p.omega - decay * decay
    if square > NEAR:
        w = sqrt(square)
        c, d = exp(-decay) * cos(w), exp(-decay) * sin(w) / w
    elif square < -NEAR:
        w = sqrt(-square)
        slow, fast = exp(w - decay), exp(-w - decay)
        c, d = 0.5 * (slow + fast), 0.5 * (slow - fast) / w
    else:
        c = exp(-decay) * (1.0 - square * (0.5 - square / 24.0))
        d = exp(-decay) * (1.0 - square * (1.0 / 6.0 - square / 120.0))
    if s.fresh == 0.0:  # the first sample is where the motion begins
        s.fresh = 1.0
    else:
        s.position = x - lag + e * c + (v + decay * e) * d
        s.speed = rate + v * c - (decay * v + p.omega * p.omega * e) * d
    s.drive = x
    return s.position


@checked
@dataclass(frozen=True)
class Compliance(Recursion):
    """y'' + 2 damping omega y' + omega^2 y = omega^2 x: a link y on a spring behind its drive x; time in samples.

    A high gear ratio keeps the link's force from the drive: of two masses only the second swings, against a damper in
    its bearing. The solution is exact for x that is linear between the samples. The link begins where the drive is, or
    `lead0` ahead of it, at `speed0`. Use it where the output swings after the drive has stopped.
    """

    functions: ClassVar = {"step": step, "begin": begin}

    def slots(self) -> tuple[Slot, ...]:
        return (
            Slot("omega", "rad/sample", lower=_SLOWEST, upper=_FASTEST),
            Slot("damping", lower=0.0, upper=_MOST),
            Slot("lead0", initial=True),
            Slot("speed0", "1/sample", initial=True),
        )

    def start(self, x: np.ndarray) -> np.ndarray:
        """A link that swings once in ten samples."""
        return np.array([0.6, 0.3, 0.0, 0.0])

    def admissible(self, theta: np.ndarray) -> bool:
        return bool(_SLOWEST <= theta[0] <= _FASTEST and 0.0 <= theta[1] <= _MOST)

    def equations(self, theta: np.ndarray, w: Writer) -> list[str]:
        m = self.by_name(theta)
        square = w.num(m["omega"] ** 2)
        return [
            f"{w.y}'' + {w.num(2.0 * m['damping'] * m['omega'])}*{w.y}' = {square}*({w.x} - {w.y}), time in samples",
            f"  {w.x} is linear between samples; between them the motion is solved exactly",
        ]

    def symmetries(self, theta: np.ndarray) -> list[Symmetry]:
        grows = np.array([0.0, 0.0, theta[2], theta[3]])
        return [Symmetry(grows, in_scale=1.0, out_scale=1.0), Symmetry(np.zeros(4), in_shift=1.0, out_shift=1.0)]

    def vary(self, theta: np.ndarray, rng: np.random.Generator) -> np.ndarray:
        """Frequency and damping changed by a factor of up to about two."""
        start = theta * np.exp([0.5, 0.5, 0.0, 0.0] * rng.normal(size=4))
        return np.clip(start, [_SLOWEST, 0.0, -np.inf, -np.inf], [_FASTEST, _MOST, np.inf, np.inf])
