"""Monotone map over a stroke from 0 at one end stop to 1 at the other; the angles of the ends are parameters."""

from abc import abstractmethod
from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar

import numpy as np

from sysid.base.checks import checked
from sysid.base.errors import InputError
from sysid.block.block import Slot, StaticBlock
from sysid.block.compiler.recursion import Written
from sysid.block.symmetry import Symmetry
from sysid.block.writing import Writer
from sysid.blocks.cubic_spline import cubics, curve, spline_pieces
from sysid.blocks.piecewise_linear import line

_LEAST = 0.02  # of the mean slope: a segment that is flatter hides where the joint is


def value(x, p, block):
    if block.curved:
        return p.low + p.way * curve(x, p, block)
    return p.low + p.way * line(x, p, block)


class Travel(StaticBlock):
    """A map over a stroke from 0 to 1; `low` and `high`, its first two parameters, are the outputs at these ends."""

    @property
    @abstractmethod
    def is_line(self) -> bool:
        """Whether it is a line."""

    def symmetries(self, theta: np.ndarray) -> list[Symmetry]:
        shift = np.zeros(len(theta))
        shift[:2] = 1.0
        return [Symmetry(shift * theta, out_scale=1.0), Symmetry(shift, out_shift=1.0)]


@checked
@dataclass(frozen=True)
class TravelMap(Written, Travel):
    """y = low + (high - low) s(x) with s(0) = 0, s(1) = 1 and s increasing, piecewise linear on `knots` equal steps.

    It describes the linkage of an actuator. `low` and `high` are the outputs at the two ends; s_1, s_2, ... are the
    shares of the travel at the inner knots. With `smooth` s is the cubic spline through them, with linear
    extrapolation: the natural one, which is straight at both ends, or with `bent_ends` one that is bent as much there
    as beside them, as a linkage is. Where there are no data, the curvature weight of a fit keeps s straight.
    """

    functions: ClassVar = {"value": value}

    knots: int = 9
    smooth: bool = False
    bent_ends: bool = False

    def __post_init__(self) -> None:
        if self.knots < 2:
            raise InputError(f"a travel map has {self.knots} knot(s); give at least 2")
        if self.bent_ends and (self.knots < 4 or not self.smooth):
            raise InputError(
                f"bent ends need a smooth travel map of 4 knots, and this one has {self.knots} and smooth={self.smooth}"
                "; give smooth=True and more knots, or leave bent_ends out"
            )

    @property
    def is_line(self) -> bool:
        return self.knots == 2

    @property
    def n(self) -> int:
        """How many points its straight lines go through."""
        return self.knots

    def slots(self) -> tuple[Slot, ...]:
        inner = (Slot(f"s{i}", lower=0.0, upper=1.0) for i in range(1, self.knots - 1))
        return (Slot("low"), Slot("high"), *inner)

    def _shares(self, theta: np.ndarray) -> np.ndarray:
        return np.concatenate([[0.0], theta[2:], [1.0]])

    @cached_property
    def _pieces(self) -> np.ndarray:
        """Coefficients (knots - 1, 4, knots) of the basis curves of s, one for each share."""
        return spline_pieces(self.knots, self.bent_ends)

    def evaluate(self, theta: np.ndarray, x: np.ndarray, J: np.ndarray, q: int) -> tuple[np.ndarray, np.ndarray]:
        from sysid.block.kernels import piecewise_linear, spline

        low, high, knots = theta[0], theta[1], self.knots
        s, slope, with_jacobian = np.empty_like(x), np.empty_like(x), J.shape[1] > 0
        wide = np.empty((len(x), 2 * knots if with_jacobian else 0))
        if self.curved:
            spline(self._pieces, 0.0, 1.0, self._shares(theta), x, s, slope, wide, knots, with_jacobian, False)
        else:
            piecewise_linear(np.linspace(0.0, 1.0, knots), self._shares(theta), x, s, slope, wide, 0, with_jacobian)
        if with_jacobian:
            J[:, q], J[:, q + 1] = 1.0 - s, s
            J[:, q + 2 : q + knots] = (high - low) * wide[:, knots + 1 : 2 * knots - 1]
        return low + (high - low) * s, (high - low) * slope

    @property
    def curved(self) -> bool:
        """Whether s is curved between its knots; two knots give only a line."""
        return self.smooth and self.knots > 2

    def numbers(self, theta: np.ndarray) -> tuple[dict[str, float], dict[str, np.ndarray]]:
        shares = self._shares(theta)
        rows = {"kx": np.linspace(0.0, 1.0, self.knots), "ky": shares}
        rows["c"] = (self._pieces @ shares).ravel() if self.curved else np.empty(0)
        return {"low": theta[0], "way": theta[1] - theta[0], "lo": 0.0, "hi": 1.0}, rows

    def equations(self, theta: np.ndarray, w: Writer) -> list[str]:
        low, way, shares = theta[0], theta[1] - theta[0], self._shares(theta)
        if self.curved:
            return cubics(0.0, 1.0, way * (self._pieces @ shares) + [low, 0.0, 0.0, 0.0], w)
        return w.straight(np.linspace(0.0, 1.0, self.knots), low + way * shares)

    def start(self, x: np.ndarray) -> np.ndarray:
        return np.concatenate([[0.0, 1.0], np.linspace(0.0, 1.0, self.knots)[1:-1]])

    def admissible(self, theta: np.ndarray) -> bool:
        return bool(self._flattest(self._shares(theta)) >= 0.5 * _LEAST)

    def _flattest(self, shares: np.ndarray) -> float:
        """The smallest slope of s: over a segment, or for a curve at its ends or at its least slope."""
        m = self.knots - 1
        least = float(np.min(np.diff(shares))) * m
        if self.curved:
            c = self._pieces @ shares
            turn = np.divide(-c[:, 2], 3.0 * c[:, 3], out=np.zeros(m), where=c[:, 3] != 0.0).clip(0.0, 1.0)
            slopes = [c[:, 1] + t * (2.0 * c[:, 2] + t * 3.0 * c[:, 3]) for t in (0.0, 1.0, turn)]
            least = min(least, m * float(np.min(slopes)))
        return least

    def repair(self, theta: np.ndarray) -> np.ndarray:
        """If s falls or is almost flat, it is moved towards the straight line."""
        shares, line = self._shares(theta), np.linspace(0.0, 1.0, self.knots)
        if not np.all(np.isfinite(theta)) or self._flattest(shares) >= _LEAST:
            return theta
        steps = np.maximum(np.diff(shares), _LEAST / (self.knots - 1))
        shares = np.concatenate([[0.0], np.cumsum(steps / steps.sum())])
        for share in np.linspace(0.0, 1.0, 21):
            blend = (1.0 - share) * shares + share * line
            if self._flattest(blend) >= _LEAST:
                break
        return np.concatenate([theta[:2], blend[1:-1]])

    def kinks(self, theta: np.ndarray, tangent: bool = True) -> tuple[np.ndarray, np.ndarray]:
        """Change of slope at each inner knot, divided by the mean slope."""
        n = self.knots - 2
        d = np.zeros((n, len(theta)))
        for i in range(n):
            for j, weight in ((i - 1, 1.0), (i, -2.0), (i + 1, 1.0)):
                if 0 <= j < n:
                    d[i, 2 + j] = weight * (self.knots - 1)
        return np.diff(self._shares(theta), 2) * (self.knots - 1), d
