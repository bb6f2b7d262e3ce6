"""Compiled loops of the wavelet network and of splines. Compiled at first call, never at import, and cached on disk."""

import numpy as np

from sysid.base.compiled import kernel


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
