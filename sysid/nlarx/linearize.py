"""Steady states of a nonlinear ARX model and its tangent there: a linear ARX model."""

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from sysid.base.errors import InputError
from sysid.nlarx.result import NlarxFit

if TYPE_CHECKING:
    from control import TransferFunction


@dataclass(frozen=True)
class OperatingPoint:
    """Steady state: constant input u, output y, and dy/dphi (n,) in the order of the model's regressors."""

    u: float
    y: float
    slopes: np.ndarray

    def poles(self, na: int) -> np.ndarray:
        """Poles in z (na,) of the tangent, complex."""
        return np.roots(np.concatenate([[1.0], -self.slopes[:na]])).astype(complex)


def findops(fit: NlarxFit, u: float = 0.0) -> tuple[OperatingPoint, ...]:
    """All steady states at the constant input u with an output within ten spans of the data, from low to high y.

    Roots of g(y, .., y, u, .., u) - y: signs on a grid, then Brent's method. Such models may really have several
    steady states. Two roots within one cell of the grid are missed.
    """
    from scipy.optimize import brentq

    model = fit.model

    def phi(y: float) -> np.ndarray:
        return np.concatenate([np.full(model.na, y), np.full(model.nb, float(u))])

    def excess(y: float) -> float:
        return fit.network.slopes(fit.theta, phi(y))[0] - y

    if not model.na:
        levels = [fit.network.slopes(fit.theta, phi(0.0))[0]]
    else:
        low, high = fit.y_span
        width = high - low
        inner_grid, outer_grid = np.linspace(low, high, 401), np.linspace(low - 10 * width, high + 10 * width, 401)
        grid = np.unique(np.concatenate([inner_grid, outer_grid]))
        values = np.array([excess(y) for y in grid])
        cells = np.flatnonzero(np.sign(values[:-1]) * np.sign(values[1:]) < 0)
        levels = [float(y) for y in grid[values == 0.0]]
        levels += [float(brentq(excess, grid[k], grid[k + 1], xtol=1e-14 * (1.0 + width))) for k in cells]
    return tuple(OperatingPoint(float(u), y, fit.network.slopes(fit.theta, phi(y))[1]) for y in sorted(levels))


def findop(fit: NlarxFit, u: float = 0.0, y: float | None = None) -> OperatingPoint:
    """The steady state at the constant input u: the one nearest to y, or the stable one nearest to the data's middle.

    Raises InputError if there is none, as for a plant that integrates.
    """
    states = findops(fit, u)
    if not states:
        raise InputError(
            f"no steady state at u = {u:g} near the data: the model integrates or diverges; choose another u"
        )
    stable = [op for op in states if np.all(np.abs(op.poles(fit.model.na)) < 1.0)]
    target = 0.5 * sum(fit.y_span) if y is None else y
    return min(stable or states if y is None else states, key=lambda op: abs(op.y - target))


def tangent(fit: NlarxFit, u: float = 0.0, y: float | None = None) -> "TransferFunction":
    """The tangent at `findop(fit, u, y)` as a discrete control.TransferFunction: B/(1 - sum dg/dy_i z^-i)."""
    from sysid.base.looks import load

    load()  # matplotlib, which control imports, whatever its settings are
    import control

    model, slopes = fit.model, findop(fit, u, y).slopes
    order = max(model.na, model.nk + model.nb - 1)
    A, B = np.zeros(order + 1), np.zeros(order + 1)
    A[0], A[1 : model.na + 1] = 1.0, -slopes[: model.na]
    B[model.nk : model.nk + model.nb] = slopes[model.na :]
    B = np.trim_zeros(B, "f")
    return control.tf(B if len(B) else np.zeros(1), A, fit.Ts)
