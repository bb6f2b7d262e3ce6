"""How least squares around given poles of the filters ranks candidates, and gives them their curves."""

from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from scipy.signal import lfilter

from sysid.block.block import Block
from sysid.blocks import TransferFunction
from sysid.estimation.starts._start import alone, delay, denominators, filters_of
from sysid.estimation.starts.portfolio import curves
from sysid.model.chain import columns

# Chosen with the portfolio on drawn plants, see `sysid.estimation.search`.
FEWEST, _MOST, _OUTPUT = 6, 12, 12  # places of the curves that rank: of the input as many as samples tell, and behind
_TRIAL = 9  # places of a curve that is tried
_SAMPLES = 25  # for a value of a curve
_TURNS = 4  # of B for the input curve and the input curve for B
_DIRECTIONS = 3  # of B, from the quadratic regression
Curves = list[tuple[np.ndarray, np.ndarray]]  # places and values (k,) for each input


@dataclass(frozen=True)
class Candidate:
    """A filter b (nb,), f (nf,), the curve of each input before it, and the loss with a free curve behind it.

    Of several inputs b and f are those of one filter after the other. loss: share of the output's variance. member:
    where the poles come from. signal (N,): the output of the filters.
    """

    member: str
    loss: float
    b: np.ndarray
    f: np.ndarray
    curve: Curves | None
    signal: np.ndarray = field(repr=False)


@dataclass(frozen=True)
class Screen:
    """What all candidates of one record share: u (N,) or (N, nu), y (N,), the filters, and the curves of the chain."""

    u: np.ndarray
    y: np.ndarray
    linear: Block
    before: bool
    behind: bool
    most: int = _MOST  # places of an input's curve

    @cached_property
    def inputs(self) -> list[np.ndarray]:
        """Each input (N,)."""
        return columns(self.u, len(self.filters))

    @cached_property
    def filters(self) -> tuple[TransferFunction, ...]:
        """The filter of each input."""
        return filters_of(self.linear)

    @cached_property
    def alone(self) -> "list[Screen]":
        """A screen for each input: with the output less what the other inputs contribute to a linear model."""
        if len(self.filters) == 1:
            return [self]
        parts = alone(self.linear, *self.deviations)
        return [replace(self, u=u, y=y, linear=entry) for u, (entry, _, y) in zip(self.inputs, parts, strict=True)]

    @cached_property
    def n_initial(self) -> int:
        """Samples at the beginning that are not judged: the initial state is not known."""
        return min(50, len(self.u) // 20)

    @cached_property
    def deviations(self) -> tuple[np.ndarray, np.ndarray]:
        """u and y without their means."""
        return self.u - self.u.mean(axis=0), self.y - self.y.mean()

    @cached_property
    def linear_models(self) -> list[np.ndarray]:
        """Denominators f of linear models of this record, see `denominators`."""
        return denominators(self.linear, *self.deviations)

    @cached_property
    def knots(self) -> list[np.ndarray]:
        """Places (k,) of each input's curve."""
        counts = [min(max(len(self.u) // (_SAMPLES * entry.nb), FEWEST), self.most) for entry in self.filters]
        return [curves.places(u, k) for u, k in zip(self.inputs, counts, strict=True)]

    @cached_property
    def target(self) -> np.ndarray:
        """The judged output with mean 0 and standard deviation 1."""
        y = self.y[self.n_initial :]
        return (y - y.mean()) / (y.std() or 1.0)

    @cached_property
    def trial_places(self) -> list[np.ndarray]:
        """Places (k,) of each input's curve that is tried."""
        return [curves.places(u, _TRIAL) for u in self.inputs]

    @cached_property
    def trials(self) -> list[tuple[list[np.ndarray], Curves]]:
        """Curves to try before the filters: none, and the size of the deviation where the chain has input maps.

        What comes out of them for each input (N,), and the curves.
        """
        pairs = list(zip(self.inputs, self.trial_places, strict=True))
        means, middles = [u.mean() for u in self.inputs], [float(np.median(u)) for u in self.inputs]
        straight = [u - m for u, m in zip(self.inputs, means, strict=True)]
        lines = [(knots, knots - m) for (_, knots), m in zip(pairs, means, strict=True)]
        folded = [np.abs(u - m) for u, m in zip(self.inputs, middles, strict=True)]
        folds = [(knots, np.abs(knots - m)) for (_, knots), m in zip(pairs, middles, strict=True)]
        return [(straight, lines), (folded, folds)][: 1 + self.before]

    def candidates(self, member: str, f: np.ndarray, rng: np.random.Generator | None = None) -> list[Candidate]:
        """Everything that least squares gives for the poles of F = 1 + f1 z^-1 + ... (f (nf,)).

        `rng` draws the corner and the slopes of the curve that is tried beside none.
        """
        pool = []
        trials = self.trials if self.behind else self.trials[:1]
        if rng is not None and len(trials) > 1:
            trials = [trials[0], self._drawn_corners(rng)]
        for xs, trial in trials:
            X = self.lags(f, xs)
            for b in self.directions(X) if self.behind else [_solve(X[self.n_initial :], self.target)]:
                pool.append(self._rate(member, b, f, X @ b, trial))
        if self.before:
            pool.append(self._hammerstein(member, f))
        return [c for c in pool if c is not None]

    def _drawn_corners(self, rng: np.random.Generator) -> tuple[list[np.ndarray], Curves]:
        """A trial as in `trials`: two lines for each input that meet at a drawn place, with drawn slopes."""
        signals, lines = list[np.ndarray](), Curves()
        for u, knots in zip(self.inputs, self.trial_places, strict=True):
            corner, angle = float(np.quantile(u, rng.uniform(0.1, 0.9))), rng.uniform(0.0, 2.0 * np.pi)
            bent, curve = ((x - corner) * np.where(x < corner, np.cos(angle), np.sin(angle)) for x in (u, knots))
            signals.append(bent)
            lines.append((knots, curve))
        return signals, lines

    def denominators_of(self, f: np.ndarray) -> list[np.ndarray]:
        """F (nf + 1,) of every filter out of f."""
        ends = np.cumsum([entry.nf for entry in self.filters])[:-1]
        return [np.concatenate([[1.0], part]) for part in np.split(f, ends)]

    def lags(self, f: np.ndarray, xs: list[np.ndarray]) -> np.ndarray:
        """Columns (N, nb): each x (N,) through its 1/F, delayed."""
        filtered = [lfilter([1.0], F, x) for F, x in zip(self.denominators_of(f), xs, strict=True)]
        pairs = zip(self.filters, filtered, strict=True)
        return np.column_stack([delay(g, entry.nk + i) for entry, g in pairs for i in range(entry.nb)])

    def directions(self, X: np.ndarray) -> list[np.ndarray]:
        """Coefficients b (nb,) for columns X (N, nb): of the linear regression, and the main axes of the quadratic one.

        A map that folds hides its argument from the linear regression; the second-order term keeps it (Li 1992, J. Am.
        Stat. Assoc. 87, principal Hessian directions).
        """
        X = X[self.n_initial :]
        vectors, n = [_solve(X, self.target)], X.shape[1]
        if n == 1:
            return [np.ones(1)]
        deviations = X - X.mean(axis=0)
        try:
            root = np.linalg.inv(
                np.linalg.cholesky(np.cov(deviations.T) + 1e-12 * np.trace(np.cov(deviations.T)) * np.eye(n))
            )
        except np.linalg.LinAlgError:
            return vectors
        Z = deviations @ root.T
        i, j = np.triu_indices(n)
        c = _solve(np.column_stack([np.ones(len(Z)), Z, Z[:, i] * Z[:, j]]), self.target)[1 + n :]
        Q = np.zeros((n, n))
        Q[i, j] = c / np.where(i == j, 1.0, 2.0)
        Q = np.where(np.eye(n) > 0, Q, Q + Q.T)
        size, axes = np.linalg.eigh(Q)
        order = np.argsort(-np.abs(size))[:_DIRECTIONS]
        return vectors + [root.T @ axes[:, k] for k in order]

    def _hammerstein(self, member: str, f: np.ndarray) -> Candidate | None:
        """B and the input curves from one regression over both, made of rank one and then improved in turns.

        A curve's level is apart from its shape: for a slow filter a level at one lag and the same below 0 at the next
        cancel, and would hide all else in the rank. With a curve behind, the regression is no more than a hint, and
        levels help it. Lists have an item for each input: s, c and h the values of its curve, less that at its first
        place if levels are apart, b and G4 and h its lags.
        """
        apart = not self.behind
        A, levels = self.hat_lags(f, int(apart)), self.levels(f) if apart else None
        shapes = [(entry.nb, len(knots) - apart) for entry, knots in zip(self.filters, self.knots, strict=True)]
        ends = np.cumsum([n * k for n, k in shapes])[:-1]
        part, target = (_residual(levels, x) for x in (A[self.n_initial :], self.target))
        G, h_all = part.T @ part, part.T @ target
        G += 1e-9 * np.trace(G) / len(G) * np.eye(len(G))

        def by_input(x: np.ndarray) -> list[np.ndarray]:
            return [piece.reshape(shape) for piece, shape in zip(np.split(x, ends), shapes, strict=True)]

        h = by_input(h_all)
        G4 = [
            [cell.reshape(*rows, *cols) for cell, cols in zip(np.split(row, ends, axis=1), shapes, strict=True)]
            for row, rows in zip(np.split(G, ends), shapes, strict=True)
        ]
        try:
            axes = [np.linalg.svd(M, full_matrices=False) for M in by_input(np.linalg.solve(G, h_all))]
            b, c = [U[:, 0] for U, _, _ in axes], [s[0] * V[0] for _, s, V in axes]
            for _ in range(_TURNS if any(n > 1 for n, _ in shapes) else 0):
                b = _solve_blocks("ikjl,k,l->ij", G4, c, [hi @ ci for hi, ci in zip(h, c, strict=True)])
                c = _solve_blocks("ikjl,i,j->kl", G4, b, [bi @ hi for hi, bi in zip(h, b, strict=True)])
        except np.linalg.LinAlgError:
            return None
        outer = np.concatenate([np.outer(bi, ci).ravel() for bi, ci in zip(b, c, strict=True)])
        values = [np.concatenate([[0.0] * apart, ci]) for ci in c]
        candidate = self._rate(member, np.concatenate(b), f, A @ outer, list(zip(self.knots, values, strict=True)))
        return replace(candidate, loss=float(np.var(target - part @ outer))) if candidate and apart else candidate

    def levels(self, f: np.ndarray) -> np.ndarray:
        """Columns (M, 1 + nu) of what is judged: a constant, and the step response of each 1/F."""
        steps = [lfilter([1.0], F, np.ones(len(self.u))) for F in self.denominators_of(f)]
        return np.column_stack([np.ones(len(self.u)), *steps])[self.n_initial :]

    def hat_lags(self, f: np.ndarray, first: int = 0) -> np.ndarray:
        """Columns (N, nb k) of each input's hat functions from `first` through 1/F, delayed; a lag's stand together."""
        lags = []
        for entry, F, u, knots in zip(self.filters, self.denominators_of(f), self.inputs, self.knots, strict=True):
            H = lfilter([1.0], F, curves.hat_functions(u, knots)[:, first:], axis=0)
            for i in range(entry.nk, entry.nk + entry.nb):
                column = np.zeros_like(H)
                column[i:] = H[: len(H) - i]
                lags.append(column)
        return np.concatenate(lags, axis=1)

    def _rate(self, member: str, b: np.ndarray, f: np.ndarray, w: np.ndarray, curve: Curves) -> Candidate | None:
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


def _residual(X: np.ndarray | None, y: np.ndarray) -> np.ndarray:
    """What columns X leave of y; all of it without columns."""
    return y if X is None else np.asarray(y - X @ _solve(X, y))


def _solve_blocks(
    sums: str, G4: list[list[np.ndarray]], x: list[np.ndarray], sides: list[np.ndarray]
) -> list[np.ndarray]:
    """The equations of all inputs in one: G4 summed over one factor x of each input, with these right sides."""
    pairs = zip(G4, x, strict=True)
    A = np.block([[np.einsum(sums, g, xi, xj) for g, xj in zip(row, x, strict=True)] for row, xi in pairs])
    return np.split(np.linalg.solve(A, np.concatenate(sides)), np.cumsum([len(s) for s in sides])[:-1])
