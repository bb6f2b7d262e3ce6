"""Which delays of an input a record allows: one regression for each delay of a range that follows the record.

Every regression explains the output by its own past, which whitens its noise, and by the input behind lags of several
time constants, as it was a delay ago: a rough model of any plant in which nothing happens before. All use the same
rows, so that their likelihoods compare; correlations by FFT make a range of hundreds of delays cost milliseconds.
"""

from dataclasses import dataclass

import numpy as np
from scipy.fft import irfft, next_fast_len, rfft
from scipy.signal import lfilter
from scipy.special import fdtrc

from sysid.data.record import IOData
from sysid.diagnosis.low_order import Piece, pieces

_SHARE = 5  # all delays are judged by the same rows: the record without its first fifth, the longest delay
# Measured on 160 drawn plants of one to three poles, SNR 10 to 40 dB: the true delay is within 32 of the best.
_PAST, _POLES = 12, (0.0, 0.5, 0.75, 0.9, 0.96, 0.985)
_RIDGE = 1e-9  # of a column's norm: an input without power somewhere determines no more


@dataclass(frozen=True)
class DelayRange:
    """Delays 0..L that are tried: `criteria` (L + 1,) is minus twice the log likelihood of each.

    `p` is the probability that chance alone makes the best of them as good, of an input without any effect.
    """

    criteria: np.ndarray
    p: float = 1.0

    @property
    def longest(self) -> int:
        """The longest delay that is tried."""
        return len(self.criteria) - 1

    def within(self, difference: float) -> np.ndarray:
        """The delays whose criterion is at most so much above the best."""
        return np.flatnonzero(self.criteria <= self.criteria.min() + difference)

    def first(self, level: float) -> int:
        """The first delay that is not excluded at this level, which all delays of the range share."""
        possible = self.within(2.0 * float(np.log(len(self.criteria) / level)))
        return int(possible[0]) if len(possible) else 0  # experiments too short for any


def delay_ranges(data: IOData, j: int, level: float) -> tuple[DelayRange, ...]:
    """The range of delays from every input to output j; each input is judged with the likely delays of the others."""
    columns = [pieces(data, i, j) for i in range(data.u.shape[1])]
    ranges, starts = {}, dict.fromkeys(range(len(columns)), 0)
    for i in [*starts, *starts] if len(columns) > 1 else starts:
        ranges[i] = _delay_range(columns[i], [(columns[k], starts[k]) for k in starts if k != i])
        starts[i] = ranges[i].first(level)
    return tuple(ranges[i] for i in starts)


def _delay_range(parts: list[Piece], others: list[tuple[list[Piece], int]]) -> DelayRange:
    """Criteria of the delays of the pieces' input; the other inputs act after the delay that is given with each."""
    total = sum(len(p.y) for p in parts)
    longest, past = total // (_SHARE * max(len(parts), 1)), min(_PAST, total // 20)
    experiments = [
        _Part.of(p, [(its_pieces[k].u, delay) for its_pieces, delay in others], longest, past)
        for k, p in enumerate(parts)
        if len(p.y) > longest + 2 * past
    ]
    if not experiments:
        return DelayRange(np.zeros(1))
    X, y = np.concatenate([p.X for p in experiments]), np.concatenate([p.y for p in experiments])
    used = np.concatenate([p.used for p in experiments])
    Q = np.linalg.qr(X[used] / np.maximum(np.linalg.norm(X[used], axis=0), 1e-300))[0]
    e = y[used] - Q @ (Q.T @ y[used])
    rows = np.zeros((len(y), Q.shape[1] + 2))
    rows[used] = np.column_stack([Q, e, np.ones(len(e))])
    ends = np.cumsum([len(p.y) for p in experiments])[:-1]
    size = len(_POLES)
    G, r = np.zeros((longest + 1, size, size)), np.zeros((longest + 1, size))
    projections = np.zeros((longest + 1, Q.shape[1], size))
    for part, weights in zip(experiments, np.split(rows, ends), strict=True):
        products = np.einsum("gt,ht->ght", part.lagged, part.lagged).reshape(size * size, -1)
        cross = _correlations(weights[:, :-1].T, part.lagged, longest)
        projections += cross[:-1].transpose(2, 0, 1)
        r += cross[-1].T
        G += _correlations(weights[:, -1:].T, products, longest)[0].T.reshape(-1, size, size)
    G -= np.einsum("srg,srh->sgh", projections, projections)
    norm = np.sqrt(np.maximum(np.einsum("sgg->sg", G), 1e-300))
    G = G / (norm[:, :, None] * norm[:, None, :]) + _RIDGE * np.eye(size)
    r = r / norm
    gain = np.sum(r * np.linalg.solve(G, r[:, :, None])[:, :, 0], axis=1)
    loss = np.maximum(float(e @ e) - gain, 1e-12 * float(np.sum((y[used] - y[used].mean()) ** 2)) + 1e-300)
    freedom = len(e) - Q.shape[1] - size
    ratio = (float(e @ e) / loss.min() - 1.0) * freedom / size
    p = min(1.0, (longest + 1) * float(fdtrc(size, freedom, max(ratio, 0.0)))) if freedom > 0 else 1.0
    return DelayRange(len(e) * np.log(loss / len(e)), p)


def _correlations(a: np.ndarray, w: np.ndarray, longest: int) -> np.ndarray:
    """Sums over t of a (k, N) at t times w (m, N) at t - s for s = 0..longest: (k, m, longest + 1)."""
    n = next_fast_len(a.shape[1] + longest + 1, real=True)
    A, W = rfft(a, n), rfft(w, n)
    return np.asarray(irfft(A[:, None, :] * W.conj()[None, :, :], n)[:, :, : longest + 1])


@dataclass(frozen=True)
class _Part:
    """One experiment: columns X (N, r) that no delay changes, output y (N,), rows in use, input behind lags (g, N)."""

    X: np.ndarray
    y: np.ndarray
    used: np.ndarray
    lagged: np.ndarray

    @classmethod
    def of(cls, piece: Piece, others: list[tuple[np.ndarray, int]], longest: int, past: int) -> "_Part":
        y, first = piece.y - piece.y.mean(), longest + past
        columns = [np.ones(len(y)), *(np.roll(y, k) for k in range(1, past + 1))]
        for u, delay in others:
            columns += [np.roll(w, delay) for w in _behind_lags(u)]
        used = np.convolve(~piece.seen, np.ones(past + 1))[: len(y)] == 0
        used[:first] = False
        return cls(np.column_stack(columns), y, used, _behind_lags(piece.u))


def _behind_lags(u: np.ndarray) -> np.ndarray:
    """The input u (N,) behind first-order lags, each of unit size (g, N)."""
    u = u - u.mean()
    lagged = np.array([lfilter([1.0 - a], [1.0, -a], u) for a in _POLES])
    return np.asarray(lagged / np.maximum(lagged.std(axis=1, keepdims=True), 1e-300))
