"""Compiled loops of the nonlinear state space. Compiled at first call, never at import, and cached on disk."""

import numpy as np

from sysid.base.compiled import kernel


@kernel
def features(x, u, W, V, b, b0, powers, f, g):
    """f (m,) at a state x (nx,) and an input u (nu,), and the slope g (units,) of each tanh; b0 = tanh(b)."""
    units, nx, nu = W.shape[0], x.shape[0], u.shape[0]
    for k in range(units):
        z = b[k]
        for j in range(nx):
            z += W[k, j] * x[j]
        for j in range(nu):
            z += V[k, j] * u[j]
        h = np.tanh(z)
        f[k] = h - b0[k]
        g[k] = 1.0 - h * h
    for k in range(powers.shape[0]):
        v = 1.0
        for j in range(nx + nu):
            for _ in range(powers[k, j]):
                v *= x[j] if j < nx else u[j - nx]
        f[units + k] = v


@kernel
def feature_slopes(x, u, W, V, g, powers, fx, fu):
    """df/dx (m, nx) and df/du (m, nu)."""
    units, nx, nu = W.shape[0], x.shape[0], u.shape[0]
    for k in range(units):
        for j in range(nx):
            fx[k, j] = g[k] * W[k, j]
        for j in range(nu):
            fu[k, j] = g[k] * V[k, j]
    for k in range(powers.shape[0]):
        for i in range(nx + nu):
            v = float(powers[k, i])
            if v != 0.0:
                for j in range(nx + nu):
                    for _ in range(powers[k, j] - (1 if j == i else 0)):
                        v *= x[j] if j < nx else u[j - nx]
            if i < nx:
                fx[units + k, i] = v
            else:
                fu[units + k, i - nx] = v


@kernel
def run(A, B, C, D, d, E, F, W, V, b, powers, x0, U, Y):
    """Outputs Y (N, ny) for inputs U (N, nu); nan from the sample on at which the state is not finite any more."""
    N, nx, m, nu, ny = U.shape[0], A.shape[0], E.shape[1], U.shape[1], Y.shape[1]
    units = W.shape[0]
    x, new, f, g, b0 = x0.copy(), np.empty(nx), np.empty(m), np.empty(units), np.tanh(b)
    for t in range(N):
        u = U[t]
        features(x, u, W, V, b, b0, powers, f, g)
        for o in range(ny):
            v = d[o]
            for j in range(nu):
                v += D[o, j] * u[j]
            for j in range(nx):
                v += C[o, j] * x[j]
            for k in range(F.shape[1]):
                v += F[o, k] * f[k]
            Y[t, o] = v
        size = 0.0
        for i in range(nx):
            v = 0.0
            for j in range(nx):
                v += A[i, j] * x[j]
            for j in range(nu):
                v += B[i, j] * u[j]
            for k in range(m):
                v += E[i, k] * f[k]
            new[i] = v
            size += abs(v)
        if not size < 1e100:
            Y[t + 1 :] = np.nan
            return
        x, new = new, x


@kernel
def run_tangent(A, B, C, D, d, E, F, W, V, b, powers, x0, U, dU, Y, J, q, p, outer, inner):
    """`run` with the tangent J (ny, N, P): dU (nu, N, >= q) in columns 0..q-1, own parameters in q..q+p-1.

    J may be dU. The parameters stand in the order A, B, C, D, d, E, F, W, V, b, x0. `inner` multiplies U's tangent and
    `outer` (ny,) that of the outputs (the units of the signals).
    """
    N, nx, m, nu, ny = U.shape[0], A.shape[0], E.shape[1], U.shape[1], Y.shape[1]
    units, mf = W.shape[0], F.shape[1]
    oA = q
    oB = oA + nx * nx
    oC = oB + nx * nu
    oD = oC + ny * nx
    od = oD + ny * nu
    oE = od + ny
    oF = oE + nx * m
    oW = oF + ny * mf
    oV = oW + units * nx
    ob = oV + units * nu
    ox = ob + units
    n = q + p
    x, new, f, g, b0 = x0.copy(), np.empty(nx), np.empty(m), np.empty(units), np.tanh(b)
    fx, fu = np.zeros((m, nx)), np.zeros((m, nu))
    Jx, Ju, Cx, Du = np.empty((nx, nx)), np.empty((nx, nu)), np.empty((ny, nx)), np.empty((ny, nu))
    S, T = np.zeros((nx, n)), np.zeros((nx, n))
    for i in range(nx):
        S[i, ox + i] = 1.0
    for t in range(N):
        u = U[t]
        features(x, u, W, V, b, b0, powers, f, g)
        feature_slopes(x, u, W, V, g, powers, fx, fu)
        for i in range(nx):
            for j in range(nx):
                v = A[i, j]
                for k in range(m):
                    v += E[i, k] * fx[k, j]
                Jx[i, j] = v
            for j in range(nu):
                v = B[i, j]
                for k in range(m):
                    v += E[i, k] * fu[k, j]
                Ju[i, j] = v * inner[j]
        size = 0.0
        for i in range(nx):
            # What the input's tangent and the parameters before do; then what the state's tangent does.
            v = 0.0
            for j in range(nx):
                v += A[i, j] * x[j]
            for j in range(nu):
                v += B[i, j] * u[j]
            for k in range(m):
                v += E[i, k] * f[k]
            new[i] = v
            size += abs(v)
            row = T[i]
            for c in range(n):
                row[c] = Jx[i, 0] * S[0, c]
            for j in range(1, nx):
                a = Jx[i, j]
                for c in range(n):
                    row[c] += a * S[j, c]
            for j in range(nu):
                for c in range(q):
                    row[c] += Ju[i, j] * dU[j, t, c]
            for j in range(nx):
                row[oA + i * nx + j] += x[j]
            for j in range(nu):
                row[oB + i * nu + j] += u[j]
            for k in range(m):
                row[oE + i * m + k] += f[k]
            for k in range(units):
                w = E[i, k] * g[k]
                for j in range(nx):
                    row[oW + k * nx + j] += w * x[j]
                for j in range(nu):
                    row[oV + k * nu + j] += w * u[j]
                row[ob + k] += w - E[i, k] * (1.0 - b0[k] * b0[k])
        for o in range(ny):
            s = outer[o]
            for j in range(nx):
                v = C[o, j]
                for k in range(mf):
                    v += F[o, k] * fx[k, j]
                Cx[o, j] = v * s
            for j in range(nu):
                v = D[o, j]
                for k in range(mf):
                    v += F[o, k] * fu[k, j]
                Du[o, j] = v * s * inner[j]
        for o in range(ny):
            s, v = outer[o], d[o]
            for j in range(nu):
                v += D[o, j] * u[j]
            for j in range(nx):
                v += C[o, j] * x[j]
            for k in range(mf):
                v += F[o, k] * f[k]
            Y[t, o] = v
            out = J[o, t]
            for c in range(q):  # J may be dU: a column is read before it is written
                v = 0.0
                for j in range(nu):
                    v += Du[o, j] * dU[j, t, c]
                out[c] = v + Cx[o, 0] * S[0, c]
            for c in range(q, n):
                out[c] = Cx[o, 0] * S[0, c]
            for j in range(1, nx):
                a = Cx[o, j]
                for c in range(n):
                    out[c] += a * S[j, c]
            for j in range(nx):
                out[oC + o * nx + j] += s * x[j]
            for j in range(nu):
                out[oD + o * nu + j] += s * u[j]
            out[od + o] += s
            for k in range(mf):
                out[oF + o * mf + k] += s * f[k]
                if k < units:
                    w = s * F[o, k] * g[k]
                    for j in range(nx):
                        out[oW + k * nx + j] += w * x[j]
                    for j in range(nu):
                        out[oV + k * nu + j] += w * u[j]
                    out[ob + k] += w - s * F[o, k] * (1.0 - b0[k] * b0[k])
        if not size < 1e100:
            Y[t + 1 :] = np.nan
            J[:, t + 1 :, :n] = np.nan
            return
        x, new = new, x
        S, T = T, S
