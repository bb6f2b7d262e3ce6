"""Low-order output-error models of one input and output, for every delay: which delays does the record allow?

The errors are whitened by an autoregression, so that their colour neither hides nor feigns a delay (Ljung, System
Identification, 2nd ed. 1999, section 10.4: output error of filtered data). Orders and delay are weighed by BIC.
"""

from dataclasses import dataclass

import numpy as np
from scipy.signal import lfilter

from sysid.base.poles import mirrored
from sysid.data.record import IOData

_STEPS = 8
_COLOURS = 12  # highest order of the autoregression
_LARGEST = 0.99995  # radius of a pole
MOST = 4000  # samples


@dataclass(frozen=True)
class Model:
    """y = q^-nk B/F u with its criterion: twice the negative log likelihood and BIC's price of the parameters."""

    nk: int
    b: np.ndarray
    f: np.ndarray
    criterion: float


@dataclass(frozen=True)
class Piece:
    """Input, output and observed samples (n,) of one experiment."""

    u: np.ndarray
    y: np.ndarray
    seen: np.ndarray


def pieces(data: IOData, i: int, j: int) -> list[Piece]:
    """Input i and output j of the experiments, up to `MOST` samples in all."""
    found, left = [], MOST
    for e in data.experiments:
        n = min(e.N, left)
        if n >= 30:
            found.append(Piece(e.u[:n, i], e.y[:n, j], e.observed[:n, j]))
            left -= n
    return found


class Profile:
    """Models of a record by delay and orders; `colour` (m + 1,) is the filter that whitens the errors."""

    def __init__(self, parts: list[Piece]):
        self.parts = parts
        self.colour = np.ones(1)
        self.starts: dict[int, np.ndarray] = {}

    def model(self, nk: int, nf: int, nb: int, f: np.ndarray) -> Model:
        """The best model of this delay and these orders, from the denominator f (nf,)."""
        f = _inside(f)
        here = self._solved(nk, nb, f)
        for _ in range(_STEPS if nf else 0):
            J = self._columns(nk, f, here[1], nb)
            step = np.linalg.lstsq(J, here[2], rcond=1e-10)[0][:nf]
            scale, tried = 1.0, here
            while scale > 0.01:
                g = _inside(f + scale * step)
                tried = self._solved(nk, nb, g)
                if tried[0] < here[0]:
                    break
                scale *= 0.3
            else:
                break
            gain = here[0] - tried[0]
            f, here = g, tried
            if gain < 1e-5 * here[0]:
                break
        M = len(here[2])
        return Model(nk, here[1], f, M * np.log(here[0] / M + 1e-300) + (nf + nb) * np.log(M))

    def whiten(self, best: Model) -> None:
        """Take the colour of the errors of this model for all further ones."""
        self.colour = np.ones(1)
        nf = len(best.f)
        _, b, _ = self._solved(best.nk, len(best.b), best.f)
        v = []
        for part in self.parts:
            columns = _free(best.f, len(part.u), part.u, best.nk, len(best.b))
            x = columns[:, : len(b)] @ b
            rest = np.linalg.lstsq(columns[:, len(b) :], part.y - x, rcond=1e-10)[0]
            v.append(part.y - x - columns[:, len(b) :] @ rest)
        self.colour = _autoregression(v)
        del nf

    def _filtered(self, columns: np.ndarray, part: Piece) -> np.ndarray:
        m = len(self.colour) - 1
        white = lfilter(self.colour, [1.0], columns, axis=0)[m:]
        seen = part.seen
        keep = np.convolve(~seen, np.ones(m + 1))[m : len(seen)] == 0 if not seen.all() else slice(None)
        return np.asarray(white[keep])

    def _solved(self, nk: int, nb: int, f: np.ndarray) -> tuple[float, np.ndarray, np.ndarray]:
        """Loss, b (nb,) and errors for a denominator; initial states and a constant belong to each experiment."""
        X, y = self._stacked([_free(f, len(p.u), p.u, nk, nb) for p in self.parts], nb)
        c = np.linalg.lstsq(X, y, rcond=1e-10)[0]
        e = y - X @ c
        return float(e @ e), c[:nb], e

    def _columns(self, nk: int, f: np.ndarray, b: np.ndarray, nb: int) -> np.ndarray:
        """Jacobian with respect to f and b, and the columns of initial states."""
        nf, each = len(f), []
        den = np.concatenate([[1.0], f])
        for part in self.parts:
            free = _free(f, len(part.u), part.u, nk, nb)
            slope = lfilter([1.0], den, -(free[:, :nb] @ b))
            each.append(np.column_stack([*(_late(slope, j) for j in range(1, nf + 1)), free]))
        return self._stacked(each, nf + nb)[0]

    def _stacked(self, each: list[np.ndarray], common: int) -> tuple[np.ndarray, np.ndarray]:
        rows, ys = [], []
        for k, (part, columns) in enumerate(zip(self.parts, each, strict=True)):
            white = self._filtered(np.column_stack([columns, part.y]), part)
            own = white.shape[1] - 1 - common
            wide = np.zeros((len(white), common + own * len(each)))
            wide[:, :common] = white[:, :common]
            wide[:, common + k * own : common + (k + 1) * own] = white[:, common:-1]
            rows.append(wide)
            ys.append(white[:, -1])
        return np.concatenate(rows), np.concatenate(ys)


def _free(f: np.ndarray, n: int, u: np.ndarray, nk: int, nb: int) -> np.ndarray:
    """Columns (n, nb + nf + 1): the delayed inputs behind 1/F, the free responses of F, and a constant."""
    den = np.concatenate([[1.0], f])
    w = lfilter([1.0], den, u)
    impulse = np.zeros(n)
    impulse[0] = 1.0
    g = lfilter([1.0], den, impulse)
    return np.column_stack(
        [*(_late(w, nk + k) for k in range(nb)), *(_late(g, k) for k in range(len(f))), np.ones(n)]
    )


def _late(x: np.ndarray, k: int) -> np.ndarray:
    return np.concatenate([np.zeros(min(k, len(x))), x[: max(len(x) - k, 0)]])


def _inside(f: np.ndarray) -> np.ndarray:
    if not len(f):
        return f
    f = mirrored(f)
    size = np.max(np.abs(np.roots(np.concatenate([[1.0], f]))), initial=0.0)
    return f if size <= _LARGEST else np.asarray(f * (_LARGEST / size) ** np.arange(1, len(f) + 1))


def _autoregression(pieces: list[np.ndarray]) -> np.ndarray:
    """The whitening filter (m + 1,) of the order that AIC prefers."""
    most = min(_COLOURS, min(len(v) for v in pieces) // 10)
    X = np.concatenate([np.column_stack([v[most - k : len(v) - k] for k in range(most + 1)]) for v in pieces])
    best, found = np.inf, np.ones(1)
    for m in range(most + 1):
        c = np.linalg.lstsq(X[:, 1 : m + 1], X[:, 0], rcond=1e-10)[0] if m else np.zeros(0)
        aic = len(X) * np.log(np.mean((X[:, 0] - X[:, 1 : m + 1] @ c) ** 2) + 1e-300) + 2 * m
        if aic < best - 1e-9:
            best, found = aic, np.concatenate([[1.0], -c])
    return found
