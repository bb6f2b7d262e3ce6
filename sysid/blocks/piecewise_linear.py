"""Piecewise linear map through free break points, end slopes extended."""

from dataclasses import dataclass

import numpy as np

from sysid.block import Slot, StaticBlock, Symmetry
from sysid.errors import InputError


@dataclass(frozen=True)
class PiecewiseLinear(StaticBlock):
    """Straight lines between `knots` break points (x_i, y_i), both free; 10 by default, as in the toolbox.

    Outside the outer knots the end slopes go on. The derivative at a knot is one-sided (that of the segment below).
    """

    knots: int = 10

    def __post_init__(self) -> None:
        if self.knots < 2:
            raise InputError(f"a piecewise linear map of {self.knots} break point(s) is no map; give at least 2")

    def slots(self) -> tuple[Slot, ...]:
        n = range(1, self.knots + 1)
        return (*(Slot(f"x{i}") for i in n), *(Slot(f"y{i}") for i in n))

    def evaluate(self, theta: np.ndarray, x: np.ndarray, J: np.ndarray, q: int) -> tuple[np.ndarray, np.ndarray]:
        from sysid.kernels import piecewise_linear

        y, slope = np.empty_like(x), np.empty_like(x)
        piecewise_linear(theta[: self.knots], theta[self.knots :], x, y, slope, J, q, J.shape[1] > 0)
        return y, slope

    def start(self, x: np.ndarray) -> np.ndarray:
        lo, hi = float(x.min()), float(x.max())
        knots = np.linspace(lo, hi if hi > lo else lo + 1.0, self.knots)
        return np.concatenate([knots, knots])

    def symmetries(self, theta: np.ndarray) -> list[Symmetry]:
        zero, one = np.zeros(self.knots), np.ones(self.knots)
        x, y = theta[: self.knots], theta[self.knots :]
        return [
            Symmetry(np.concatenate([x, zero]), in_scale=1.0),
            Symmetry(np.concatenate([one, zero]), in_shift=1.0),
            Symmetry(np.concatenate([zero, y]), out_scale=1.0),
            Symmetry(np.concatenate([zero, one]), out_shift=1.0),
            *(Symmetry(self._slide(theta, end)) for end in (0, -1)),
        ]

    def _slide(self, theta: np.ndarray, end: int) -> np.ndarray:
        """An outer knot may slide along its line: only the line counts, since it goes on beyond the knot."""
        x, y = theta[: self.knots], theta[self.knots :]
        i = end % self.knots
        a, b = (0, 1) if end == 0 else (self.knots - 2, self.knots - 1)
        d_theta = np.zeros_like(theta)
        d_theta[i], d_theta[self.knots + i] = 1.0, (y[b] - y[a]) / (x[b] - x[a])
        return d_theta

    def admissible(self, theta: np.ndarray) -> bool:
        gaps = np.diff(theta[: self.knots])
        # Knots that meet make a jump, and its slope a division by nothing.
        return bool(np.all(gaps > 1e-7 * (theta[self.knots - 1] - theta[0])))

    def vary(self, theta: np.ndarray, rng: np.random.Generator) -> np.ndarray:
        """Knots drawn anew over the same range, on the curve as it is."""
        x, y = theta[: self.knots], theta[self.knots :]
        inner = np.sort(rng.uniform(x[0], x[-1], self.knots - 2))
        fresh = np.concatenate([[x[0]], inner, [x[-1]]])
        fresh = 0.5 * fresh + 0.5 * np.linspace(x[0], x[-1], self.knots)  # keeps knots apart
        return np.concatenate([fresh, np.interp(fresh, x, y)])
