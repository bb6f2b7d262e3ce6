"""A stationary point to many digits, the proof that a box holds one and no other, and the proof that it is the lowest.

Newton's method and intervals of mpmath at a chosen precision; the branch and bound is in doubles rounded outward.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from boxes import Boxes, slopes_of_boxes
from jets import Jet, KinkError, constant, parameters, slopes_of_intervals, slopes_of_reals
from mpmath import iv, mp
from systems import loss, outputs


@dataclass(frozen=True)
class Problem:
    """A record: blocks, values that are held, names that are free, and u, y (N,) as decimal text."""

    blocks: Sequence[Mapping[str, Any]]
    fixed: Mapping[str, str]
    names: Sequence[str]
    u: Sequence[str]
    y: Sequence[str]

    def theta(self, values: list[Any], number: Any, second: bool = True) -> dict[str, Jet]:
        """All parameters as jets by the free ones."""
        free = parameters(values, second)
        held = {name: constant(number(text), free[0]) for name, text in self.fixed.items()}
        return dict(zip(self.names, free, strict=True)) | held

    def loss(self, values: list[Any], number: Any, slopes: Any, second: bool = True) -> Jet:
        """Sum of squared errors; `number` makes one of its numbers from decimal text."""
        known = {
            text: number(text) for text in {*self.u, *self.y}
        }  # one object a number: a play knows that it is equal
        u, y = [known[text] for text in self.u], [known[text] for text in self.y]
        return loss(self.blocks, self.theta(values, number, second), u, y, slopes)


def growth(problem: Problem, values: Sequence[float]) -> float:
    """Decimal digits that intervals lose along a record: a filter multiplies widths by the sum of |f| in a sample."""
    lost, theta = 0.0, dict(zip(problem.names, values, strict=True)) | {k: float(v) for k, v in problem.fixed.items()}
    for block in problem.blocks:
        if block["kind"] == "transfer_function":
            total = sum(abs(theta[f"{block['role']}.f{j}"]) for j in range(1, block["nf"] + 1))
            lost += len(problem.u) * max(np.log10(max(total, 1e-9)), 0.0)
    return float(lost)


def polished(problem: Problem, values: Sequence[float], dps: int) -> tuple[list[Any], Jet]:
    """The stationary point by Newton's method at `dps` digits, and the loss there."""
    mp.dps = dps
    theta = [mp.mpf(float(v)) for v in values]
    for _ in range(12):
        at = problem.loss(theta, mp.mpf, slopes_of_reals)
        step = mp.lu_solve(_matrix(at.hessian), mp.matrix([-g for g in at.gradient]))
        theta = [t + d for t, d in zip(theta, step, strict=True)]
        if max(abs(d) / (abs(t) + mp.mpf(10) ** -20) for t, d in zip(theta, step, strict=True)) < mp.mpf(10) ** (
            5 - dps
        ):
            return theta, problem.loss(theta, mp.mpf, slopes_of_reals)
    raise ArithmeticError("Newton's method does not settle; give a better start")


def _matrix(rows: list[list[Any]]) -> Any:
    n = len(rows)
    return mp.matrix([[rows[max(i, j)][min(i, j)] or 0 for j in range(n)] for i in range(n)])


def deviations(problem: Problem, theta: list[Any]) -> tuple[list[Any], float]:
    """Standard deviations sqrt(rss / (N - n) diag (J'J)^-1) (n,), and the condition number of J with unit columns."""
    jets = problem.theta(theta, mp.mpf, second=False)
    u, y = [mp.mpf(t) for t in problem.u], [mp.mpf(t) for t in problem.y]
    yhat = outputs(problem.blocks, jets, u, slopes_of_reals)
    J = mp.matrix([[g or 0 for g in row.gradient] for row in yhat])
    rss = mp.fsum((row.value - v) ** 2 for row, v in zip(yhat, y, strict=True))
    inverse = (J.T * J) ** -1
    n = len(theta)
    unit = np.array(J.tolist(), dtype=float)
    condition = float(np.linalg.cond(unit / np.linalg.norm(unit, axis=0)))
    return [mp.sqrt(rss / (len(y) - n) * inverse[i, i]) for i in range(n)], condition


def krawczyk(problem: Problem, theta: list[Any], dps: int) -> Any:
    """The radius relative to each value of the widest box tried in which the proof succeeds.

    With F the gradient, Y the inverse of its derivative at the centre m and X the box: K = m - Y F(m) + (I - Y F'(X))
    (X - m) inside X proves that X holds exactly one point with F = 0 (Krawczyk 1969; Neumaier 1990, theorem 5.1.8).
    The pivots of an interval Cholesky factor of F'(X) are positive, so that this point is a minimum.
    """
    mp.dps = iv.dps = dps
    centre = problem.loss(theta, mp.mpf, slopes_of_reals)
    Y = _matrix(centre.hessian) ** -1
    exact = problem.loss([iv.mpf(t) for t in theta], iv.mpf, slopes_of_intervals)
    for power in range(3, dps - 12, 3):
        radius = mp.mpf(10) ** -power
        widths = [radius * (abs(t) or 1) for t in theta]
        try:
            around = problem.loss(
                [iv.mpf([t - w, t + w]) for t, w in zip(theta, widths, strict=True)], iv.mpf, slopes_of_intervals
            )
        except KinkError:
            continue
        if _contracts(Y, exact, around, widths) and _positive(around.hessian):
            return radius
    raise ArithmeticError("no box was proved; give more digits")


def _contracts(Y: Any, exact: Jet, around: Jet, widths: list[Any]) -> bool:
    n = len(widths)
    for i in range(n):
        total = -sum(iv.mpf(Y[i, k]) * exact.gradient[k] for k in range(n))
        for j in range(n):
            product = sum(iv.mpf(Y[i, k]) * _entry(around.hessian, k, j) for k in range(n))
            total = total + ((1 if i == j else 0) - product) * iv.mpf([-widths[j], widths[j]])
        if not (total.a > -widths[i] and total.b < widths[i]):
            return False
    return True


def _entry(rows: list[list[Any]], i: int, j: int) -> Any:
    value = rows[max(i, j)][min(i, j)]
    return iv.mpf(0) if value is None else value


def _positive(rows: list[list[Any]]) -> bool:
    """Whether every symmetric matrix of the box is positive definite: the pivots of Gauss's elimination are."""
    n = len(rows)
    A = [[_entry(rows, i, j) for j in range(n)] for i in range(n)]
    for k in range(n):
        if not A[k][k].a > 0:
            return False
        for i in range(k + 1, n):
            factor = A[i][k] / A[k][k]
            for j in range(k + 1, n):
                A[i][j] = A[i][j] - factor * A[k][j]
    return True


@dataclass(frozen=True)
class Lowest:
    """What the branch and bound proved: the domain, the half widths around the optimum where the loss is convex."""

    low: list[float]
    high: list[float]
    convex: list[float]
    boxes: int


def lowest(
    problem: Problem, theta: Sequence[float], spread: Sequence[float], low: Sequence[float], high: Sequence[float],
    most: int = 4_000_000,
) -> Lowest:  # fmt: skip
    """Proves that theta, a stationary point, has the lowest loss of a domain; raises ArithmeticError if it cannot.

    A box is left out if its loss is above that of theta (the natural and the mean-value bound), if a derivative has one
    sign there and the box does not touch the domain's face on the lower side, or if it lies in the region around theta
    where the Hessian is positive definite throughout: there theta is the only minimum.
    """
    theta, spread = np.asarray(theta, dtype=float), np.asarray(spread, dtype=float)
    low, high = np.asarray(low, dtype=float), np.asarray(high, dtype=float)
    top = float(_boxes(problem, theta[None], theta[None], False).value.hi[0])
    convex = _convex_region(problem, theta, spread, low, high)
    stack, count = [(low[None].copy(), high[None].copy())], 0
    while stack:
        lo, hi = stack.pop()
        if len(lo) > 4096:
            stack += [(lo[:-4096], hi[:-4096])]
            lo, hi = lo[-4096:], hi[-4096:]
        count += len(lo)
        if count > most:
            raise ArithmeticError(f"{most} boxes do not suffice")
        at = _boxes(problem, lo, hi, False)
        middle = 0.5 * (lo + hi)
        centre = _boxes(problem, middle, middle, False).value
        slack, smear, sided = centre, [], np.zeros(len(lo), dtype=bool)
        for i, g in enumerate(at.gradient):
            g = g if g is not None else Boxes(np.zeros(len(lo)))
            away = Boxes(np.nextafter(lo[:, i] - middle[:, i], -np.inf), np.nextafter(hi[:, i] - middle[:, i], np.inf))
            slack = slack + g * away
            smear.append((g.hi - g.lo) * (hi[:, i] - lo[:, i]) + 1e-9 * (hi[:, i] - lo[:, i]) / (high[i] - low[i]))
            sided |= ((g.lo > 0) & (lo[:, i] > low[i])) | ((g.hi < 0) & (hi[:, i] < high[i]))
        inside = np.all((lo >= theta - convex) & (hi <= theta + convex), axis=1)
        keep = ~((np.maximum(at.value.lo, slack.lo) > top) | sided | inside)
        lo, hi = lo[keep], hi[keep]
        if not len(lo):
            continue
        widest = np.argmax(np.array(smear)[:, keep], axis=0)
        rows = np.arange(len(lo))
        cut = 0.5 * (lo[rows, widest] + hi[rows, widest])
        if np.any((cut <= lo[rows, widest]) | (cut >= hi[rows, widest])):
            raise ArithmeticError("a box is as small as a number allows")
        left, right = hi.copy(), lo.copy()
        left[rows, widest], right[rows, widest] = cut, cut
        stack.append((np.concatenate([lo, right]), np.concatenate([left, hi])))
    return Lowest(low.tolist(), high.tolist(), convex.tolist(), count)


def _boxes(problem: Problem, lo: np.ndarray, hi: np.ndarray, second: bool) -> Jet:
    def number(text: str) -> Boxes:
        value = np.float64(text)
        return Boxes(np.nextafter(value, -np.inf), np.nextafter(value, np.inf))

    values = [Boxes(lo[:, i].copy(), hi[:, i].copy()) for i in range(lo.shape[1])]
    return problem.loss(values, number, _certain if second else slopes_of_boxes, second)


def _certain(x: Boxes, low: Boxes, high: Boxes) -> tuple:
    """`slopes_of_boxes`, with nan where a branch is not certain: such a box has no second derivative."""
    value, *weights = slopes_of_boxes(x, low, high)
    sure = np.all([w.lo == w.hi for w in weights], axis=0)
    return value, *(Boxes(np.where(sure, w.lo, np.nan), np.where(sure, w.hi, np.nan)) for w in weights)


def _convex_region(
    problem: Problem, theta: np.ndarray, spread: np.ndarray, low: np.ndarray, high: np.ndarray
) -> np.ndarray:
    """Half widths (n,) of a box around theta, in standard deviations, with a positive definite Hessian throughout."""
    n = len(theta)
    for size in 2.0 ** np.arange(3, -12, -1):
        half = np.minimum(size * spread, np.minimum(theta - low, high - theta))
        edges = [np.linspace(theta[i] - half[i], theta[i] + half[i], 9) for i in range(n)]
        corners = np.stack(np.meshgrid(*[np.arange(8)] * n, indexing="ij"), axis=-1).reshape(-1, n)
        lo = np.stack([edges[i][corners[:, i]] for i in range(n)], axis=1)
        hi = np.stack([edges[i][corners[:, i] + 1] for i in range(n)], axis=1)
        if np.all(_definite(_boxes(problem, lo, hi, True).hessian, len(lo))):
            return half * (1.0 - 1e-12)
    raise ArithmeticError("no region around the optimum is convex")


def _definite(rows: list[list[Any]], count: int) -> np.ndarray:
    """True (M,) where an interval matrix is positive definite, by Gauss's elimination; quotients bounded by hand."""
    n, sure = len(rows), np.ones(count, dtype=bool)
    A = [[rows[max(i, j)][min(i, j)] or Boxes(np.zeros(count)) for j in range(n)] for i in range(n)]
    with np.errstate(all="ignore"):
        for k in range(n):
            sure &= A[k][k].lo > 0
            inverse = Boxes(np.nextafter(1.0 / A[k][k].hi, -np.inf), np.nextafter(1.0 / A[k][k].lo, np.inf))
            for i in range(k + 1, n):
                for j in range(k + 1, n):
                    A[i][j] = A[i][j] - A[i][k] * inverse * A[k][j]
    return sure
