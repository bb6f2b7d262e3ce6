"""A nonlinear ARX network and its records as a least-squares problem: one step ahead, or free run."""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from sysid.data.record import IOData, siso
from sysid.nlarx.model import Network, Nlarx

_WIDEST, _NARROWEST = 1e-2, 1e2
FAR = 1e3  # a free run that is this many spans of y from its mean has diverged


@dataclass(frozen=True)
class Piece:
    """One experiment: u, y (N,), and the mask of measured outputs (N,)."""

    u: np.ndarray
    y: np.ndarray
    seen: np.ndarray

    @classmethod
    def of(cls, data: IOData) -> "tuple[Piece, ...]":
        """All experiments of a record."""
        pieces = []
        for e in data.experiments:
            u, y = siso(e)
            missing = getattr(e, "missing", None)
            mask = np.ones(len(y), dtype=bool) if missing is None else ~missing[:, 0]
            pieces.append(cls(np.ascontiguousarray(u), np.ascontiguousarray(y), mask))
        return tuple(pieces)


def limit(pieces: tuple[Piece, ...]) -> float:
    """|yhat| beyond which a free run counts as diverged."""
    y = np.concatenate([p.y for p in pieces])
    return float(np.max(np.abs(y)) + FAR * max(np.ptp(y), 1e-300))


def rows(model: Nlarx, pieces: tuple[Piece, ...]) -> tuple[np.ndarray, np.ndarray]:
    """Regressors (N, n) and outputs (N,) of all experiments, without rows that contain a missing sample."""
    Phis, ys = [], []
    for p in pieces:
        Phi, y = model.matrix(p.u, p.y), p.y[model.lag :]
        complete = p.seen[model.lag :].copy()
        for i in range(1, model.na + 1):
            complete &= p.seen[model.lag - i : len(p.y) - i]
        Phis.append(Phi[complete])
        ys.append(y[complete])
    return np.ascontiguousarray(np.concatenate(Phis)), np.concatenate(ys)


class NetworkProblem:
    """What both problems share: the ridge, and the limits of the dilations."""

    network: Network
    ridge: float

    def repair(self, p: np.ndarray) -> np.ndarray:
        """p (P,) with every dilation in its limits: from a unit that is nearly linear to one that covers a sample."""
        dilations = self.network.dilations
        if not len(dilations) or not np.all(np.isfinite(p)):
            return p
        limited = p.copy()
        limited[dilations] = np.clip(p[dilations], _WIDEST, _NARROWEST)
        return limited

    def blocked(self, p: np.ndarray, gradient: np.ndarray) -> np.ndarray:
        """True (P,) where a dilation is at its limit and the descent direction points beyond it."""
        at_limit, dilations = np.zeros(len(p), dtype=bool), self.network.dilations
        b, slope = p[dilations], gradient[dilations]
        at_limit[dilations] = ((b <= _WIDEST) & (slope < 0)) | ((b >= _NARROWEST) & (slope > 0))
        return at_limit

    def _with_ridge(self, p: np.ndarray, errors: list[np.ndarray]) -> np.ndarray:
        """All errors in one vector, followed by those of the ridge if there is one."""
        if self.ridge:
            errors = [*errors, -np.sqrt(self.ridge) * self.network.peaks * p]
        return np.concatenate(errors)

    def _with_ridge_rows(self, Js: list[np.ndarray]) -> np.ndarray:
        """The Jacobian that belongs to `_with_ridge`."""
        if self.ridge:
            Js = [*Js, np.diag(np.sqrt(self.ridge) * self.network.peaks)]
        return np.concatenate(Js)


@dataclass(frozen=True)
class PredictionProblem(NetworkProblem):
    """min over theta of the squared one-step errors, for regressors Phi (N, n) and outputs y (N,).

    `ridge` adds the squares of each unit's contribution at its centre, ridge (s_k peak_k)^2: without it, wide units get
    huge weights that cancel each other. Its P rows follow the N errors.
    """

    network: Network
    Phi: np.ndarray
    y: np.ndarray
    ridge: float = 0.0

    @property
    def N(self) -> int:
        """Number of errors without the ridge's rows."""
        return len(self.y)

    def thin(self, rows: int) -> "PredictionProblem":
        """The same with at most `rows` rows, evenly spread."""
        if rows >= self.N:
            return self
        take = np.linspace(0, self.N - 1, rows).astype(int)
        return replace(self, Phi=np.ascontiguousarray(self.Phi[take]), y=self.y[take])

    @cached_property
    def size(self) -> float:
        """Sum of squares about the mean."""
        return float(np.sum((self.y - self.y.mean()) ** 2))

    def residual(self, p: np.ndarray) -> np.ndarray | None:
        """e (N,)."""
        return self._with_ridge(p, [self.y - self.network.predict(p, self.Phi)[0]])

    def linearise(self, p: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """e (N,) and dyhat/dtheta (N, P)."""
        yhat, J = self.network.predict(p, self.Phi, own=True)
        return self._with_ridge(p, [self.y - yhat]), self._with_ridge_rows([J])


@dataclass(frozen=True)
class SimulationProblem(NetworkProblem):
    """min over theta of the squared free-run errors of all experiments, each from its own first `first` samples.

    `ridge` as for the prediction.
    """

    network: Network
    pieces: tuple[Piece, ...]
    first: int
    ridge: float = 0.0

    @cached_property
    def N(self) -> int:
        """Number of errors without the ridge's rows."""
        return sum(int(np.sum(self._counts(p))) for p in self.pieces)

    @cached_property
    def size(self) -> float:
        """Sum of squares about the mean of the samples that count."""
        y = np.concatenate([p.y[self._counts(p)] for p in self.pieces])
        return float(np.sum((y - y.mean()) ** 2))

    def shorten(self, samples: int) -> "SimulationProblem":
        """The same with the first part of each experiment only, at most `samples` in all."""
        share = max(samples // len(self.pieces), self.first + 2)
        if max(len(p.y) for p in self.pieces) <= share:
            return self
        return replace(self, pieces=tuple(Piece(p.u[:share], p.y[:share], p.seen[:share]) for p in self.pieces))

    @cached_property
    def limit(self) -> float:
        """|yhat| beyond which the run counts as diverged."""
        return limit(self.pieces)

    def _counts(self, piece: Piece) -> np.ndarray:
        return piece.seen & (np.arange(len(piece.y)) >= self.first)

    def residual(self, p: np.ndarray) -> np.ndarray | None:
        """e (N,), None where a run diverges."""
        errors = []
        for piece in self.pieces:
            yhat, _, end = self.network.free_run(p, piece.u, piece.y, self.first, self.limit)
            if end < len(yhat):
                return None
            errors.append((piece.y - yhat)[self._counts(piece)])
        return self._with_ridge(p, errors)

    def linearise(self, p: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """e (N,) and dyhat/dtheta (N, P), through the recursion."""
        errors, Js = [], []
        for piece in self.pieces:
            yhat, J, _ = self.network.free_run(p, piece.u, piece.y, self.first, self.limit, own=True)
            counts = self._counts(piece)
            errors.append((piece.y - yhat)[counts])
            Js.append(_drop_large_rows(J[counts]))
        return self._with_ridge(p, errors), self._with_ridge_rows(Js)


def _drop_large_rows(J: np.ndarray) -> np.ndarray:
    """J (N, P) without the rows that are too large after a chaotic run."""
    with np.errstate(invalid="ignore"):
        usable = np.abs(J).max(axis=1, initial=0.0) < 1e100  # False for nan too
    return J if usable.all() else np.where(usable[:, None], J, 0.0)


AnyProblem = PredictionProblem | SimulationProblem
