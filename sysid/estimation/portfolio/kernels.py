"""Compiled exchange of break points. Compiled at first call and cached on disk."""

import numpy as np
from numba import njit


@njit(cache=True, nogil=True)
def polygon(G, h, places, chosen, ridge):
    """Values (m,) at places[chosen] of the polygon that minimises v'G v - 2 h'v, and this minimum.

    G (k, k), h (k,), places (k,) rising, chosen (m,) rising with first 0 and last k - 1. NaN values if G is singular.
    """
    k, m = places.shape[0], chosen.shape[0]
    left, share = np.empty(k, dtype=np.int64), np.empty(k)
    for s in range(m - 1):
        for i in range(chosen[s], chosen[s + 1] + 1):
            left[i] = s
            share[i] = (places[i] - places[chosen[s]]) / (places[chosen[s + 1]] - places[chosen[s]])
    A, g = np.zeros((m, m)), np.zeros(m)
    for i in range(k):
        a, ra = left[i], share[i]
        g[a] += (1.0 - ra) * h[i]
        g[a + 1] += ra * h[i]
        for j in range(k):
            b, rb, v = left[j], share[j], G[i, j]
            A[a, b] += (1.0 - ra) * (1.0 - rb) * v
            A[a, b + 1] += (1.0 - ra) * rb * v
            A[a + 1, b] += ra * (1.0 - rb) * v
            A[a + 1, b + 1] += ra * rb * v
    for a in range(m):
        A[a, a] += ridge
    c = np.linalg.solve(A, g)
    return c, -np.dot(g, c)


@njit(cache=True, nogil=True)
def exchanged(G, h, places, chosen, ridge, sweeps, least):
    """`chosen` (m,) after moving one inner place at a time to where the minimum of `polygon` is lowest."""
    k, m = places.shape[0], chosen.shape[0]
    best_set = chosen.copy()
    best = polygon(G, h, places, best_set, ridge)[1]
    for _ in range(sweeps):
        before = best
        for turn in range(1, m - 1):
            others = np.empty(m - 1, dtype=np.int64)
            n = 0
            for s in range(m):
                if s != turn:
                    others[n] = best_set[s]
                    n += 1
            kept = best_set
            for i in range(1, k - 1):
                if np.any(others == i):
                    continue
                trial = np.empty(m, dtype=np.int64)
                trial[: m - 1] = others
                trial[m - 1] = i
                trial.sort()
                cost = polygon(G, h, places, trial, ridge)[1]
                if cost < best:
                    best, kept = cost, trial
            best_set = kept
            if turn >= m - 1:
                break
        if before - best < least:
            break
    return best_set, best
