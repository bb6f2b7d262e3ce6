"""Exchange of break points: which few of many places carry the best polygon.

In numpy: a few thousand small products in a search, for which nobody should wait until a kernel is compiled.
"""

from dataclasses import dataclass, field

import numpy as np


@dataclass(frozen=True)
class Polygons:
    """Polygons v through a few of `places` (k,), rising, judged by v'G v - 2 h'v + ridge |v|^2; G (k, k), h (k,).

    `chosen` are numbers (m,) of places, rising, with first 0 and last k - 1. A singular G without a ridge raises
    numpy.linalg.LinAlgError.
    """

    G: np.ndarray
    h: np.ndarray
    places: np.ndarray
    ridge: float
    additions: dict[bytes, int | None] = field(default_factory=dict)  # several exchanges meet the same places

    def best(self, chosen: np.ndarray) -> tuple[np.ndarray, float]:
        """Values (m,) at places[chosen] of the best polygon, and its minimum."""
        W = _hats(self.places, chosen)
        g = W.T @ self.h
        values = np.linalg.solve(W.T @ self.G @ W + self.ridge * np.eye(len(chosen)), g)
        return values, -float(g @ values)

    def exchanged(self, chosen: np.ndarray, sweeps: int, least: float) -> tuple[np.ndarray, float]:
        """`chosen` after moving one inner place at a time to where the minimum of `best` is lowest, and this."""
        best_set, best = chosen, self.best(chosen)[1]
        for _ in range(sweeps):
            best_before = best
            for turn in range(1, len(chosen) - 1):
                rest = np.concatenate([best_set[:turn], best_set[turn + 1 :]])
                place = self._addition(rest)
                if place is None or place == best_set[turn]:
                    continue
                trial = np.sort(np.append(rest, place))
                cost = self.best(trial)[1]
                if cost < best:
                    best, best_set = cost, trial
            if best_before - best < least:
                break
        return best_set, best

    def _addition(self, rest: np.ndarray) -> int | None:
        key = rest.tobytes()
        if key not in self.additions:
            self.additions[key] = _best_addition(self.G, self.h, self.places, rest, self.ridge)
        return self.additions[key]


def _hats(places: np.ndarray, chosen: np.ndarray) -> np.ndarray:
    """Weights (k, m) of the values at places[chosen] in the polygon at all places."""
    i = np.arange(len(places))
    s = np.clip(np.searchsorted(chosen, i, side="right") - 1, 0, len(chosen) - 2)
    share = (places - places[chosen[s]]) / (places[chosen[s + 1]] - places[chosen[s]])
    W = np.zeros((len(places), len(chosen)))
    W[i, s], W[i, s + 1] = 1.0 - share, share
    return W


def _best_addition(G: np.ndarray, h: np.ndarray, places: np.ndarray, rest: np.ndarray, ridge: float) -> int | None:
    """The place that lowers the minimum of `Polygons.best` most beside `rest` (n,), None if none does.

    One more place adds one tent between its neighbours to the curves: a regression that grows by one column.
    """
    W = _hats(places, rest)
    inner = np.delete(np.arange(len(places)), rest)
    s = np.searchsorted(rest, inner)
    left, right, top = places[rest[s - 1]], places[rest[s]], places[inner]
    x = places[:, None]
    tents = np.maximum(np.minimum((x - left) / (top - left), (right - x) / (right - top)), 0.0)
    GW = G @ W
    V, full_size = GW.T @ tents, ridge + np.sum(tents * (G @ tents), axis=0)
    X = np.linalg.solve(W.T @ GW + ridge * np.eye(len(rest)), np.column_stack([V, W.T @ h]))
    size, slope = full_size - np.sum(V * X[:, :-1], axis=0), h @ tents - X[:, -1] @ V
    sound = size > 1e-12 * full_size
    gain = np.divide(slope**2, size, out=np.zeros_like(size), where=sound)
    return int(inner[gain.argmax()]) if gain.max(initial=0.0) > 0.0 else None


def chords(knots: np.ndarray, values: np.ndarray, mass: np.ndarray) -> np.ndarray:
    """Weighed squares (k, k) between a curve, values at `knots` (k,), and the chord from knot i to knot j > i."""
    k = len(knots)
    dx, dy = knots[None, :] - knots[:, None], values[None, :] - values[:, None]
    slope = np.divide(dy, dx, out=np.zeros((k, k)), where=dx != 0)
    deviation = dy[:, None, :] - slope[:, :, None] * dx[:, None, :]  # from the chord of i and j, at knot t
    number = np.arange(k)
    i, j, t = number[:, None, None], number[None, :, None], number[None, None, :]
    cost = np.sum(np.where((i < t) & (t < j), mass * deviation**2, 0.0), axis=2)
    return np.where(number[:, None] < number[None, :], cost, np.inf)
