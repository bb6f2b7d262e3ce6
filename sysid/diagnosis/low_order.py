"""Low-order output-error models of one input and output, for every delay: which delays does the record allow?

The errors are whitened by an autoregression, so that their colour neither hides nor feigns a delay (Ljung, System
Identification, 2nd ed. 1999, section 10.4: output error of filtered data). Orders and delay are weighed by BIC.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from scipy.signal import lfilter

from sysid.base.poles import mirrored
from sysid.data.record import IOData

_STEPS = 6
_COLOURS = 12  # highest order of the autoregression
_LARGEST = 1.0 - 1e-9  # radius of a pole: an integrator drifts nowhere within a record
MOST = 3000  # samples


@dataclass(frozen=True)
class Model:
    """y = q^-nk B/F u with its criterion: twice the negative log likelihood and BIC's price of the parameters.

    `variance` is that of its whitened errors.
    """

    nk: int
    b: np.ndarray
    f: np.ndarray
    criterion: float
    variance: float


@dataclass(frozen=True)
class Piece:
    """Input, output and observed samples (n,) of one experiment."""

    u: np.ndarray
    y: np.ndarray
    seen: np.ndarray


def pieces(data: IOData, i: int, j: int) -> list[Piece]:
    """Input i and output j of the experiments, up to `MOST` samples in all."""
    parts, remaining = [], MOST
    for e in data.experiments:
        n = min(e.N, remaining)
        if n >= 30:
            parts.append(Piece(e.u[:n, i], e.y[:n, j], e.observed[:n, j]))
            remaining -= n
    return parts


@dataclass(frozen=True)
class _Solution:
    """Loss, b and errors for one denominator; the columns X of all experiments, whitened.

    `responses` are those of each experiment to the input and to its initial state.
    """

    loss: float
    b: np.ndarray
    e: np.ndarray
    responses: list[np.ndarray]
    X: np.ndarray


class Profile:
    """Models of a record by delay and orders; `colour` (m + 1,) is the filter that whitens the errors.

    The outputs of the first `begin` samples are left out: longer delays than that lack their inputs.
    """

    def __init__(self, parts: list[Piece], begin: int = 0):
        self.parts = [replace(p, seen=p.seen & (np.arange(len(p.y)) >= begin)) for p in parts]
        self.begin = begin
        self.colour = np.ones(1)

    def model(self, nk: int, nf: int, nb: int, f: np.ndarray) -> Model:
        """The best model of this delay and these orders, from the denominator f (nf,)."""
        f = _stabilise(f)
        solution = self._solve(nk, nb, f)
        for _ in range(_STEPS if nf else 0):
            step = self._step(f, solution)
            scale, trial = 1.0, solution
            while scale > 0.01:
                g = _stabilise(f + scale * step)
                trial = self._solve(nk, nb, g)
                if trial.loss < solution.loss:
                    break
                scale *= 0.3
            else:
                break
            gain = solution.loss - trial.loss
            f, solution = g, trial
            if gain < 1e-4 * solution.loss:
                break
        M = len(solution.e)
        criterion = M * np.log(solution.loss / M + 1e-300) + (nf + nb) * np.log(M)
        return Model(nk, solution.b, f, criterion, solution.loss / max(M - nf - nb, 1))

    def whiten(self, best: Model) -> None:
        """Take the colour of the errors of this model for all further ones."""
        self.colour = np.ones(1)
        e = self._solve(best.nk, len(best.b), best.f).e
        ends = np.cumsum([int(p.seen.sum()) for p in self.parts])
        self.colour = _autoregression(np.split(e, ends[:-1]))

    def _whiten_columns(self, columns: np.ndarray, part: Piece) -> np.ndarray:
        m = len(self.colour) - 1
        white = sliding_window_view(columns, m + 1, axis=0) @ self.colour[::-1] if m else columns
        observed = part.seen
        keep = np.convolve(~observed, np.ones(m + 1))[m : len(observed)] == 0 if not observed.all() else slice(None)
        return np.asarray(white[keep])

    def _solve(self, nk: int, nb: int, f: np.ndarray) -> "_Solution":
        """The best b for a denominator; initial states and a constant belong to each experiment."""
        columns = [_free(f, p.u, nk, nb, self.begin) for p in self.parts]
        X, y = self._stack(columns, nb)
        c, e = _least(X, y)
        own = c[nb:].reshape(len(columns), -1)[:, :-1]  # states, without the constant
        responses = [x[:, :-1] @ np.concatenate([c[:nb], state]) for x, state in zip(columns, own, strict=True)]
        return _Solution(float(e @ e), c[:nb], e, responses, X)

    def _step(self, f: np.ndarray, solution: "_Solution") -> np.ndarray:
        """Gauss-Newton step of f with b and the initial states solved for (variable projection, Kaufman's form)."""
        nf, den = len(f), np.concatenate([[1.0], f])
        slopes = [lfilter([1.0], den, -response) for response in solution.responses]
        columns = [np.column_stack([delay_by(s, j) for j in range(1, nf + 1)]) for s in slopes]
        J = self._stack(columns, nf)[0]
        return _least(np.column_stack([J, solution.X]), solution.e)[0][:nf]

    def _stack(self, columns_of_parts: list[np.ndarray], common: int) -> tuple[np.ndarray, np.ndarray]:
        rows, ys = [], []
        for k, (part, columns) in enumerate(zip(self.parts, columns_of_parts, strict=True)):
            white = self._whiten_columns(np.column_stack([columns, part.y]), part)
            width = white.shape[1] - 1 - common
            wide = np.zeros((len(white), common + width * len(columns_of_parts)))
            wide[:, :common] = white[:, :common]
            wide[:, common + k * width : common + (k + 1) * width] = white[:, common:-1]
            rows.append(wide)
            ys.append(white[:, -1])
        return np.concatenate(rows), np.concatenate(ys)


def _free(f: np.ndarray, u: np.ndarray, nk: int, nb: int, begin: int) -> np.ndarray:
    """Columns (n, nb + nf + 1): the delayed inputs behind 1/F, the responses of F to a state at `begin`, a constant."""
    den, n = np.concatenate([[1.0], f]), len(u)
    w = lfilter([1.0], den, u)
    impulse = np.zeros(n)
    impulse[begin] = 1.0
    g = lfilter([1.0], den, impulse)
    return np.column_stack(
        [*(delay_by(w, nk + k) for k in range(nb)), *(delay_by(g, k) for k in range(len(f))), np.ones(n)]
    )


def _least(X: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Least squares: coefficients, and the errors."""
    norm = np.linalg.norm(X, axis=0)
    norm = np.where(norm > 0, norm, 1.0)
    R = np.asarray(np.linalg.qr(np.column_stack([X / norm, y]), mode="r"))
    c = np.linalg.lstsq(R[:-1, :-1], R[:-1, -1], rcond=1e-10)[0] / norm
    return c, y - X @ c


def delay_by(x: np.ndarray, k: int) -> np.ndarray:
    """x (N,) later by k samples, with zeros before."""
    return np.concatenate([np.zeros(min(k, len(x))), x[: max(len(x) - k, 0)]])


def _stabilise(f: np.ndarray) -> np.ndarray:
    if _lies_within(_LARGEST, f.tolist()):
        return f
    f = mirrored(f)
    size = float(np.max(np.abs(np.linalg.eigvals(_companion(f))), initial=0.0))
    return f if size <= _LARGEST else np.asarray(f * (_LARGEST / size) ** np.arange(1, len(f) + 1))


def _lies_within(radius: float, f: list[float]) -> bool:
    """Whether the roots of 1 + f1 z^-1 + ... lie within a circle: the reflection coefficients say so (Schur, Cohn)."""
    f = [c / radius**k for k, c in enumerate(f, 1)]
    while f:
        last = f.pop()
        if not abs(last) < 1.0:
            return False
        f = [(c - last * d) / (1.0 - last**2) for c, d in zip(f, reversed(f), strict=True)]
    return True


def _companion(f: np.ndarray) -> np.ndarray:
    M = np.eye(len(f), k=-1)
    M[0] = -f
    return M


def _autoregression(pieces: list[np.ndarray]) -> np.ndarray:
    """The whitening filter (m + 1,) of the order that AIC prefers."""
    highest_order = min(_COLOURS, min(len(v) for v in pieces) // 10)
    X = np.concatenate(
        [np.column_stack([v[highest_order - k : len(v) - k] for k in range(highest_order + 1)]) for v in pieces]
    )
    best, whitening_filter = np.inf, np.ones(1)
    for m in range(highest_order + 1):
        c = np.linalg.lstsq(X[:, 1 : m + 1], X[:, 0], rcond=1e-10)[0] if m else np.zeros(0)
        aic = len(X) * np.log(np.mean((X[:, 0] - X[:, 1 : m + 1] @ c) ** 2) + 1e-300) + 2 * m
        if aic < best - 1e-9:
            best, whitening_filter = aic, np.concatenate([[1.0], -c])
    return whitening_filter
