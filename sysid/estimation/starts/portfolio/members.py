"""Where candidates for the poles of the filters come from."""

from collections.abc import Callable, Iterator
from functools import wraps

import numpy as np
from scipy.signal import lfilter

from sysid.base.poles import mirrored, monic
from sysid.estimation.starts._start import best_output_error, coefficients, delay, denominators, joined
from sysid.estimation.starts.portfolio.screen import Screen

Found = Iterator[np.ndarray]

_PASSES = 12  # of the prefiltered regression
_SLOW = (1.0, 2.5, 6.0, 15.0, 40.0, 100.0)  # [samples] time constants of the filters of the quadratic regression
Member = Callable[[Screen, np.random.Generator], Found]


def of_each_input(member: Member) -> Member:
    """A member for one input as one for several: the k-th poles that it finds for each input alone, for each k."""

    @wraps(member)
    def combined(screen: Screen, rng: np.random.Generator) -> Found:
        yield from joined([list(member(each, rng)) for each in screen.alone])

    return combined


def approximation(screen: Screen, rng: np.random.Generator) -> Found:
    """Instrumental variables at several rates: the best linear approximation."""
    yield from screen.linear_models


def output_error(screen: Screen, rng: np.random.Generator) -> Found:
    """The same after output error, whose poles may describe a curve in place of the dynamics."""
    linear = screen.linear
    yield best_output_error(linear, screen.linear_models, *screen.deviations)[coefficients(linear)[1]]


@of_each_input
def curved_input(screen: Screen, rng: np.random.Generator) -> Found:
    """A regression on past outputs and on hat functions of the input, prefiltered by its own 1/F until it stays.

    Steiglitz and McBride 1965 (IEEE Trans. Automatic Control 10) with the input map of Bai 1998 (Automatica 34): it
    needs no start and does not mind a map that folds.
    """
    if not screen.before:
        return
    (linear,) = screen.filters
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


@of_each_input
def even_part(screen: Screen, rng: np.random.Generator) -> Found:
    """A quadratic regression on low passes of the input; its main axes are signals, and each has a linear model.

    This finds the filter before a map that folds, where the output hardly correlates with the input.
    """
    (linear,) = screen.filters
    if not screen.behind or not linear.nf:
        return
    for (x,), _ in screen.trials:
        X = np.column_stack([delay(_low_pass(x, T), linear.nk) for T in _SLOW])
        X = np.column_stack([X, delay(x, linear.nk), delay(x, linear.nk + 1)])
        for w in _axes(X, screen)[:3]:
            w = np.concatenate([np.zeros(len(x) - len(w)), w])
            yield from denominators(linear, x, w, (4,))


@of_each_input
def ringing(screen: Screen, rng: np.random.Generator) -> Found:
    """How the output goes on by itself: poles of its autoregression, and these at half the frequency.

    A map that folds doubles the frequency of what rings before it.
    """
    (linear,) = screen.filters
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


@of_each_input
def drawn(screen: Screen, rng: np.random.Generator) -> Found:
    """Poles drawn over all time constants up to a tenth of the record."""
    (linear,) = screen.filters
    for _ in range(40 if linear.nf else 0):
        yield random_poles(linear.nf, len(screen.u), rng)


MEMBERS: dict[str, Member] = {
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
