"""Shapes of few numbers near a map of many break points, and what a fit with each of them would be.

The fit around its end is linear in the values of a map, and the other parameters follow these, so that a small
least-squares problem tells the errors that are left by a map of each shape.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from scipy.linalg import qr
from scipy.optimize import least_squares

from sysid.blocks import DeadZone, DeadZoneSaturation, Polynomial, Saturation
from sysid.blocks._shape import Shape
from sysid.estimation.problem import ChainProblem
from sysid.model.chain import Chain
from sysid.solver.linearisation import Linearisation

_DEGREES = (1, 2, 3)
_PLACES = {1: 24, 2: 12, 4: 8}  # of the break points that are tried as corners, by how many corners a shape has
_BEGUN = 3  # of them from which the corners move
SURE = 2.0 * np.log(20.0)  # of twice a logarithm of likelihoods: odds of 20 to 1
_DECADES = 100.0  # from 1 of the power of a signal: others leave the range of floating point
_WEAK = 1e-5  # of its size: how far a direction that the record does not show may go


@dataclass(frozen=True)
class LocalMap:
    """Errors of the fit near its end by the values v (m,) of one map: |z - S (v - values)|^2 + rest, by their variance.

    The places x (m,) are those of the map from `middle` by `half` of its range; v and `values` (m,) are by `size`.
    """

    x: np.ndarray
    values: np.ndarray
    S: np.ndarray
    z: np.ndarray
    rest: float
    N: int
    count: float  # effective number of parameters of the map
    middle: float
    half: float
    size: float

    @property
    def range(self) -> tuple[float, float]:
        """The range of the map's signal in the record."""
        return self.middle - self.half, self.middle + self.half

    @classmethod
    def of(
        cls, problem: ChainProblem, thetas: np.ndarray, lin: Linearisation, part: slice, at: tuple[float, ...]
    ) -> "LocalMap":
        """From the linearisation in all free parameters, with the prior on the others; `part` has the map's values."""
        prior, free, values = problem.prior, problem.chain.free, thetas[0, part]
        mine = np.zeros(len(lin.z), dtype=bool)
        mine[: int(free.sum())] = np.isin(np.flatnonzero(free), np.arange(part.start, part.stop))
        column = np.linalg.norm(lin.R, axis=0)
        column[column == 0.0] = 1.0
        weak, held = np.diag(np.where(mine, 0.0, _WEAK * column)), _held(problem.chain, thetas[0], mine, column)
        rows, own = [lin.R, weak, held / _WEAK], np.zeros((0, int(mine.sum())))
        e = [lin.z, np.zeros(len(weak) + len(held))]
        if prior is not None:
            wide = np.zeros((len(prior.weight), len(mine)))
            wide[:, : int(free.sum())] = prior.jacobian(problem.chain.basis[:, free])
            is_own = np.any(wide[:, mine], axis=1)
            rows.append(wide[~is_own])
            e.append(prior.errors(thetas[0])[~is_own])
            own = wide[is_own][:, mine]
        A = np.concatenate(rows)
        triangle = qr(np.column_stack([A[:, ~mine], A[:, mine], np.concatenate(e)]), mode="r")[0]
        m, end = int(mine.sum()), len(mine)
        S, z = triangle[end - m : end, end - m : end], triangle[end - m : end, end]
        rest = float(triangle[end, end] ** 2) + lin.cost - float(lin.z @ lin.z)
        both = np.linalg.lstsq(np.concatenate([S, own]), np.concatenate([S, 0.0 * own]), rcond=None)[0]
        middle, half, size = 0.5 * (at[0] + at[-1]), 0.5 * (at[-1] - at[0]), float(np.ptp(values)) or 1.0
        x, deviation = np.clip((np.array(at) - middle) / half, -1.0, 1.0), np.sqrt(lin.cost / lin.N)
        units = (values / size, S * (size / deviation), z / deviation, rest / deviation**2)
        return cls(x, *units, lin.N, float(np.trace(both)), middle, half, size)

    def errors(self, values: np.ndarray) -> np.ndarray:
        """z - S (v - values), (m,)."""
        return np.asarray(self.z - self.S @ (values - self.values))

    def cost(self, errors: np.ndarray) -> float:
        """N times the logarithm of the errors' variance by that of the fit: 0 for as good as the fit."""
        return float(self.N * np.log((self.rest + errors @ errors) / self.N))

    def best(self, columns: np.ndarray) -> np.ndarray:
        """The weights c (k,) of the columns (m, k) whose sum leaves the least errors."""
        return np.asarray(np.linalg.lstsq(self.S @ columns, self.z + self.S @ self.values, rcond=None)[0])

    def sharpest(self, n: int) -> list[float]:
        """The n inner places at which the slope changes most, in rising order."""
        change = np.abs(np.diff(np.diff(self.values) / np.diff(self.x)))
        return np.sort(self.x[1:-1][np.argsort(-change, kind="stable")[:n]]).tolist()

    def rank(self, columns: np.ndarray) -> int:
        """How many of the directions (m, k) of the values the record shows."""
        return int(np.linalg.matrix_rank(self.S @ columns))


def _held(chain: Chain, theta: np.ndarray, mine: np.ndarray, size: np.ndarray) -> np.ndarray:
    """Rows (g, n) of what the other parameters do where a change of the map and of these has no effect.

    The fit around its end takes a map of no size for as good as any, as long as the filter behind can be larger. `size`
    (n,) are the norms of the Jacobian's columns, so that the rows do not depend on units.
    """
    redundant = np.linalg.solve(chain.basis, chain.gauge(theta))[chain.free]
    wide = np.zeros((len(mine), redundant.shape[1]))
    wide[: len(redundant)] = redundant
    wide[mine] = 0.0
    return np.asarray(np.linalg.qr(size[:, None] * wide)[0].T * size)


@dataclass(frozen=True)
class Form:
    """A shape near a map, which is gain times the block's output and a level; the errors left, and what they show.

    `count` is how many of its numbers the record shows; `shown` whether it shows all corners.
    """

    block: Shape
    theta: np.ndarray
    gain: float
    level: float
    errors: np.ndarray
    count: int
    shown: bool


def promise(form: Form, local: LocalMap, has_filter: bool) -> float:
    """The change of BIC that the linearised fit tells of the map with this shape.

    With a filter before it the scale of the shape's input counts there already.
    """
    return local.cost(form.errors) + float((form.count - has_filter - local.count) * np.log(local.N))


def stands_alone(form: Form, local: LocalMap) -> bool:
    """Whether what goes on otherwise beyond the record is less likely by odds of 20 to 1, whatever its parameters.

    The rival is two lines that meet. A line has none: it goes on as break points do.
    """
    if isinstance(form.block, Polynomial) and form.block.degree == 1:
        return True
    return local.cost(_kinked(local)) - local.cost(form.errors) > SURE


def forms(local: LocalMap, role: str) -> Iterator[Form]:
    """Every shape with the numbers that bring it nearest, of those that have fewer than the record shows of the map."""
    found = local.range
    for degree in _DEGREES:
        if degree * abs(np.log10(max(abs(end) for end in found))) < _DECADES:
            yield _curved(local, Polynomial(degree, role=role, found=found))
    yield _cornered(local, Saturation(role=role, found=found), 2, gains=1)
    yield _cornered(local, DeadZone(role=role, found=found), 2, gains=1)
    yield _cornered(local, DeadZoneSaturation(role=role, found=found), 4, gains=2)


def _curved(local: LocalMap, block: Polynomial) -> Form:
    """The polynomial near the map."""
    columns = np.vander(local.x, block.degree + 1)
    c = local.best(columns)
    errors = local.errors(columns @ c)
    power = np.polynomial.Polynomial(c[::-1], domain=block.found, window=(-1.0, 1.0)).convert()
    theta = local.size * np.array(power.coef[::-1], dtype=float)
    theta = np.pad(theta, (block.degree + 1 - len(theta), 0))
    return Form(block, theta, 1.0, 0.0, errors, local.rank(columns), shown=True)


def _kinked(local: LocalMap) -> np.ndarray:
    """The least errors (m,) of two lines that meet: a shape with more corners must leave less."""

    def errors(q: np.ndarray) -> np.ndarray:
        columns = np.column_stack([np.ones_like(local.x), np.minimum(local.x - q, 0.0), np.maximum(local.x - q, 0.0)])
        return local.errors(columns @ local.best(columns))

    starts = [np.array([place]) for place in local.sharpest(_PLACES[1])]
    begun = sorted(starts, key=lambda q: float(np.sum(errors(q) ** 2)))[:_BEGUN]
    return np.asarray(min((least_squares(errors, q) for q in begun), key=lambda end: float(end.cost)).fun)


def _cornered(local: LocalMap, block: Shape, corners: int, gains: int) -> Form:
    """The shape with corners, gains and a level (q) near the map: from the best of many places, to the least errors.

    Both gains of two are the block's own; one is that of a filter beside it.
    """

    def curve(q: np.ndarray) -> np.ndarray:
        own = np.concatenate([np.sort(q[:corners]), q[corners:-1]])
        return q[-1] + (block.output(own, local.x) if gains == 2 else own[-1] * block.output(own[:-1], local.x))

    def errors(q: np.ndarray) -> np.ndarray:
        return local.errors(curve(q))

    def begun(places: tuple[float, ...]) -> np.ndarray:
        unit = [curve(np.array([*places, *row, 0.0])) for row in np.eye(gains)]
        return np.array([*places, *local.best(np.column_stack([*unit, np.ones_like(local.x)]))])

    begins = [begun(places) for places in combinations(local.sharpest(_PLACES[corners]), corners)]
    begins.sort(key=lambda q: float(np.sum(errors(q) ** 2)))
    bounds = [np.repeat([end, inf], [corners, gains + 1]) for end, inf in ((-1.0, -np.inf), (1.0, np.inf))]
    ends = [least_squares(errors, q, bounds=bounds) for q in begins[:_BEGUN]]
    end = min(ends, key=lambda end: float(end.cost))
    places, level = np.sort(end.x[:corners]), float(end.x[-1]) * local.size
    theta, slopes = local.middle + local.half * places, end.x[corners:-1] * local.size / local.half
    if isinstance(block, Saturation):  # counts from zero, and its places from the middle of the range
        level -= float(slopes[0]) * local.middle
    gain = float(slopes[np.argmax(np.abs(slopes))]) or 1.0
    theta = np.append(theta, slopes / gain) if gains == 2 else theta
    shown = bool(local.x[1] < places[0] and places[-1] < local.x[-2])
    return Form(block, theta, gain, level, end.fun, int(np.linalg.matrix_rank(end.jac)), shown)
