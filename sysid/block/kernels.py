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


@kernel
def wavelet_network(theta, wavelets, x, y, slope, J, q, own):
    """y0 + L x + sum s_k g_k(b_k (x - c_k)), theta = y0, L, s (n,), b (n,), c (n,).

    g is the wavelet (1 - z^2) e^(-z^2/2) for the first `wavelets` units and the scaling function e^(-z^2/2) for the
    others.
    """
    n = (theta.shape[0] - 2) // 3
    for t in range(x.shape[0]):
        v, a = theta[0] + theta[1] * x[t], theta[1]
        for k in range(n):
            s, b = theta[2 + k], theta[2 + n + k]
            d = x[t] - theta[2 + 2 * n + k]
            z = b * d
            e = np.exp(-0.5 * z * z)
            if k < wavelets:
                g, dg = (1.0 - z * z) * e, z * (z * z - 3.0) * e
            else:
                g, dg = e, -z * e
            v += s * g
            a += s * b * dg
            if own:
                J[t, q + 2 + k] = g
                J[t, q + 2 + n + k] = s * dg * d
                J[t, q + 2 + 2 * n + k] = -s * dg * b
        y[t] = v
        slope[t] = a
        if own:
            J[t, q] = 1.0
            J[t, q + 1] = x[t]


@kernel
def spline(pieces, lo, hi, v, x, y, slope, J, q, own, ends):
    """y = sum_i v_i phi_i(r), r = (x - lo)/(hi - lo); phi_i goes on as a straight line outside [0, 1].

    pieces (m, 4, n): coefficients of phi_i on the m equal intervals of [0, 1], in powers 0..3 of m r - interval.
    With `own`, columns q.. of J are [d/dlo, d/dhi if `ends`,] d/dv.
    """
    m, n = pieces.shape[0], pieces.shape[2]
    c = np.zeros((m, 4))
    for i in range(m):
        for k in range(4):
            for j in range(n):
                c[i, k] += pieces[i, k, j] * v[j]
    first = q + 2 if ends else q
    for t in range(x.shape[0]):
        r = (x[t] - lo) / (hi - lo)
        inside = min(max(r, 0.0), 1.0)
        i = min(int(inside * m), m - 1)
        s = inside * m - i
        beyond = (r - inside) * m
        d = c[i, 1] + s * (2.0 * c[i, 2] + s * 3.0 * c[i, 3])
        y[t] = c[i, 0] + s * (c[i, 1] + s * (c[i, 2] + s * c[i, 3])) + beyond * d
        slope[t] = d * m / (hi - lo)
        if own:
            if ends:
                J[t, q] = -slope[t] * (1.0 - r)
                J[t, q + 1] = -slope[t] * r
            for j in range(n):
                p = pieces[i, :, j]
                J[t, first + j] = (
                    p[0] + s * (p[1] + s * (p[2] + s * p[3])) + beyond * (p[1] + s * (2.0 * p[2] + s * 3.0 * p[3]))
                )


@kernel
def held_states(F, g, c, dF, dg, dc, lag, u0, before, w, dw, x, S, y, J, q):
    """y (N,) = c x with the states x (n,): F x + g (n, 2) times the inputs w (N,) of lag + 2 and lag + 1 samples ago.

    Before the record they are u0 (h,), the latest first, and the last of these for ever; the first of w if h is 0. The
    tangent J (N, P) has dw (N, q), that of w, in its first q columns, then those of p own parameters from dF (p, n, n),
    dg (p, n, 2), dc (p, n) and the states' tangent S (n, q + p); those of u0 begin at `before`. x and S are changed.
    """
    n, p, own = F.shape[0], dF.shape[0], S.shape[1]
    new, T, known = np.empty(n), np.empty((n, own)), u0.shape[0] == 0
    for t in range(w.shape[0]):
        if t > 0:
            early, late = t - lag - 2, t - lag - 1
            if known:
                early, late = max(early, 0), max(late, 0)
            i0, i1 = min(max(-early, 1), u0.shape[0]) - 1, min(max(-late, 1), u0.shape[0]) - 1
            a, b = w[early] if early >= 0 else u0[i0], w[late] if late >= 0 else u0[i1]
            for i in range(n):
                new[i] = g[i, 0] * a + g[i, 1] * b
                for j in range(n):
                    new[i] += F[i, j] * x[j]
                for k in range(own):
                    T[i, k] = 0.0
                    for j in range(n):
                        T[i, k] += F[i, j] * S[j, k]
                if own:
                    for k in range(q):
                        if early >= 0:
                            T[i, k] += g[i, 0] * dw[early, k]
                        if late >= 0:
                            T[i, k] += g[i, 1] * dw[late, k]
                for k in range(p):
                    T[i, q + k] += dg[k, i, 0] * a + dg[k, i, 1] * b
                    for j in range(n):
                        T[i, q + k] += dF[k, i, j] * x[j]
                if own and early < 0:
                    T[i, q + before + i0] += g[i, 0]
                if own and late < 0:
                    T[i, q + before + i1] += g[i, 1]
            for i in range(n):
                x[i] = new[i]
                for k in range(own):
                    S[i, k] = T[i, k]
        y[t] = 0.0
        for i in range(n):
            y[t] += c[i] * x[i]
        for k in range(own):
            J[t, k] = 0.0
            for i in range(n):
                J[t, k] += c[i] * S[i, k]
        for k in range(p):
            for i in range(n):
                J[t, q + k] += dc[k, i] * x[i]
