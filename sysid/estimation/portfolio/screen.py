"""For given poles, the rest of a chain with one filter by least squares, and its loss: what ranks the candidates."""

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from scipy.signal import lfilter

from sysid.blocks import TransferFunction
from sysid.estimation.linear_start import denominators
from sysid.estimation.portfolio import hats

_INPUT, _OUTPUT = 6, 12  # places of the curves that rank
_TURNS = 4  # of B for the input curve and the input curve for B
_DIRECTIONS = 3  # of B, from the quadratic regression


@dataclass(frozen=True)
class Candidate:
    """A filter b (nb,), f (nf,), the curve before it if there is one, and the loss with a free curve behind it.

    loss: share of the output's variance. member: where the poles come from. signal (N,): the filter's output.
    """

    member: str
    loss: float
    b: np.ndarray
    f: np.ndarray
    curve: tuple[np.ndarray, np.ndarray] | None
    signal: np.ndarray = field(repr=False)


@dataclass(frozen=True)
class Screen:
    """What all candidates of one record share: u, y (N,), the orders, and which curves the chain has."""

    u: np.ndarray
    y: np.ndarray
    nb: int
    nk: int
    before: bool
    behind: bool
    models: list[np.ndarray] = field(default_factory=list, repr=False)

    @cached_property
    def skipped(self) -> int:
        """Samples at the beginning that are not judged: the initial state is not known."""
        return min(50, len(self.u) // 20)

    def linear_models(self, linear: TransferFunction) -> list[np.ndarray]:
        """Denominators f (nf,) of linear models of this record, see `denominators`."""
        if not self.models:
            self.models.extend(denominators(linear, self.u - self.u.mean(), self.y - self.y.mean()))
        return self.models

    @cached_property
    def at(self) -> np.ndarray:
        """Places of the input curve (k,)."""
        return hats.places(self.u, _INPUT)

    @cached_property
    def target(self) -> np.ndarray:
        """The judged output with mean 0 and standard deviation 1."""
        y = self.y[self.skipped :]
        return (y - y.mean()) / (y.std() or 1.0)

    @cached_property
    def inputs(self) -> list[tuple[np.ndarray, np.ndarray]]:
        """Curves to try before the filter: none, and the size of the deviation where the chain has an input map."""
        u, at = self.u, hats.places(self.u, 9)
        middle = float(np.median(u))
        return [(u - u.mean(), at - u.mean()), (np.abs(u - middle), np.abs(at - middle))][: 1 + self.before]

    def candidates(self, member: str, f: np.ndarray) -> list[Candidate]:
        """Everything that least squares gives for the poles of F = 1 + f1 z^-1 + ... (f (nf,))."""
        found = []
        for x, values in self.inputs if self.behind else self.inputs[:1]:
            X = self.lags(f, x)
            for b in self.directions(X) if self.behind else [_solved(X[self.skipped :], self.target)]:
                found.append(self._judged(member, b, f, X @ b, (hats.places(self.u, 9), values)))
        if self.before:
            found.append(self._hammerstein(member, f))
        return [c for c in found if c is not None]

    def lags(self, f: np.ndarray, x: np.ndarray) -> np.ndarray:
        """Columns (N, nb): x (N, ) through 1/F, delayed."""
        g = lfilter([1.0], np.concatenate([[1.0], f]), x)
        return np.column_stack(
            [np.concatenate([np.zeros(self.nk + i), g[: len(g) - self.nk - i]]) for i in range(self.nb)]
        )

    def directions(self, X: np.ndarray) -> list[np.ndarray]:
        """Coefficients b (nb,) for columns X (N, nb): of the linear regression, and the main axes of the quadratic one.

        A map that folds hides its argument from the linear regression; the second-order term keeps it (Li 1992, J. Am.
        Stat. Assoc. 87, principal Hessian directions).
        """
        X = X[self.skipped :]
        found = [_solved(X, self.target)]
        if self.nb == 1:
            return [np.ones(1)]
        centred = X - X.mean(axis=0)
        try:
            root = np.linalg.inv(
                np.linalg.cholesky(np.cov(centred.T) + 1e-12 * np.trace(np.cov(centred.T)) * np.eye(self.nb))
            )
        except np.linalg.LinAlgError:
            return found
        Z = centred @ root.T
        i, j = np.triu_indices(self.nb)
        c = _solved(np.column_stack([np.ones(len(Z)), Z, Z[:, i] * Z[:, j]]), self.target)[1 + self.nb :]
        Q = np.zeros((self.nb, self.nb))
        Q[i, j] = c / np.where(i == j, 1.0, 2.0)
        Q = np.where(np.eye(self.nb) > 0, Q, Q + Q.T)
        size, axes = np.linalg.eigh(Q)
        order = np.argsort(-np.abs(size))[:_DIRECTIONS]
        return found + [root.T @ axes[:, k] for k in order]

    def _hammerstein(self, member: str, f: np.ndarray) -> Candidate | None:
        """B and the input curve from one regression over both, made of rank one and then improved in turns."""
        A = self.hat_lags(f)
        n, k = self.nb, len(self.at)
        part = A[self.skipped :]
        G, h = part.T @ part, part.T @ self.target
        G += 1e-9 * np.trace(G) / len(G) * np.eye(len(G))
        try:
            M = np.linalg.solve(G, h).reshape(n, k)
            U, s, V = np.linalg.svd(M, full_matrices=False)
            b, c = U[:, 0], s[0] * V[0]
            G4 = G.reshape(n, k, n, k)
            for _ in range(_TURNS if n > 1 else 0):
                b = np.linalg.solve(np.einsum("ikjl,k,l->ij", G4, c, c), h.reshape(n, k) @ c)
                c = np.linalg.solve(np.einsum("ikjl,i,j->kl", G4, b, b), b @ h.reshape(n, k))
        except np.linalg.LinAlgError:
            return None
        return self._judged(member, b, f, A @ np.outer(b, c).ravel(), (self.at, c))

    def hat_lags(self, f: np.ndarray) -> np.ndarray:
        """Columns (N, nb k) of the input's hat functions through 1/F, delayed; those of one lag stand together."""
        H = lfilter([1.0], np.concatenate([[1.0], f]), hats.columns(self.u, self.at), axis=0)
        lags = []
        for i in range(self.nk, self.nk + self.nb):
            shifted = np.zeros_like(H)
            shifted[i:] = H[: len(H) - i]
            lags.append(shifted)
        return np.concatenate(lags, axis=1)

    def _judged(
        self, member: str, b: np.ndarray, f: np.ndarray, w: np.ndarray, curve: tuple[np.ndarray, np.ndarray]
    ) -> Candidate | None:
        judged = w[self.skipped :]
        if not np.all(np.isfinite(judged)) or np.ptp(judged) <= 1e-12 * (np.abs(judged).max() + 1e-300):
            return None
        if self.behind:
            loss = hats.fitted(judged, self.target, hats.places(judged, _OUTPUT))[1]
        else:
            loss = float(np.var(self.target - judged))
        scale = 1.0 if not self.behind else 1.0 / judged.std()
        return Candidate(member, loss, b * scale, f, curve if self.before else None, w * scale)


def _solved(X: np.ndarray, y: np.ndarray) -> np.ndarray:
    return np.linalg.lstsq(X, y, rcond=1e-10)[0]
