"""Compiled exchange of break points. Compiled at first call and cached on disk."""

import numpy as np

from sysid.base.compiled import kernel


@kernel
def polygon(G, h, places, chosen, ridge):
    """Values (m,) at places[chosen] of the polygon that minimises v'G v - 2 h'v, and this minimum.

    G (k, k), h (k,), places (k,) rising, chosen (m,) rising with first 0 and last k - 1. NaN values if G is singular.
    """
    k, m = places.shape[0], chosen.shape[0]
    segment, share = np.empty(k, dtype=np.int64), np.empty(k)
    for s in range(m - 1):
        for i in range(chosen[s], chosen[s + 1] + 1):
            segment[i] = s
            share[i] = (places[i] - places[chosen[s]]) / (places[chosen[s + 1]] - places[chosen[s]])
    A, g = np.zeros((m, m)), np.zeros(m)
    for i in range(k):
        a, ra = segment[i], share[i]
        g[a] += (1.0 - ra) * h[i]
        g[a + 1] += ra * h[i]
        for j in range(k):
            b, rb, v = segment[j], share[j], G[i, j]
            A[a, b] += (1.0 - ra) * (1.0 - rb) * v
            A[a, b + 1] += (1.0 - ra) * rb * v
            A[a + 1, b] += ra * (1.0 - rb) * v
            A[a + 1, b + 1] += ra * rb * v
    for a in range(m):
        A[a, a] += ridge
    c = np.linalg.solve(A, g)
    return c, -np.dot(g, c)


@kernel
def exchange_places(G, h, places, chosen, ridge, sweeps, least):
    """`chosen` (m,) after moving one inner place at a time to where the minimum of `polygon` is lowest."""
    m = chosen.shape[0]
    best_set = chosen.copy()
    best = polygon(G, h, places, best_set, ridge)[1]
    for _ in range(sweeps):
        best_before = best
        for turn in range(1, m - 1):
            rest = np.empty(m - 1, dtype=np.int64)
            n = 0
            for s in range(m):
                if s != turn:
                    rest[n] = best_set[s]
                    n += 1
            place = best_addition(G, h, places, rest, ridge)
            if place < 0 or place == best_set[turn]:
                continue
            trial = np.empty(m, dtype=np.int64)
            trial[: m - 1] = rest
            trial[m - 1] = place
            trial.sort()
            cost = polygon(G, h, places, trial, ridge)[1]
            if cost < best:
                best, best_set = cost, trial
        if best_before - best < least:
            break
    return best_set, best


@kernel
def best_addition(G, h, places, rest, ridge):
    """The place that lowers the minimum of `polygon` most beside `rest` (n,), -1 if none does.

    One more place adds one tent between its neighbours to the curves: a regression that grows by one column.
    """
    k, n = places.shape[0], rest.shape[0]
    GW, B, A = np.zeros((k, n)), np.zeros((n, k + 1)), np.zeros((n, n))
    for s in range(n - 1):
        a, b = rest[s], rest[s + 1]
        for j in range(a if s == 0 else a + 1, b + 1):
            r = (places[j] - places[a]) / (places[b] - places[a])
            for i in range(k):
                GW[i, s] += (1.0 - r) * G[j, i]
                GW[i, s + 1] += r * G[j, i]
            B[s, k] += (1.0 - r) * h[j]
            B[s + 1, k] += r * h[j]
    B[:, :k] = GW.T
    for s in range(n - 1):
        a, b = rest[s], rest[s + 1]
        for j in range(a if s == 0 else a + 1, b + 1):
            r = (places[j] - places[a]) / (places[b] - places[a])
            for i in range(n):
                A[s, i] += (1.0 - r) * GW[j, i]
                A[s + 1, i] += r * GW[j, i]
    for s in range(n):
        A[s, s] += ridge
    X = np.linalg.solve(A, B)
    best, place = 0.0, -1
    tent, v, x = np.zeros(k), np.zeros(n), np.zeros(n)
    for s in range(n - 1):
        a, b = rest[s], rest[s + 1]
        for i in range(a + 1, b):
            size, slope = ridge, 0.0
            v[:] = 0.0
            x[:] = 0.0
            for j in range(a + 1, b):
                begin, end = (a, i) if j <= i else (b, i)
                tent[j] = (places[j] - places[begin]) / (places[end] - places[begin])
            for j in range(a + 1, b):
                slope += tent[j] * h[j]
                for t in range(n):
                    v[t] += tent[j] * GW[j, t]
                    x[t] += tent[j] * X[t, j]
                for t in range(a + 1, b):
                    size += tent[j] * tent[t] * G[j, t]
            full_size = size
            for t in range(n):
                size -= v[t] * x[t]
                slope -= v[t] * X[t, k]
            if size > 1e-12 * full_size and slope * slope / size > best:
                best, place = slope * slope / size, i
    return place


@kernel
def chords(knots, values, mass):
    """Weighed squares (k, k) between a curve, values at `knots` (k,), and the chord from knot i to knot j > i."""
    k = knots.shape[0]
    cost = np.full((k, k), np.inf)
    for i in range(k - 1):
        for j in range(i + 1, k):
            slope, total = (values[j] - values[i]) / (knots[j] - knots[i]), 0.0
            for t in range(i + 1, j):
                deviation = values[t] - values[i] - slope * (knots[t] - knots[i])
                total += mass[t] * deviation * deviation
            cost[i, j] = total
    return cost
