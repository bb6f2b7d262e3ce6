"""Cubic spline on equally spaced knots, natural or monotone, with linear extrapolation."""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import ClassVar

import numpy as np

from sysid.base.checks import checked
from sysid.base.errors import InputError
from sysid.block.block import Law, Slot, StaticBlock
from sysid.block.compiler.recursion import Written
from sysid.block.symmetry import Symmetry, block_diagonal, diagonal
from sysid.block.writing import Writer


def curve(x, p, block):
    """The curve with coefficients p.c, four per interval, between p.lo and p.hi; straight lines beyond."""
    m = block.knots - 1
    r = (x - p.lo) / (p.hi - p.lo)
    inside = min(max(r, 0.0), 1.0)
    i = int(min(inside * m, m - 1.0))
    v, beyond = inside * m - i, (r - inside) * m
    c1, c2, c3 = p.c[4 * i + 1], p.c[4 * i + 2], p.c[4 * i + 3]
    return p.c[4 * i] + v * (c1 + v * (c2 + v * c3)) + beyond * (c1 + v * (2.0 * c2 + v * 3.0 * c3))


def value(x, p, block):
    return curve(x, p, block)


def cubics(lo: float, hi: float, c: np.ndarray, w: Writer) -> list[str]:
    """One formula for each cubic c (m, 4) between lo and hi, and straight lines beyond."""
    edges = np.linspace(lo, hi, len(c) + 1)
    width = (hi - lo) / len(c)
    last = c[-1]
    slopes = (c[0, 1] / width, (last[1] + 2.0 * last[2] + 3.0 * last[3]) / width)
    curves = [w.sum([(c[0, 0], ""), (slopes[0], w.minus(lo))])]
    for piece, edge in zip(c, edges, strict=False):
        step = w.minus(edge)
        powers = [(piece[k] / width**k, "" if k == 0 else step if k == 1 else f"{step}^{k}") for k in range(4)]
        curves.append(w.sum(powers))
    curves.append(w.sum([(float(last.sum()), ""), (slopes[1], w.minus(hi))]))
    return w.pieces(edges, curves)


def spline_pieces(knots: int, bent_ends: bool = False) -> np.ndarray:
    """Coefficients (knots - 1, 4, knots) of the splines through 1 at one knot and 0 at the others, on [0, 1].

    Natural, straight at both ends, or with `bent_ends` one cubic over the two intervals at either end ("not a knot";
    de Boor 1978, A Practical Guide to Splines, chapter IV).
    """
    from scipy.interpolate import CubicSpline as Interpolant

    kind = "not-a-knot" if bent_ends else "natural"
    grid, powers = np.linspace(0.0, 1.0, knots), float(knots - 1) ** -np.arange(4)
    curves = [Interpolant(grid, row, bc_type=kind).c for row in np.eye(knots)]
    return np.ascontiguousarray(np.stack([c[::-1].T * powers for c in curves], axis=2))


@checked
@dataclass(frozen=True)
class CubicSpline(Written, StaticBlock):
    """Twice differentiable curve over [lo, hi] with `knots` equally spaced knots, continued by its end tangents.

    Natural: through the values y_i at the knots. Monotone: y0 + sum s_i I_i with s_i >= 0, where the I_i are I-splines
    (Ramsay 1988, Statistical Science 3): integrals of quadratic B-splines, so that the slope over [lo, hi] is never
    negative. y increases; the next block's gain makes a falling map. lo and hi are parameters, or fixed if `span`
    gives them.
    """

    functions: ClassVar = {"value": value}
    centred: ClassVar = True

    knots: int = 8
    monotone: bool = False
    span: tuple[float, float] | None = None

    def __post_init__(self) -> None:
        if self.knots < 3:
            raise InputError(f"a cubic spline of {self.knots} knots is a line; give at least 3")
        if self.span is not None and not self.span[0] < self.span[1]:
            raise InputError(f"span is {self.span}; give (lowest, highest) knot, the first below the second")

    def slots(self) -> tuple[Slot, ...]:
        ends = (Slot("lo"), Slot("hi")) if self.span is None else ()
        if not self.monotone:
            return (*ends, *(Slot(f"y{i}") for i in range(1, self.knots + 1)))
        return (*ends, Slot("y0"), *(Slot(f"s{i}", lower=0.0) for i in range(1, self.knots + 2)))

    @cached_property
    def pieces(self) -> np.ndarray:
        """Coefficients (knots - 1, 4, n) of the curve's functions on [0, 1], as `kernels_maps.spline` takes them."""
        from scipy.interpolate import BSpline, PPoly

        if not self.monotone:
            return spline_pieces(self.knots)
        m, grid = self.knots - 1, np.linspace(0.0, 1.0, self.knots)
        clamped = np.concatenate([[0.0, 0.0], grid, [1.0, 1.0]])
        bumps = [BSpline(clamped, row, 2).antiderivative() for row in np.eye(self.knots + 1)]
        # The clamped ends make intervals of no length: only those between the m + 1 knots count.
        curves = [np.array([[0.0], [0.0], [0.0], [1.0]]) * np.ones(m)]
        curves += [PPoly.from_spline(bump).c[:, 3 : 3 + m] for bump in bumps]
        powers = float(m) ** -np.arange(4)
        return np.ascontiguousarray(np.stack([c[::-1].T * powers for c in curves], axis=2))

    def _ends(self, theta: np.ndarray) -> tuple[float, float, np.ndarray]:
        """lo, hi and the other parameters."""
        return (*self.span, theta) if self.span is not None else (theta[0], theta[1], theta[2:])

    def evaluate(self, theta: np.ndarray, x: np.ndarray, J: np.ndarray, q: int) -> tuple[np.ndarray, np.ndarray]:
        from sysid.block.kernels import spline

        y, slope = np.empty_like(x), np.empty_like(x)
        lo, hi, v = self._ends(theta)
        spline(self.pieces, lo, hi, v, x, y, slope, J, q, J.shape[1] > 0, self.span is None)
        return y, slope

    def numbers(self, theta: np.ndarray) -> tuple[dict[str, float], dict[str, np.ndarray]]:
        lo, hi, values = self._ends(theta)
        return {"lo": lo, "hi": hi}, {"c": (self.pieces @ values).ravel()}

    def equations(self, theta: np.ndarray, w: Writer) -> list[str]:
        lo, hi, values = self._ends(theta)
        return cubics(lo, hi, self.pieces @ values, w)

    def start(self, x: np.ndarray) -> np.ndarray:
        """The line y = x over the range of x, or over `span`."""
        lo, hi = self.span if self.span is not None else (float(x.min()), float(x.max()))
        hi = hi if hi > lo else lo + 1.0
        ends = [] if self.span is not None else [lo, hi]
        if self.monotone:
            return np.concatenate([ends, [lo], np.full(self.knots + 1, hi - lo)])
        return np.concatenate([ends, np.linspace(lo, hi, self.knots)])

    def law(self, a: np.ndarray, b: np.ndarray) -> Law | None:
        turned, n = bool(a[0] < 0.0), self.knots
        span = None
        if self.span is not None:
            low, high = sorted(float(end / a[0]) for end in self.span)
            span = (low, high)
        ends = np.eye(0) if self.span is not None else diagonal(a[0], 2, turned)
        if not self.monotone:
            return Law(replace(self, span=span), block_diagonal(ends, diagonal(b[0], n, turned)))
        if a[0] * b[0] < 0.0:
            return None  # it rises in any units
        M = block_diagonal(b[:, None], diagonal(abs(b[0]), n + 1, turned))
        if turned:  # y0 is the curve at the other end
            M[0, 1:] = b[0] * self.pieces[-1].sum(axis=0)[1:]
        return Law(replace(self, span=span), block_diagonal(ends, M))

    def symmetries(self, theta: np.ndarray) -> list[Symmetry]:
        lo, hi, v = self._ends(theta)
        constant = np.eye(len(v))[0] if self.monotone else np.ones(len(v))
        none, ends = np.zeros(len(theta) - len(v)), np.array([lo, hi])
        changes = [
            Symmetry(np.concatenate([none, v]), out_scale=1.0),
            Symmetry(np.concatenate([none, constant]), out_shift=1.0),
        ]
        if self.span is None:
            changes += [
                Symmetry(np.concatenate([ends, 0.0 * v]), in_scale=1.0),
                Symmetry(np.concatenate([np.ones(2), 0.0 * v]), in_shift=1.0),
            ]
        return changes

    def admissible(self, theta: np.ndarray) -> bool:
        lo, hi, v = self._ends(theta)
        return bool(lo < hi and (not self.monotone or np.all(v[1:] >= 0.0)))

    def repair(self, theta: np.ndarray) -> np.ndarray:
        if not self.monotone:
            return theta
        fixed = theta.copy()
        fixed[-self.knots - 1 :] = np.maximum(fixed[-self.knots - 1 :], 0.0)
        return fixed

    def vary(self, theta: np.ndarray, rng: np.random.Generator) -> np.ndarray:
        """The curve changed at random; a monotone one stays monotone."""
        fresh, n = theta.copy(), self.knots + 1
        if self.monotone:
            fresh[-n:] *= np.exp(rng.uniform(-1.0, 1.0, n))
        else:
            fresh[-self.knots :] += 0.1 * np.ptp(theta[-self.knots :]) * rng.normal(size=self.knots)
        return fresh
