"""Curves through points at given places: linear in their values, so that least squares finds them at once."""

import numpy as np

_SAMPLE = 1000  # samples of a signal that give its quantiles
_FEW = 1e-6  # weight of the bends of a curve, relative to the data: it only decides where there are no data


def places(x: np.ndarray, count: int) -> np.ndarray:
    """`count` places over x (N,), half way between equal distances and equal numbers of samples."""
    even = np.linspace(float(x.min()), float(x.max()), count)
    if even[-1] <= even[0]:
        return even[0] + np.linspace(0.0, 1.0, count)
    sample = np.sort(x[:: max(1, len(x) // _SAMPLE)])
    quantiles = sample[np.linspace(0, len(sample) - 1, count).round().astype(int)]
    quantiles[0], quantiles[-1] = even[0], even[-1]
    return 0.5 * even + 0.5 * quantiles


def within(x: np.ndarray, at: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """For x (N,): the place (N,) of `at` (k,) before it, and how far it is towards the next (N,), 0 to 1 inside."""
    i = np.clip(np.searchsorted(at, x) - 1, 0, len(at) - 2)
    return i, (x - at[i]) / (at[i + 1] - at[i])


def columns(x: np.ndarray, at: np.ndarray) -> np.ndarray:
    """The hat functions (N, k) at x (N,): a curve is a sum of them, weighted by its values at the places."""
    i, r = within(x, at)
    H = np.zeros((len(x), len(at)))
    rows = np.arange(len(x))
    H[rows, i], H[rows, i + 1] = 1.0 - r, r
    return H


def fitted(x: np.ndarray, y: np.ndarray, at: np.ndarray) -> tuple[np.ndarray, float]:
    """Values (k,) of the curve of least squares from x to y (N,), and its mean squared error."""
    i, r = within(x, at)
    k, s = len(at), 1.0 - r
    near, far = np.bincount(i, s * s, k), np.bincount(i + 1, r * r, k)
    cross = np.bincount(i, s * r, k)[:-1]
    A = np.diag(near + far) + np.diag(cross, 1) + np.diag(cross, -1)
    h = np.bincount(i, s * y, k) + np.bincount(i + 1, r * y, k)
    bend = np.zeros((k - 2, k))
    width = np.diff(at) / (at[-1] - at[0])
    for j in range(k - 2):
        bend[j, j : j + 3] = 1.0 / width[j], -1.0 / width[j] - 1.0 / width[j + 1], 1.0 / width[j + 1]
    A += _FEW * len(x) / k**3 * bend.T @ bend + 1e-12 * len(x) * np.eye(k)
    try:
        values = np.linalg.solve(A, h)
    except np.linalg.LinAlgError:
        return np.full(k, y.mean()), float(y.var())
    e = y - values[i] * s - values[i + 1] * r
    return values, float(e @ e) / len(e)


def fewer(at: np.ndarray, values: np.ndarray, mass: np.ndarray, count: int) -> np.ndarray:
    """`count` of the places `at` (k,): the polygon through them is nearest to the curve, weighed by `mass` (k,).

    Shortest path over the chords between two places each (Bellman 1961, Comm. ACM 4): the exact best choice.
    """
    k = len(at)
    if k <= count:
        return at
    from sysid.estimation.portfolio.kernels import chords

    cost = chords(np.ascontiguousarray(at), np.ascontiguousarray(values), np.ascontiguousarray(mass))
    best, back = np.full((count, k), np.inf), np.zeros((count, k), dtype=int)
    best[0, 0] = 0.0
    for m in range(1, count):
        total = best[m - 1][:, None] + cost
        back[m], best[m] = total.argmin(axis=0), total.min(axis=0)
    chosen = [k - 1]
    for m in range(count - 1, 0, -1):
        chosen.append(int(back[m, chosen[-1]]))
    return at[chosen[::-1]]


def mass(x: np.ndarray, at: np.ndarray) -> np.ndarray:
    """Samples of x (N,) around each place (k,)."""
    i, r = within(x, at)
    r = np.clip(r, 0.0, 1.0)
    return np.bincount(i, 1.0 - r, len(at)) + np.bincount(i + 1, r, len(at))
