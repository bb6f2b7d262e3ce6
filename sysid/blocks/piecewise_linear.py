"""Piecewise linear map through free break points, with linear extrapolation."""

from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from sysid.base.checks import checked
from sysid.base.errors import InputError
from sysid.block.block import Law, Slot, StaticBlock, no_width
from sysid.block.compiler.recursion import Written
from sysid.block.symmetry import Symmetry, block_diagonal, diagonal
from sysid.block.writing import Writer

_GAP = 0.01  # of the knots' span: nearer knots make a jump, and its slope says nothing beyond it


def line(x, p, block):
    """Straight lines through the points (p.kx, p.ky); the outer lines are unbounded."""
    i = 0
    for k in range(block.knots - 2):
        if x <= p.kx[k + 1]:
            break
        i = k + 1
    r = (x - p.kx[i]) / (p.kx[i + 1] - p.kx[i])
    return p.ky[i] + r * (p.ky[i + 1] - p.ky[i])


def value(x, p, block):
    return line(x, p, block)


@checked
@dataclass(frozen=True)
class PiecewiseLinear(Written, StaticBlock):
    """Straight lines between `knots` break points (x_i, y_i), both free; 10 by default, as in the toolbox.

    Outside the outer knots the end slopes continue. The derivative at a knot is one-sided (that of the segment below).
    `at` gives the initial break points x_i; otherwise they are spread over the range of the data. With free_knots=False
    they are fixed and only the y_i are parameters (see `PiecewiseLinear.evenly_spaced`).
    """

    functions: ClassVar = {"value": value}
    centred: ClassVar = True

    knots: int = 10
    free_knots: bool = True
    at: tuple[float, ...] = ()

    def __post_init__(self) -> None:
        if self.knots < 2:
            raise InputError(f"a piecewise linear map has {self.knots} break point(s); give at least 2")
        if not self.free_knots and not self.at:
            raise InputError(
                "fixed break points need values; give at=(x1, x2, ...) or use PiecewiseLinear.evenly_spaced(x)"
            )
        if self.at and (len(self.at) != self.knots or not np.all(np.diff(self.at) > 0)):
            raise InputError(
                f"at holds {len(self.at)} values for {self.knots} knots; give one for each knot, in rising order"
            )

    @classmethod
    @checked
    def evenly_spaced(cls, x: np.ndarray, knots: int = 10, role: str = "block") -> "PiecewiseLinear":
        """Fixed knots, equally spaced over the range of x (N,)."""
        x = np.asarray(x, dtype=float)
        if not x.size:
            raise InputError("x has no samples; give the input whose range the knots cover")
        lo, hi = float(x.min()), float(x.max())
        spread = np.linspace(lo, hi if hi > lo else lo + 1.0, knots)
        return cls(knots, free_knots=False, at=tuple(spread.tolist()), role=role)

    def slots(self) -> tuple[Slot, ...]:
        n = range(1, self.knots + 1)
        places = tuple(Slot(f"x{i}", knot=True) for i in n) if self.free_knots else ()
        return (*places, *(Slot(f"y{i}") for i in n))

    def _points(self, theta: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """x_i and y_i (knots,)."""
        return (theta[: self.knots], theta[self.knots :]) if self.free_knots else (np.array(self.at), theta)

    def evaluate(self, theta: np.ndarray, x: np.ndarray, J: np.ndarray, q: int) -> tuple[np.ndarray, np.ndarray]:
        from sysid.block.kernels import piecewise_linear

        y, slope, with_jacobian = np.empty_like(x), np.empty_like(x), J.shape[1] > 0
        kx, ky = self._points(theta)
        if with_jacobian and not self.free_knots:
            wide = np.empty((len(x), 2 * self.knots))
            piecewise_linear(kx, ky, x, y, slope, wide, 0, with_jacobian)
            J[:, q : q + self.knots] = wide[:, self.knots :]
        else:
            piecewise_linear(kx, ky, x, y, slope, J, q, with_jacobian)
        return y, slope

    def numbers(self, theta: np.ndarray) -> tuple[dict[str, float], dict[str, np.ndarray]]:
        kx, ky = self._points(theta)
        return {}, {"kx": kx, "ky": ky}

    def equations(self, theta: np.ndarray, w: Writer) -> list[str]:
        return w.straight(*self._points(theta))

    def start(self, x: np.ndarray) -> np.ndarray:
        lo, hi = float(x.min()), float(x.max())
        knots = np.array(self.at) if self.at else np.linspace(lo, hi if hi > lo else lo + 1.0, self.knots)
        return np.concatenate([knots, knots]) if self.free_knots else knots

    def kinks(self, theta: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """(s_{i+1} - s_i) / S at the inner knots, s_i the slopes and S the mean of their sizes."""
        x, y = self._points(theta)
        n, width = self.knots, np.diff(x)
        if not np.all(width):
            raise no_width(self, theta)
        s = np.diff(y) / width
        rows = np.arange(n - 1)
        ds = np.zeros((n - 1, 2 * n))
        ds[rows, rows], ds[rows, rows + 1] = s / width, -s / width
        ds[rows, n + rows], ds[rows, n + rows + 1] = -1.0 / width, 1.0 / width
        S = float(np.mean(np.abs(s)))
        if n < 3 or S == 0.0:
            return super().kinks(theta)
        kink, dS = np.diff(s) / S, np.sign(s) @ ds / (n - 1)
        d = (np.diff(ds, axis=0) - np.outer(kink, dS)) / S
        return kink, d if self.free_knots else d[:, n:]

    def coarser(self) -> "PiecewiseLinear | None":
        """Half the knots, which makes the search easier."""
        return replace(self, knots=self.knots // 2) if self.free_knots and not self.at and self.knots >= 8 else None

    def refine(self, theta: np.ndarray) -> np.ndarray:
        """New knots on the coarse curve, each in the middle of the widest remaining gap."""
        x, y = theta[: len(theta) // 2], theta[len(theta) // 2 :]
        fine = x
        while len(fine) < self.knots:
            widest = int(np.argmax(np.diff(fine)))
            fine = np.insert(fine, widest + 1, 0.5 * (fine[widest] + fine[widest + 1]))
        return np.concatenate([fine, np.interp(fine, x, y)])

    def finer(self, theta: np.ndarray, x: np.ndarray, knots: int) -> "tuple[PiecewiseLinear, np.ndarray]":
        """Its own break points inside the range of x, its ends, and places that halve the widest gaps.

        Where the places are given they stay.
        """
        lo, hi = float(x.min()), float(x.max())
        if not self.free_knots or not lo < hi:
            return self, theta
        gap = _GAP * (hi - lo)
        places = [lo]
        for place in self._points(theta)[0].tolist():
            if place > places[-1] + gap and place < hi - gap:
                places.append(place)
        places.append(hi)
        while len(places) < knots:
            widest = int(np.argmax(np.diff(places)))
            places.insert(widest + 1, 0.5 * (places[widest] + places[widest + 1]))
        block = replace(self, knots=len(places), free_knots=False, at=tuple(places))
        return block, self.output(theta, np.array(places))

    def slope_changes(self) -> np.ndarray:
        if self.free_knots:
            return super().slope_changes()
        slopes = np.diff(np.eye(self.knots), axis=0) / np.diff(self.at)[:, None]
        return np.asarray(np.diff(slopes, axis=0))

    def law(self, a: np.ndarray, b: np.ndarray) -> Law | None:
        turned, n = bool(a[0] < 0.0), self.knots
        places = np.sort(np.array(self.at) / a[0])
        M = diagonal(b[0], n, turned)
        if self.free_knots:
            M = block_diagonal(diagonal(a[0], n, turned), M)
        return Law(replace(self, at=tuple(places.tolist())), M)

    def symmetries(self, theta: np.ndarray) -> list[Symmetry]:
        zero, one = np.zeros(self.knots), np.ones(self.knots)
        x, y = self._points(theta)
        if not self.free_knots:
            return [Symmetry(y.copy(), out_scale=1.0), Symmetry(one, out_shift=1.0)]
        return [
            Symmetry(np.concatenate([x, zero]), in_scale=1.0),
            Symmetry(np.concatenate([one, zero]), in_shift=1.0),
            Symmetry(np.concatenate([zero, y]), out_scale=1.0),
            Symmetry(np.concatenate([zero, one]), out_shift=1.0),
            *(Symmetry(self._slide(theta, end)) for end in (0, -1)),
        ]

    def _slide(self, theta: np.ndarray, end: int) -> np.ndarray:
        """An outer knot may move along its line without effect, because the line continues beyond the knot."""
        x, y = theta[: self.knots], theta[self.knots :]
        i = end % self.knots
        a, b = (0, 1) if end == 0 else (self.knots - 2, self.knots - 1)
        if x[a] == x[b]:
            raise no_width(self, theta)
        d_theta = np.zeros_like(theta)
        d_theta[i], d_theta[self.knots + i] = 1.0, (y[b] - y[a]) / (x[b] - x[a])
        return d_theta

    def admissible(self, theta: np.ndarray) -> bool:
        x, _ = self._points(theta)
        return not self.free_knots or bool(np.all(np.diff(x) > 0.5 * _GAP * (x[-1] - x[0])))

    def repair(self, theta: np.ndarray) -> np.ndarray:
        """Knots closer than `_GAP` of their span, or in the wrong order, are set that far apart."""
        x, _ = self._points(theta)
        span = x[-1] - x[0]
        if not self.free_knots or not span > 0 or np.all(np.diff(x) >= _GAP * span):
            return theta
        repaired = theta.copy()
        for i in range(1, self.knots):
            repaired[i] = max(repaired[i], repaired[i - 1] + _GAP * span)
        return repaired

    def vary(self, theta: np.ndarray, rng: np.random.Generator) -> np.ndarray:
        """New random knots over the same range on the present curve; with fixed knots the values change at random."""
        x, y = self._points(theta)
        if not self.free_knots:
            return y + 0.1 * np.ptp(y) * rng.normal(size=self.knots)
        inner = np.sort(rng.uniform(x[0], x[-1], self.knots - 2))
        fresh = np.concatenate([[x[0]], inner, [x[-1]]])
        fresh = 0.5 * fresh + 0.5 * np.linspace(x[0], x[-1], self.knots)  # keeps knots apart
        return np.concatenate([fresh, np.interp(fresh, x, y)])
