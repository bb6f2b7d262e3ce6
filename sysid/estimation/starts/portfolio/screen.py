"""Where candidates for the poles of one filter come from, and how least squares around given poles ranks them."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from scipy.signal import lfilter

from sysid.base.poles import mirrored, monic
from sysid.blocks import TransferFunction
from sysid.estimation.starts._start import best_output_error, delay, denominators
from sysid.estimation.starts.portfolio import curves

# Chosen with the portfolio on drawn plants, see `sysid.estimation.search`.
_INPUT, _OUTPUT = 6, 12  # places of the curves that rank
_TURNS = 4  # of B for the input curve and the input curve for B
_DIRECTIONS = 3  # of B, from the quadratic regression
Found = Iterator[np.ndarray]

_PASSES = 12  # of the prefiltered regression
_SLOW = (1.0, 2.5, 6.0, 15.0, 40.0, 100.0)  # [samples] time constants of the filters of the quadratic regression


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
    def n_initial(self) -> int:
        """Samples at the beginning that are not judged: the initial state is not known."""
        return min(50, len(self.u) // 20)

    def linear_models(self, linear: TransferFunction) -> list[np.ndarray]:
        """Denominators f (nf,) of linear models of this record, see `denominators`."""
        if not self.models:
            self.models.extend(denominators(linear, self.u - self.u.mean(), self.y - self.y.mean()))
        return self.models

    @cached_property
    def knots(self) -> np.ndarray:
        """Places of the input curve (k,)."""
        return curves.places(self.u, _INPUT)

    @cached_property
    def target(self) -> np.ndarray:
        """The judged output with mean 0 and standard deviation 1."""
        y = self.y[self.n_initial :]
        return (y - y.mean()) / (y.std() or 1.0)

    @cached_property
    def inputs(self) -> list[tuple[np.ndarray, np.ndarray]]:
        """Curves to try before the filter: none, and the size of the deviation where the chain has an input map."""
        u, knots = self.u, curves.places(self.u, 9)
        middle = float(np.median(u))
        return [(u - u.mean(), knots - u.mean()), (np.abs(u - middle), np.abs(knots - middle))][: 1 + self.before]

    def candidates(self, member: str, f: np.ndarray) -> list[Candidate]:
        """Everything that least squares gives for the poles of F = 1 + f1 z^-1 + ... (f (nf,))."""
        pool = []
        for x, values in self.inputs if self.behind else self.inputs[:1]:
            X = self.lags(f, x)
            for b in self.directions(X) if self.behind else [_solve(X[self.n_initial :], self.target)]:
                pool.append(self._rate(member, b, f, X @ b, (curves.places(self.u, 9), values)))
        if self.before:
            pool.append(self._hammerstein(member, f))
        return [c for c in pool if c is not None]

    def lags(self, f: np.ndarray, x: np.ndarray) -> np.ndarray:
        """Columns (N, nb): x (N, ) through 1/F, delayed."""
        g = lfilter([1.0], np.concatenate([[1.0], f]), x)
        return np.column_stack([delay(g, self.nk + i) for i in range(self.nb)])

    def directions(self, X: np.ndarray) -> list[np.ndarray]:
        """Coefficients b (nb,) for columns X (N, nb): of the linear regression, and the main axes of the quadratic one.

        A map that folds hides its argument from the linear regression; the second-order term keeps it (Li 1992, J. Am.
        Stat. Assoc. 87, principal Hessian directions).
        """
        X = X[self.n_initial :]
        vectors = [_solve(X, self.target)]
        if self.nb == 1:
            return [np.ones(1)]
        deviations = X - X.mean(axis=0)
        try:
            root = np.linalg.inv(
                np.linalg.cholesky(np.cov(deviations.T) + 1e-12 * np.trace(np.cov(deviations.T)) * np.eye(self.nb))
            )
        except np.linalg.LinAlgError:
            return vectors
        Z = deviations @ root.T
        i, j = np.triu_indices(self.nb)
        c = _solve(np.column_stack([np.ones(len(Z)), Z, Z[:, i] * Z[:, j]]), self.target)[1 + self.nb :]
        Q = np.zeros((self.nb, self.nb))
        Q[i, j] = c / np.where(i == j, 1.0, 2.0)
        Q = np.where(np.eye(self.nb) > 0, Q, Q + Q.T)
        size, axes = np.linalg.eigh(Q)
        order = np.argsort(-np.abs(size))[:_DIRECTIONS]
        return vectors + [root.T @ axes[:, k] for k in order]

    def _hammerstein(self, member: str, f: np.ndarray) -> Candidate | None:
        """B and the input curve from one regression over both, made of rank one and then improved in turns."""
        A = self.hat_lags(f)
        n, k = self.nb, len(self.knots)
        part = A[self.n_initial :]
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
        return self._rate(member, b, f, A @ np.outer(b, c).ravel(), (self.knots, c))

    def hat_lags(self, f: np.ndarray) -> np.ndarray:
        """Columns (N, nb k) of the input's hat functions through 1/F, delayed; those of one lag stand together."""
        H = lfilter([1.0], np.concatenate([[1.0], f]), curves.hat_functions(self.u, self.knots), axis=0)
        lags = []
        for i in range(self.nk, self.nk + self.nb):
            column = np.zeros_like(H)
            column[i:] = H[: len(H) - i]
            lags.append(column)
        return np.concatenate(lags, axis=1)

    def _rate(
        self, member: str, b: np.ndarray, f: np.ndarray, w: np.ndarray, curve: tuple[np.ndarray, np.ndarray]
    ) -> Candidate | None:
        """The candidate of a filter with the output w (N,) and its loss; None for an output that does not move."""
        signal = w[self.n_initial :]
        if not np.all(np.isfinite(signal)) or np.ptp(signal) <= 1e-12 * (np.abs(signal).max() + 1e-300):
            return None
        if self.behind:
            loss = curves.fit_curve(signal, self.target, curves.places(signal, _OUTPUT))[1]
        else:
            loss = float(np.var(self.target - signal))
        scale = 1.0 if not self.behind else 1.0 / signal.std()
        return Candidate(member, loss, b * scale, f, curve if self.before else None, w * scale)


def _solve(X: np.ndarray, y: np.ndarray) -> np.ndarray:
    return np.linalg.lstsq(X, y, rcond=1e-10)[0]


def approximation(screen: Screen, linear: TransferFunction, rng: np.random.Generator) -> Found:
    """Instrumental variables at several rates: the best linear approximation."""
    yield from screen.linear_models(linear)


def output_error(screen: Screen, linear: TransferFunction, rng: np.random.Generator) -> Found:
    """The same after output error, whose poles may describe a curve in place of the dynamics."""
    u, y = screen.u - screen.u.mean(), screen.y - screen.y.mean()
    yield best_output_error(linear, screen.linear_models(linear), u, y)[linear.nb : linear.nb + linear.nf]


def curved_input(screen: Screen, linear: TransferFunction, rng: np.random.Generator) -> Found:
    """A regression on past outputs and on hat functions of the input, prefiltered by its own 1/F until it stays.

    Steiglitz and McBride 1965 (IEEE Trans. Automatic Control 10) with the input map of Bai 1998 (Automatica 34): it
    needs no start and does not mind a map that folds.
    """
    if not screen.before:
        return
    f, y, target = np.zeros(linear.nf), screen.y - screen.y.mean(), screen.n_initial
    past = np.column_stack([delay(y, j + 1) for j in range(linear.nf)]) if linear.nf else np.empty((len(y), 0))
    for k in range(_PASSES):
        F = np.concatenate([[1.0], f])
        regressors = -lfilter([1.0], F, past, axis=0) if linear.nf else past
        A = np.column_stack([regressors, screen.hat_lags(f)])[target:]
        fresh = np.linalg.lstsq(A, lfilter([1.0], F, y)[target:], rcond=1e-9)[0][: linear.nf]
        fresh = mirrored(fresh)
        if k in (3, _PASSES - 1) or np.allclose(fresh, f, rtol=0, atol=1e-4):
            yield fresh
        if np.allclose(fresh, f, rtol=0, atol=1e-4):
            return
        f = fresh


def even_part(screen: Screen, linear: TransferFunction, rng: np.random.Generator) -> Found:
    """A quadratic regression on low passes of the input; its main axes are signals, and each has a linear model.

    This finds the filter before a map that folds, where the output hardly correlates with the input.
    """
    if not screen.behind or not linear.nf:
        return
    for x, _ in screen.inputs:
        X = np.column_stack([delay(_low_pass(x, T), linear.nk) for T in _SLOW])
        X = np.column_stack([X, delay(x, linear.nk), delay(x, linear.nk + 1)])
        for w in _axes(X, screen)[:3]:
            w = np.concatenate([np.zeros(len(x) - len(w)), w])
            yield from denominators(linear, x, w, (4,))


def ringing(screen: Screen, linear: TransferFunction, rng: np.random.Generator) -> Found:
    """How the output goes on by itself: poles of its autoregression, and these at half the frequency.

    A map that folds doubles the frequency of what rings before it.
    """
    if not screen.behind or linear.nf < 2:
        return
    y = screen.target
    for n in (linear.nf, linear.nf + 2):
        past = np.column_stack([delay(y, j + 1) for j in range(n)])[n:]
        poles = np.roots(np.concatenate([[1.0], -np.linalg.lstsq(past, y[n:], rcond=1e-9)[0]])).astype(complex)
        for variants in (
            poles,
            np.where(np.abs(poles.imag) > 1e-9, np.sqrt(np.abs(poles)) * np.sqrt(poles / np.abs(poles)), poles),
        ):
            pairs = variants[variants.imag > 1e-9]
            for z in pairs[np.argsort(-np.abs(pairs))][:2]:
                rest = random_poles(linear.nf - 2, len(y), rng)
                yield np.convolve([1.0, -2.0 * z.real, min(abs(z), 0.999) ** 2], np.concatenate([[1.0], rest]))[1:]


def drawn(screen: Screen, linear: TransferFunction, rng: np.random.Generator) -> Found:
    """Poles drawn over all time constants up to a tenth of the record."""
    for _ in range(40 if linear.nf else 0):
        yield random_poles(linear.nf, len(screen.u), rng)


MEMBERS: dict[str, Callable[[Screen, TransferFunction, np.random.Generator], Found]] = {
    each.__name__: each for each in (approximation, output_error, curved_input, even_part, ringing, drawn)
}


def _low_pass(x: np.ndarray, T: float) -> np.ndarray:
    pole = float(np.exp(-1.0 / T))
    return lfilter([1.0 - pole], [1.0, -pole], x)


def _axes(X: np.ndarray, screen: Screen) -> list[np.ndarray]:
    """Signals along the main axes of the quadratic regression of the output on X (N, m), and along its linear part."""
    X = X[screen.n_initial :]
    X = X - X.mean(axis=0)
    U, s, _ = np.linalg.svd(X, full_matrices=False)
    Z = U[:, s > 1e-6 * s[0]] * np.sqrt(len(X))
    m = Z.shape[1]
    i, j = np.triu_indices(m)
    A = np.column_stack([np.ones(len(Z)), Z, Z[:, i] * Z[:, j]])
    c = np.linalg.lstsq(A, screen.target, rcond=1e-8)[0][1 + m :]
    Q = np.zeros((m, m))
    Q[i, j] = Q[j, i] = c / np.where(i == j, 1.0, 2.0)
    size, axes = np.linalg.eigh(Q)
    return [Z @ axes[:, k] for k in np.argsort(-np.abs(size))]


def random_poles(n: int, N: int, rng: np.random.Generator) -> np.ndarray:
    """f (n,): time constants log-uniform from 0.5 to N / 10 samples, some poles in pairs, some negative."""
    poles: list[complex] = []
    while len(poles) < n:
        radius = float(np.exp(-1.0 / np.exp(rng.uniform(np.log(0.5), np.log(max(N / 10, 2.0))))))
        if n - len(poles) >= 2 and rng.uniform() < 0.4:
            turn = np.exp(1j * np.pi * rng.uniform(0.02, 0.95))
            poles += [radius * turn, radius / turn]
        else:
            poles.append(radius if rng.uniform() < 0.85 else -radius)
    return monic(np.array(poles))
