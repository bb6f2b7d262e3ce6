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

_USUAL = 10  # break points
_GAP = 0.01  # of the knots' span: nearer knots make a jump, and its slope says nothing beyond it


def line(x, p, block):
    """Straight lines through the points (p.kx, p.ky); the outer lines are unbounded."""
    i = 0
    for k in range(block.n - 2):
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
    """Straight lines between `knots` break points (x_i, y_i), both free.

    Without a number the record decides: a search with 10, as in the toolbox, then many at fixed places whose changes of
    slope have a prior (`Objective.knots`); and where a shape of few numbers says as much, that (`Objective.shapes`).
    Outside the outer knots the end slopes continue. The derivative at a knot is one-sided (that of the segment below).
    `at` gives the initial break points x_i; otherwise they are spread over the range of the data. With free_knots=False
    they are fixed and only the y_i are parameters (see `PiecewiseLinear.evenly_spaced`).
    """

    functions: ClassVar = {"value": value}
    centred: ClassVar = True

    knots: int | None = None
    free_knots: bool = True
    at: tuple[float, ...] = ()

    def __post_init__(self) -> None:
        if self.n < 2:
            raise InputError(f"a piecewise linear map has {self.n} break point(s); give at least 2")
        if not self.free_knots and not self.at:
            raise InputError(
                "fixed break points need values; give at=(x1, x2, ...) or use PiecewiseLinear.evenly_spaced(x)"
            )
        if self.at and (len(self.at) != self.n or not np.all(np.diff(self.at) > 0)):
            raise InputError(
                f"at holds {len(self.at)} values for {self.n} knots; give one for each knot, in rising order"
            )

    @property
    def n(self) -> int:
        """How many break points it has."""
        return (len(self.at) or _USUAL) if self.knots is None else self.knots

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
        n = range(1, self.n + 1)
        places = tuple(Slot(f"x{i}", knot=True) for i in n) if self.free_knots else ()
        return (*places, *(Slot(f"y{i}") for i in n))

    def _points(self, theta: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """x_i and y_i (knots,)."""
        return (theta[: self.n], theta[self.n :]) if self.free_knots else (np.array(self.at), theta)

    def evaluate(self, theta: np.ndarray, x: np.ndarray, J: np.ndarray, q: int) -> tuple[np.ndarray, np.ndarray]:
        from sysid.block.kernels import piecewise_linear

        y, slope, with_jacobian = np.empty_like(x), np.empty_like(x), J.shape[1] > 0
        kx, ky = self._points(theta)
        if with_jacobian and not self.free_knots:
            wide = np.empty((len(x), 2 * self.n))
            piecewise_linear(kx, ky, x, y, slope, wide, 0, with_jacobian)
            J[:, q : q + self.n] = wide[:, self.n :]
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
        knots = np.array(self.at) if self.at else np.linspace(lo, hi if hi > lo else lo + 1.0, self.n)
        return np.concatenate([knots, knots]) if self.free_knots else knots

    def kinks(self, theta: np.ndarray, tangent: bool = True) -> tuple[np.ndarray, np.ndarray]:
        """(s_{i+1} - s_i) / S at the inner knots, s_i the slopes and S the mean of their sizes."""
        x, y = self._points(theta)
        n, width = self.n, x[1:] - x[:-1]
        if not width.all():
            raise no_width(self, theta)
        s = (y[1:] - y[:-1]) / width
        S = float(np.mean(np.abs(s)))
        if n < 3 or S == 0.0:
            return super().kinks(theta)
        kink = (s[1:] - s[:-1]) / S
        if not tangent:
            return kink, np.zeros((n - 2, len(theta)))
        rows = np.arange(n - 1)
        ds = np.zeros((n - 1, 2 * n))
        ds[rows, rows], ds[rows, rows + 1] = s / width, -s / width
        ds[rows, n + rows], ds[rows, n + rows + 1] = -1.0 / width, 1.0 / width
        dS = np.sign(s) @ ds / (n - 1)
        d = (np.diff(ds, axis=0) - np.outer(kink, dS)) / S
        return kink, d if self.free_knots else d[:, n:]

    def coarser(self) -> "PiecewiseLinear | None":
        """Half the knots, which makes the search easier."""
        return replace(self, knots=self.n // 2) if self.free_knots and not self.at and self.n >= 8 else None

    def refine(self, theta: np.ndarray) -> np.ndarray:
        """New knots on the coarse curve, each in the middle of the widest remaining gap."""
        x, y = theta[: len(theta) // 2], theta[len(theta) // 2 :]
        fine = x
        while len(fine) < self.n:
            widest = int(np.argmax(np.diff(fine)))
            fine = np.insert(fine, widest + 1, 0.5 * (fine[widest] + fine[widest + 1]))
        return np.concatenate([fine, np.interp(fine, x, y)])

    def finer(self, theta: np.ndarray, x: np.ndarray, knots: int) -> "tuple[PiecewiseLinear, np.ndarray] | None":
        """Its own break points inside the range of x, its ends, and places that halve the widest gaps.

        None where their number or their places are given.
        """
        lo, hi = float(x.min()), float(x.max())
        if self.knots is not None or not self.free_knots or not lo < hi:
            return None
        x, gap = self._points(theta)[0], _GAP * (hi - lo)
        places = np.concatenate([[lo], x[(x > lo + gap) & (x < hi - gap)], [hi]])
        gaps, parts = np.diff(places), np.ones(len(places) - 1, dtype=int)
        while parts.sum() < knots - 1:  # equal ones together: a map that is turned round gets the same places
            parts += gaps / parts == np.max(gaps / parts)
        shares = [np.arange(n) / n for n in parts]
        steps = [a * (1.0 - s) + b * s for a, b, s in zip(places, places[1:], shares, strict=False)]
        places = np.concatenate([*steps, [hi]])
        return replace(self, free_knots=False, at=tuple(places.tolist())), self.output(theta, places)

    def asked(self) -> "PiecewiseLinear":
        return self if self.free_knots or self.knots is not None else replace(self, free_knots=True, at=())

    def slope_changes(self) -> np.ndarray:
        if self.free_knots or self.knots is not None:
            return super().slope_changes()
        slopes = np.diff(np.eye(self.n), axis=0) / np.diff(self.at)[:, None]
        return np.asarray(np.diff(slopes, axis=0))

    def wider(self, theta: np.ndarray) -> "tuple[PiecewiseLinear, np.ndarray, float] | None":
        if self.free_knots or self.knots is not None:
            return None
        lo, hi = self.at[0], self.at[-1]
        at = (2.0 * lo - hi, *self.at, 2.0 * hi - lo)
        mean_slope = float(np.sum(np.abs(np.diff(theta)))) / (hi - lo)
        return replace(self, at=at), self.output(theta, np.array(at)), mean_slope

    def law(self, a: np.ndarray, b: np.ndarray) -> Law | None:
        turned, n = bool(a[0] < 0.0), self.n
        places = np.sort(np.array(self.at) / a[0])
        M = diagonal(b[0], n, turned)
        if self.free_knots:
            M = block_diagonal(diagonal(a[0], n, turned), M)
        return Law(replace(self, at=tuple(places.tolist())), M)

    def symmetries(self, theta: np.ndarray) -> list[Symmetry]:
        zero, one = np.zeros(self.n), np.ones(self.n)
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
        x, y = theta[: self.n], theta[self.n :]
        i = end % self.n
        a, b = (0, 1) if end == 0 else (self.n - 2, self.n - 1)
        if x[a] == x[b]:
            raise no_width(self, theta)
        d_theta = np.zeros_like(theta)
        d_theta[i], d_theta[self.n + i] = 1.0, (y[b] - y[a]) / (x[b] - x[a])
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
        for i in range(1, self.n):
            repaired[i] = max(repaired[i], repaired[i - 1] + _GAP * span)
        return repaired

    def vary(self, theta: np.ndarray, rng: np.random.Generator) -> np.ndarray:
        """New random knots over the same range on the present curve; with fixed knots the values change at random."""
        x, y = self._points(theta)
        if not self.free_knots:
            return y + 0.1 * np.ptp(y) * rng.normal(size=self.n)
        inner = np.sort(rng.uniform(x[0], x[-1], self.n - 2))
        fresh = np.concatenate([[x[0]], inner, [x[-1]]])
        fresh = 0.5 * fresh + 0.5 * np.linspace(x[0], x[-1], self.n)  # keeps knots apart
        return np.concatenate([fresh, np.interp(fresh, x, y)])
