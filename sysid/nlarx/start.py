"""Starts of a wavelet network: scaling from the data, a library of units, orthogonal least squares.

Zhang 1997, Using wavelet network in nonparametric estimation, IEEE Trans. Neural Networks 8(2): units of a dyadic grid
that cover data are the candidates, orthogonal least squares (Chen, Cowan and Grant 1991) selects them one by one, and
generalised cross-validation gives their number.
"""

import numpy as np

from sysid.nlarx.model import Network, Nlarx

_LEVELS = 4  # dyadic levels of the library, from one cell over all data
_PER_LEVEL = 150  # the fullest cells of a level
_ROWS = 4000  # rows that the selection uses
_FLAT = 1e-6  # a principal axis with less than this share of the widest one's spread holds no information
_STRETCH = 0.1  # axes narrower than this share of the widest keep their proportion to it


def empty_network(model: Nlarx, Phi: np.ndarray) -> Network:
    """The network without units, with scaling from the regressors Phi (N, n)."""
    mu, spread = Phi.mean(axis=0), Phi.std(axis=0)
    names = model.regressors if model.nonlinear is None else model.nonlinear
    take = [
        i for i, name in enumerate(model.regressors) if name in names and spread[i] > 1e-12 * np.abs(Phi[:, i]).max()
    ]
    T = np.zeros((len(take), Phi.shape[1]))
    if take:
        T[np.arange(len(take)), take] = 1.0 / spread[take]
        _, s, Vt = np.linalg.svd((Phi - mu) @ T.T / np.sqrt(len(Phi)), full_matrices=False)
        keep = s > _FLAT * s[0]
        # Full whitening would amplify the noise of the narrowest axes to the level of the signal.
        T = (Vt[keep] / np.maximum(s[keep], _STRETCH * s[0])[:, None]) @ T
    return Network(model, mu, np.ascontiguousarray(T))


def dyadic(X: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Dilations b (M,) and centres c (M, m): the cells of a dyadic grid that hold data X (N, m), level by level."""
    lo, span = X.min(axis=0), np.ptp(X, axis=0)
    span = np.where(span > 0, span, 1.0)
    width = float(span.mean())
    b, c = [], []
    for level in range(_LEVELS):
        cells = np.minimum(((X - lo) / span * 2**level).astype(int), 2**level - 1)
        found, count = np.unique(cells, axis=0, return_counts=True)
        found = found[np.argsort(-count, kind="stable")[:_PER_LEVEL]]
        c.append(lo + (found + 0.5) / 2**level * span)
        b.append(np.full(len(found), 2.0**level * 2.0 / width))
    return np.concatenate(b), np.concatenate(c)


def drawn(X: np.ndarray, rng: np.random.Generator, count: int = 300) -> tuple[np.ndarray, np.ndarray]:
    """Another library: centres among the data X (N, m), dilations over the same range as `dyadic`."""
    c = X[rng.integers(0, len(X), count)] + 0.1 * rng.normal(size=(count, X.shape[1]))
    width = float(np.mean(np.where(np.ptp(X, axis=0) > 0, np.ptp(X, axis=0), 1.0)))
    return 2.0 / width * np.exp(rng.uniform(np.log(0.5), np.log(2.0 ** (_LEVELS - 1)), count)), c


def network_start(
    empty: Network, Phi: np.ndarray, y: np.ndarray, rng: np.random.Generator | None = None
) -> tuple[Network, np.ndarray]:
    """The network and theta (P,) for Phi (N, n), y (N,): library, selection, weights by least squares over all rows.

    The library is the dyadic grid, or drawn by `rng`.
    """
    base = np.column_stack([np.ones(len(Phi)), Phi - empty.mu])
    theta = np.linalg.lstsq(base, y, rcond=None)[0]
    limit = min(empty.model.max_units, (len(y) - base.shape[1]) // (2 * (empty.m + 2)))
    if limit <= 0 or not empty.m or float(np.sum((y - base @ theta) ** 2)) <= 1e-20 * float(y @ y):
        return empty, theta
    X = empty.coordinates(Phi)
    b, c = dyadic(X) if rng is None else drawn(X, rng)
    rows = np.unique(np.linspace(0, len(y) - 1, _ROWS).astype(int)) if len(y) > _ROWS else np.arange(len(y))
    values = _values(X[rows], b, c)
    picked = _orthogonal(base[rows], values, y[rows], limit, empty.m, empty.model.units == "auto")
    picked = np.concatenate([picked[picked < len(b)], picked[picked >= len(b)]])  # wavelets first
    wavelets = int(np.sum(picked < len(b)))
    network = empty.with_units(wavelets, len(picked) - wavelets)
    b, c = b[picked % len(b)], c[picked % len(b)]
    whole = np.zeros(network.size)
    for k, at in enumerate(network.dilations):
        whole[at], whole[at + 1 : at + 1 + network.m] = b[k], c[k]
    return network, weights(network, whole, Phi, y)


def weights(network: Network, theta: np.ndarray, Phi: np.ndarray, y: np.ndarray) -> np.ndarray:
    """theta (P,) with all linear parameters (y0, L, s) by least squares, for Phi (N, n), y (N,)."""
    enters = np.concatenate([np.arange(1 + network.n), network.dilations - 1]).astype(int)
    solved = theta.copy()
    _, J = network.predict(theta, Phi, own=True)
    columns = J[:, enters]
    norm = np.linalg.norm(columns, axis=0)
    scale = np.where(norm > 0, norm, 1.0)
    solved[enters] = np.linalg.lstsq(columns / scale, y, rcond=1e-10)[0] / scale
    return solved


def _values(X: np.ndarray, b: np.ndarray, c: np.ndarray) -> np.ndarray:
    """Columns (N, 2 M): each candidate as a wavelet, then each as a scaling function."""
    r2 = np.sum(X**2, axis=1)[:, None] - 2.0 * X @ c.T + np.sum(c**2, axis=1)
    z2 = b**2 * np.maximum(r2, 0.0)
    e = np.exp(-0.5 * z2)
    return np.concatenate([(X.shape[1] - z2) * e, e], axis=1)


def _orthogonal(base: np.ndarray, G: np.ndarray, y: np.ndarray, limit: int, m: int, prune: bool) -> np.ndarray:
    """Columns of G (N, M) that explain y (N,) best beside `base`, greedily; with `prune` as many as GCV allows.

    GCV = N RSS / (N - d)^2 (Craven and Wahba 1979). Each unit counts as its m + 2 parameters plus ln M for the
    selection from M: the best of M columns of pure noise explains about 2 ln M of its variance.
    """
    N = len(y)
    Q = np.linalg.qr(base)[0]
    G, e = G - Q @ (Q.T @ G), y - Q @ (Q.T @ y)
    norm0 = np.sum(G**2, axis=0)
    usable = norm0 > 1e-12 * norm0.max(initial=0.0)
    picked: list[int] = []
    scores, cost = [N * float(e @ e) / (N - base.shape[1]) ** 2], m + 2 + np.log(G.shape[1])
    while len(picked) < limit:
        norm = np.sum(G**2, axis=0)
        usable &= norm > 1e-8 * norm0  # already explained by others
        if not usable.any() or float(e @ e) <= 1e-24 * float(y @ y):
            break
        k = int(np.argmax(np.where(usable, (e @ G) ** 2 / np.where(usable, norm, 1.0), -1.0)))
        q = G[:, k] / np.sqrt(norm[k])
        e = e - q * (q @ e)
        G -= np.outer(q, q @ G)
        usable[k] = False
        picked.append(k)
        left = N - base.shape[1] - len(picked) * cost
        scores.append(N * float(e @ e) / left**2 if left > 0 else np.inf)
    return np.array(picked[: int(np.argmin(scores))] if prune else picked, dtype=int)
