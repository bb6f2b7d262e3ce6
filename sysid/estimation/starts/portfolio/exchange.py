"""Exchange of break points: which few of many places carry the best polygon.

In numpy: a few thousand small products in a search, for which nobody should wait until a kernel is compiled.
"""

import numpy as np


def polygon(
    G: np.ndarray, h: np.ndarray, places: np.ndarray, chosen: np.ndarray, ridge: float
) -> tuple[np.ndarray, float]:
    """Values (m,) at places[chosen] of the polygon that minimises v'G v - 2 h'v, and this minimum.

    G (k, k), h (k,), places (k,) rising, chosen (m,) rising with first 0 and last k - 1. Raises
    numpy.linalg.LinAlgError if G is singular.
    """
    W = _hats(places, chosen)
    g = W.T @ h
    values = np.linalg.solve(W.T @ G @ W + ridge * np.eye(len(chosen)), g)
    return values, -float(g @ values)


def exchange_places(
    G: np.ndarray, h: np.ndarray, places: np.ndarray, chosen: np.ndarray, ridge: float, sweeps: int, least: float
) -> tuple[np.ndarray, float]:
    """`chosen` (m,) after moving one inner place at a time to where the minimum of `polygon` is lowest, and this."""
    best_set, best = chosen, polygon(G, h, places, chosen, ridge)[1]
    for _ in range(sweeps):
        best_before = best
        for turn in range(1, len(chosen) - 1):
            rest = np.delete(best_set, turn)
            place = _best_addition(G, h, places, rest, ridge)
            if place is None or place == best_set[turn]:
                continue
            trial = np.sort(np.append(rest, place))
            cost = polygon(G, h, places, trial, ridge)[1]
            if cost < best:
                best, best_set = cost, trial
        if best_before - best < least:
            break
    return best_set, best


def _hats(places: np.ndarray, chosen: np.ndarray) -> np.ndarray:
    """Weights (k, m) of the values at places[chosen] in the polygon at all places."""
    i = np.arange(len(places))
    s = np.clip(np.searchsorted(chosen, i, side="right") - 1, 0, len(chosen) - 2)
    share = (places - places[chosen[s]]) / (places[chosen[s + 1]] - places[chosen[s]])
    W = np.zeros((len(places), len(chosen)))
    W[i, s], W[i, s + 1] = 1.0 - share, share
    return W


def _best_addition(G: np.ndarray, h: np.ndarray, places: np.ndarray, rest: np.ndarray, ridge: float) -> int | None:
    """The place that lowers the minimum of `polygon` most beside `rest` (n,), None if none does.

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
