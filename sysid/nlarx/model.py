"""Nonlinear ARX: y(t) = g(y(t-1)..y(t-na), u(t-nk)..u(t-nk-nb+1)), g a linear part and a wavelet network."""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from sysid.base.checks import checked
from sysid.base.errors import InputError, unknown

FOCUS = ("prediction", "simulation")
MAX_UNITS = 20  # of units='auto'


@checked(deferred=("na", "nb", "nk", "units"))
@dataclass(frozen=True)
class Nlarx:
    """Structure of a nonlinear ARX model; see `sysid.structures.nlarx` for the meaning of each entry."""

    na: int = 2
    nb: int = 2
    nk: int = 1
    units: int | str = "auto"
    focus: str = "prediction"
    nonlinear: tuple[str, ...] | None = None
    structure: str = "nlarx"

    def __post_init__(self) -> None:
        orders = (self.na, self.nb, self.nk)
        if not all(isinstance(k, (int, np.integer)) for k in orders) or min(orders) < 0 or self.na + self.nb < 1:
            raise InputError(f"orders na, nb, nk are {orders}; give whole numbers of at least 0, na + nb at least 1")
        if self.units != "auto" and not (isinstance(self.units, (int, np.integer)) and self.units >= 0):
            raise InputError(f"units is {self.units!r}; give a whole number of at least 0, or 'auto'")
        if self.focus not in FOCUS:
            raise unknown("focus", self.focus, FOCUS)
        for name in self.nonlinear or ():
            if name not in self.regressors:
                raise unknown("regressor", name, self.regressors)

    @cached_property
    def regressors(self) -> tuple[str, ...]:
        """Names of the regressors with their lags in samples: y1 is y(t-1)."""
        past = tuple(f"y{i}" for i in range(1, self.na + 1))
        return (*past, *(f"u{self.nk + i}" for i in range(self.nb)))

    @property
    def lag(self) -> int:
        """Samples that must be known before the first output: max(na, nb + nk - 1)."""
        return max(self.na, self.nb + self.nk - 1 if self.nb else 0)

    @property
    def max_units(self) -> int:
        """The largest number of units of a start."""
        return MAX_UNITS if self.units == "auto" else int(self.units)

    def matrix(self, u: np.ndarray, y: np.ndarray) -> np.ndarray:
        """Regressors Phi (N - lag, n) of the outputs from sample `lag` on, for u, y (N,)."""
        rows = np.arange(self.lag, len(y))
        past = [y[rows - i] for i in range(1, self.na + 1)]
        return np.column_stack([*past, *(u[rows - self.nk - i] for i in range(self.nb))])


@dataclass(frozen=True)
class Network:
    """The network of a start: the scaling of the regressors and the number of units of each kind.

    mu (n,) is the mean of the regressors. T (m, n) maps phi - mu to the coordinates x in which units are isotropic:
    standardised, rotated onto the principal axes and scaled to unit variance, at most ten times the scale of the first.
    theta (P,) = y0, L (n,), then s, b, c (m,) unit by unit, wavelets first.
    """

    model: Nlarx
    mu: np.ndarray
    T: np.ndarray
    wavelets: int = 0
    scaling: int = 0

    @property
    def n(self) -> int:
        """Number of regressors."""
        return len(self.mu)

    @property
    def m(self) -> int:
        """Number of coordinates of the units."""
        return len(self.T)

    @property
    def units(self) -> int:
        """Wavelets and scaling functions together."""
        return self.wavelets + self.scaling

    @property
    def size(self) -> int:
        """Number of parameters P."""
        return 1 + self.n + self.units * (self.m + 2)

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Names of the parameters in the order of theta."""
        slots = ("s", "b", *(f"c{j}" for j in range(1, self.m + 1)))
        kinds = [f"wavelet{k}" for k in range(1, self.wavelets + 1)] + [
            f"scaling{k}" for k in range(1, self.scaling + 1)
        ]
        return ("y0", *(f"L.{r}" for r in self.model.regressors), *(f"{kind}.{p}" for kind in kinds for p in slots))

    @cached_property
    def dilations(self) -> np.ndarray:
        """Positions of the b of the units in theta (units,)."""
        return 1 + self.n + 1 + np.arange(self.units) * (self.m + 2)

    @cached_property
    def peaks(self) -> np.ndarray:
        """Contribution of a weight of one to y at its unit's centre (P,); 0 for parameters that are not weights."""
        values = np.zeros(self.size)
        values[self.dilations - 1] = np.concatenate([np.full(self.wavelets, self.m), np.ones(self.scaling)])
        return values

    def with_units(self, wavelets: int, scaling: int) -> "Network":
        """The same scaling with other units."""
        return replace(self, wavelets=wavelets, scaling=scaling)

    def coordinates(self, Phi: np.ndarray) -> np.ndarray:
        """x (N, m) of regressors Phi (N, n)."""
        return (Phi - self.mu) @ self.T.T

    def predict(self, theta: np.ndarray, Phi: np.ndarray, own: bool = False) -> tuple[np.ndarray, np.ndarray]:
        """One step ahead (N,) for Phi (N, n), and its Jacobian (N, P) where `own`, else (0, 0)."""
        from sysid.nlarx.kernels import predict

        yhat, J = np.empty(len(Phi)), np.empty((len(Phi), len(theta)) if own else (0, 0))
        predict(theta, self.wavelets, self.mu, self.T, np.ascontiguousarray(Phi), yhat, J, own)
        return yhat, J

    def free_run(
        self, theta: np.ndarray, u: np.ndarray, y: np.ndarray, first: int, limit: float, own: bool = False
    ) -> tuple[np.ndarray, np.ndarray, int]:
        """Free run (N,) from sample `first`, its Jacobian (N, P) where `own`, and where it left +-limit (or N).

        The samples of y (N,) before `first` are its past; after divergence the run is infinite.
        """
        from sysid.nlarx.kernels import free_run

        yhat, J = np.array(y, dtype=float), np.empty((len(u), len(theta)) if own else (0, 0))
        model, u = self.model, np.ascontiguousarray(u, dtype=float)
        end = free_run(theta, self.wavelets, self.mu, self.T, model.na, model.nk, first, limit, u, yhat, J, own)
        yhat[end:] = np.inf
        return yhat, J, int(end)

    def slopes(self, theta: np.ndarray, phi: np.ndarray) -> tuple[float, np.ndarray]:
        """Output at one regressor phi (n,) and dy/dphi (n,)."""
        from sysid.nlarx.kernels import step

        dphi, row = np.empty(self.n), np.empty(len(theta))
        y = step(theta, self.wavelets, self.mu, self.T, phi, np.empty(self.m), np.empty(self.m), dphi, row, True)
        return float(y), dphi
