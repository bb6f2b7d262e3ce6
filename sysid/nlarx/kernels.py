"""Compiled loops of the nonlinear ARX network: one step ahead, and free run with its recursive sensitivities."""

import numpy as np

from sysid.base.compiled import kernel


@kernel
def step(theta, wavelets, mu, T, phi, x, dx, dphi, row, own):
    """Network at one regressor phi (n,): y0 + L (phi - mu) + sum_k s_k g_k(|b_k (x - c_k)|), x = T (phi - mu) (m,).

    theta = y0, L (n,), then s, b, c (m,) of each unit. g(z) is the radial wavelet (m - z^2) e^(-z^2/2) for the first
    `wavelets` units and the scaling function e^(-z^2/2) for the others. With `own`, dphi (n,) becomes dy/dphi and row
    (P,) dy/dtheta; x and dx (m,) are scratch.
    """
    n, m = phi.shape[0], T.shape[0]
    y = theta[0]
    for i in range(n):
        y += theta[1 + i] * (phi[i] - mu[i])
    for j in range(m):
        x[j] = 0.0
        dx[j] = 0.0
        for i in range(n):
            x[j] += T[j, i] * (phi[i] - mu[i])
    if own:
        row[0] = 1.0
        for i in range(n):
            row[1 + i] = phi[i] - mu[i]
    o, k = 1 + n, 0
    while o < theta.shape[0]:
        s, b = theta[o], theta[o + 1]
        r2 = 0.0
        for j in range(m):
            d = x[j] - theta[o + 2 + j]
            r2 += d * d
        z2 = b * b * r2
        e = np.exp(-0.5 * z2)
        if k < wavelets:
            g, dg = (m - z2) * e, -(1.0 + 0.5 * (m - z2)) * e  # dg by z^2
        else:
            g, dg = e, -0.5 * e
        y += s * g
        if own:
            row[o] = g
            row[o + 1] = 2.0 * s * dg * b * r2
            for j in range(m):
                v = 2.0 * s * dg * b * b * (x[j] - theta[o + 2 + j])
                row[o + 2 + j] = -v
                dx[j] += v
        o += m + 2
        k += 1
    if own:
        for i in range(n):
            dphi[i] = theta[1 + i]
            for j in range(m):
                dphi[i] += T[j, i] * dx[j]
    return y


@kernel
def predict(theta, wavelets, mu, T, Phi, yhat, J, own):
    """One step ahead: yhat (N,) for regressors Phi (N, n); J (N, P) its Jacobian if `own`."""
    n, m = Phi.shape[1], T.shape[0]
    x, dx, dphi, empty = np.empty(m), np.empty(m), np.empty(n), np.empty(0)
    for t in range(Phi.shape[0]):
        yhat[t] = step(theta, wavelets, mu, T, Phi[t], x, dx, dphi, J[t] if own else empty, own)


@kernel
def free_run(theta, wavelets, mu, T, na, nk, first, limit, u, yhat, J, own):
    """yhat (N,) from sample `first` on, computed from its own past; the measured samples before are kept.

    Sensitivities J (N, P) follow dy_t = dg/dtheta + sum_i dg/dy_{t-i} dy_{t-i}; rows before `first` are zero. Returns
    the sample at which |yhat| exceeded `limit` or became nan, or N; later samples are not filled.
    """
    n, m, P = mu.shape[0], T.shape[0], theta.shape[0]
    x, dx, dphi, phi, empty = np.empty(m), np.empty(m), np.empty(n), np.empty(n), np.empty(0)
    if own:
        J[:first] = 0.0
    for t in range(first, u.shape[0]):
        for i in range(na):
            phi[i] = yhat[t - 1 - i]
        for i in range(n - na):
            phi[na + i] = u[t - nk - i]
        yhat[t] = step(theta, wavelets, mu, T, phi, x, dx, dphi, J[t] if own else empty, own)
        if not abs(yhat[t]) <= limit:
            return t
        if own:
            for i in range(min(na, t - first)):
                d = dphi[i]
                for p in range(P):
                    J[t, p] += d * J[t - 1 - i, p]
    return u.shape[0]
