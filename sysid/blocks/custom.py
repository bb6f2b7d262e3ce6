"""A static map given by the user as a function."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from sysid.base.checks import checked
from sysid.base.errors import InputError
from sysid.block.block import Law, Slot, StaticBlock
from sysid.block.symmetry import Symmetry

_STEP = float(np.finfo(float).eps) ** (1.0 / 3.0)  # of central differences, relative to the size of the variable


@checked
@dataclass(frozen=True)
class Custom(StaticBlock):
    """y = f(x, theta) for x (N,) and theta (p,) with `names` and start values `initial`.

    slope(x, theta) -> df/dx (N,) and jacobian(x, theta) -> df/dtheta (N, p) are central differences if not given:
    relative accuracy about 1e-9, two calls per variable. `lower`, `upper` (p,) are bounds. `span` is the range of x
    over which `symmetries` searches gains and offsets that a neighbouring block could represent.
    """

    f: Callable[[np.ndarray, np.ndarray], np.ndarray]
    names: tuple[str, ...] = ()
    initial: tuple[float, ...] = ()
    slope: Callable[[np.ndarray, np.ndarray], np.ndarray] | None = None
    jacobian: Callable[[np.ndarray, np.ndarray], np.ndarray] | None = None
    lower: tuple[float, ...] | None = None
    upper: tuple[float, ...] | None = None
    span: tuple[float, float] = (-1.0, 1.0)

    def __post_init__(self) -> None:
        n = len(self.names)
        if len(self.initial) != n or len(set(self.names)) != n:
            raise InputError(
                f"a custom map has names {self.names} and {len(self.initial)} start value(s); give one of each for "
                "every parameter and each name once"
            )
        if any(len(bound) != n for bound in (self.lower, self.upper) if bound is not None):
            raise InputError(f"a custom map of {n} parameter(s) has a different number of bounds; give {n} bounds")
        x = np.linspace(*self.span, 5)
        with np.errstate(all="ignore"):
            y = np.asarray(self.f(x, np.array(self.initial, dtype=float)))
        if y.shape != x.shape or not np.all(np.isfinite(y)):
            raise InputError(
                f"a custom map gives shape {y.shape} and {int(np.sum(np.isfinite(y)))} finite values for 5 samples "
                f"over {self.span}; f(x, theta) must give one finite value for each sample"
            )

    def slots(self) -> tuple[Slot, ...]:
        n = len(self.names)
        bounds = zip(self.names, self.lower or (-np.inf,) * n, self.upper or (np.inf,) * n, strict=True)
        return tuple(Slot(name, lower=lo, upper=up) for name, lo, up in bounds)

    def evaluate(self, theta: np.ndarray, x: np.ndarray, J: np.ndarray, q: int) -> tuple[np.ndarray, np.ndarray]:
        y = np.array(self.f(x, theta), dtype=float)
        if not J.shape[1]:
            return y, y  # without tangents nobody asks for the slope
        J[:, q : q + len(theta)] = self._jacobian(x, theta)
        return y, self._slope(x, theta)

    def start(self, x: np.ndarray) -> np.ndarray:
        return np.array(self.initial, dtype=float)

    def law(self, a: np.ndarray, b: np.ndarray) -> Law | None:
        """Nobody knows the law of a function: its units stay."""
        return Law(self, np.eye(self.n_parameters)) if a[0] == b[0] == 1.0 else None

    def symmetries(self, theta: np.ndarray) -> list[Symmetry]:
        """All directions with J dtheta + f' (a x + b) = c y + d over `span`, found numerically.

        The null space of [J, f' x, f', -y, -1] on a grid, in columns of unit norm; a singular value below 1e-8 of the
        largest counts as zero, which central differences can still tell.
        """
        x = np.linspace(*self.span, 20 * (len(theta) + 4))
        y, slope = np.asarray(self.f(x, theta), dtype=float), self._slope(x, theta)
        M = np.column_stack([self._jacobian(x, theta), slope * x, slope, -y, -np.ones(len(x))])
        return redundant(M)

    def _slope(self, x: np.ndarray, theta: np.ndarray) -> np.ndarray:
        if self.slope is not None:
            return np.asarray(self.slope(x, theta), dtype=float)
        h = _STEP * max(float(np.max(np.abs(x), initial=0.0)), 1e-3 * (self.span[1] - self.span[0]))
        up, down = x + h, x - h  # their true distance, not 2 h, which rounding changes
        return (self.f(up, theta) - self.f(down, theta)) / (up - down)

    def _jacobian(self, x: np.ndarray, theta: np.ndarray) -> np.ndarray:
        if self.jacobian is not None:
            return np.asarray(self.jacobian(x, theta), dtype=float)
        columns = np.empty((len(x), len(theta)))
        for i in range(len(theta)):
            up, down = theta.copy(), theta.copy()
            h = _STEP * max(abs(theta[i]), abs(self.initial[i]), 1e-3)
            up[i], down[i] = theta[i] + h, theta[i] - h
            columns[:, i] = (self.f(x, up) - self.f(x, down)) / (up[i] - down[i])
        return columns


def redundant(M: np.ndarray) -> list[Symmetry]:
    """Symmetries from the null space of M (n, p + 4): p columns of the parameters, then f' x, f', -y and -1.

    In columns of unit norm a singular value below 1e-8 of the largest counts as zero.
    """
    norm = np.linalg.norm(M, axis=0)
    scale = np.where(norm > 0.0, norm, 1.0)
    _, s, Vt = np.linalg.svd(M / scale)
    null = Vt[np.concatenate([s, np.zeros(len(Vt) - len(s))]) < 1e-8 * s[0]] / scale
    return [Symmetry(row[:-4], *(float(value) for value in row[-4:])) for row in null]
