"""Compiled loops over samples. Compiled at first call, never at import, and cached on disk."""

import numpy as np

from sysid.base.compiled import kernel


@kernel
def filter_tangent(b, f, c, w, x, J, q):
    """x_t = sum b_i w_{t-i} - sum f_j x_{t-j} + c_t, and the same filter over columns 0..q-1 of J, in place.

    b (n+1,) with the delay as leading zeros, f (n,) without the leading one, c (n,) what the samples before the record
    add to the first n; w (N,) in, x (N,) out; J (N, P). Transposed direct form II: one state row a lag, so that a
    column can be overwritten while it is read.
    """
    n = f.shape[0]
    filter_piece(b, f, c, 0, w, x, J, q, np.zeros(n + 1), np.zeros((n + 1, q)))


@kernel
def filter_piece(b, f, c, first, w, x, J, q, s, S):
    """`filter_tangent` on samples `first`.. of a record, from the states s (n+1,) and S (n+1, q), which it moves on."""
    N, n = w.shape[0], f.shape[0]
    for t in range(N):
        v = s[0] + b[0] * w[t]
        if first + t < n:
            v += c[first + t]
        x[t] = v
        for i in range(n):
            s[i] = s[i + 1] + b[i + 1] * w[t] - f[i] * v
        for j in range(q):
            dv = S[0, j] + b[0] * J[t, j]
            for i in range(n):
                S[i, j] = S[i + 1, j] + b[i + 1] * J[t, j] - f[i] * dv
            J[t, j] = dv


@kernel
def all_pole(f, x, y):
    """y_t = x_t - sum f_j y_{t-j}: x (N,) through 1/F into y (N,)."""
    n = f.shape[0]
    for t in range(x.shape[0]):
        v = x[t]
        for j in range(min(n, t)):
            v -= f[j] * y[t - 1 - j]
        y[t] = v


@kernel
def all_pole_after(f, x, y, past):
    """The same into y (past + N,) after its first `past` entries, the outputs before x (N,), at least as many as f."""
    n = f.shape[0]
    for t in range(x.shape[0]):
        v = x[t]
        for j in range(n):
            v -= f[j] * y[past + t - 1 - j]
        y[past + t] = v


@kernel
def lagged(g, lag, sign, J, column):
    """Column of J (N, P) becomes sign times g (N,) delayed by `lag` samples, zeros before."""
    for t in range(g.shape[0]):
        J[t, column] = sign * g[t - lag] if t >= lag else 0.0


@kernel
def piecewise_linear(kx, ky, x, y, slope, J, q, own):
    """Interpolation through knots (kx, ky) sorted by kx, end slopes extended; own Jacobian columns from q if `own`.

    Columns q..q+n-1 are d/dkx, q+n..q+2n-1 are d/dky; the other columns of J are left alone.
    """
    n = kx.shape[0]
    for t in range(x.shape[0]):
        i = np.searchsorted(kx, x[t]) - 1
        i = min(max(i, 0), n - 2)
        a = (ky[i + 1] - ky[i]) / (kx[i + 1] - kx[i])
        r = (x[t] - kx[i]) / (kx[i + 1] - kx[i])
        y[t] = ky[i] + r * (ky[i + 1] - ky[i])
        slope[t] = a
        if own:
            for j in range(2 * n):
                J[t, q + j] = 0.0
            J[t, q + i] = -a * (1.0 - r)
            J[t, q + i + 1] = -a * r
            J[t, q + n + i] = 1.0 - r
            J[t, q + n + i + 1] = r


@kernel
def sigmoid_network(theta, x, y, slope, J, q, own):
    """y0 + L x + sum s_k f(b_k x + c_k), f(z) = 1/(1 + e^-z); theta = y0, L, s (n,), b (n,), c (n,)."""
    n = (theta.shape[0] - 2) // 3
    for t in range(x.shape[0]):
        v, a = theta[0] + theta[1] * x[t], theta[1]
        for k in range(n):
            s, b = theta[2 + k], theta[2 + n + k]
            z = 1.0 / (1.0 + np.exp(-(b * x[t] + theta[2 + 2 * n + k])))
            dz = z * (1.0 - z)
            v += s * z
            a += s * b * dz
            if own:
                J[t, q + 2 + k] = z
                J[t, q + 2 + n + k] = s * dz * x[t]
                J[t, q + 2 + 2 * n + k] = s * dz
        y[t] = v
        slope[t] = a
        if own:
            J[t, q] = 1.0
            J[t, q + 1] = x[t]


@kernel
def scale_columns(J, q, slope):
    """Columns 0..q-1 of J (N, P) times slope (N,): the chain rule through a static map."""
    for t in range(slope.shape[0]):
        for j in range(q):
            J[t, j] *= slope[t]
