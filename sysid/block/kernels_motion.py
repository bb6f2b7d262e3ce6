"""Compiled recursions of the dynamic blocks that are not linear, with their sensitivities carried along.

Derivatives at a switch (a stop, a reversal, a break-away) are those of the branch that is taken.
"""

import numpy as np
from numba import njit

# Places in the motor's full parameter vector.
GAIN, LAG, RISE, FALL, STICK, STICK_SPEED, LOAD0, LOAD1, LOAD2, LOSS, JAM, DELAY, LOWER, UPPER, X0, V0 = range(16)
MOTOR = 16
_EVENTS = 4  # reversals within one stretch of constant input: one is usual, two can be
_TINY = 1e-12


@njit(cache=True, nogil=True)
def _pull(m, x, v, w, sign, at, own, column):
    """Speed that the motor tends to, and what it changes by: (speed, d/dx, d/dv, d/dw); d/dtheta goes into `own`.

    gain (w - L - sign F) with load L(x) and dry friction F = C + stick exp(-(v / stick_speed)^2) + loss |L|.
    """
    xi = x - at
    L = m[LOAD0] + m[LOAD1] * xi + m[LOAD2] * xi * xi
    C = m[RISE] if sign > 0.0 else m[FALL]
    ratio = v / m[STICK_SPEED]
    E = np.exp(-ratio * ratio)
    F = C + m[STICK] * E + m[LOSS] * abs(L)
    net = w - L - sign * F
    g = m[GAIN]
    dL = -g * (1.0 + sign * m[LOSS] * np.sign(L))
    if len(own):
        own[:] = 0.0
        # A parameter that the block does not have has column -1, the last one of `own`, which nobody reads.
        own[column[GAIN]] = net
        own[column[RISE if sign > 0.0 else FALL]] = -g * sign
        own[column[STICK]] = -g * sign * E
        own[column[STICK_SPEED]] = -g * sign * m[STICK] * E * 2.0 * ratio * ratio / m[STICK_SPEED]
        own[column[LOAD0]] = dL
        own[column[LOAD1]] = dL * xi
        own[column[LOAD2]] = dL * xi * xi
        own[column[LOSS]] = -g * sign * abs(L)
        own[len(own) - 1] = 0.0
    slope = dL * (m[LOAD1] + 2.0 * m[LOAD2] * xi)
    return g * net, slope, g * sign * m[STICK] * E * 2.0 * v / (m[STICK_SPEED] * m[STICK_SPEED]), g


@njit(cache=True, nogil=True)
def _direction(m, x, w, at):
    """Where a motor at rest starts to go under input w: 1, -1, or 0 where friction or a stop holds it."""
    xi = x - at
    L = m[LOAD0] + m[LOAD1] * xi + m[LOAD2] * xi * xi
    held = m[LOSS] * abs(L)
    if w - L > m[RISE] + m[STICK] + held and x < m[UPPER]:
        return 1.0
    if w - L < -(m[FALL] + m[STICK] + held) and x > m[LOWER]:
        return -1.0
    return 0.0


@njit(cache=True, nogil=True)
def lag_tangent(dx, dv, dh, c, ds, dlag, lag, speed, off, after, span, spent, decay, turns):
    """Move entry c of the tangents of position and speed through `span` of a first-order lag towards `speed`.

    ds and dlag are the tangents of that speed and of the lag, off is how far speed is off it at first, after is speed
    in the end; decay = exp(-span / lag), spent = lag (1 - decay). Where the motor `turns` the tangent dh of the time
    that is left takes up when that was.
    """
    dx[c] += (span - spent) * ds + spent * dv[c] + off * ((1.0 - decay) - span / lag * decay) * dlag
    change = (1.0 - decay) * ds + decay * dv[c] + off * decay * span / (lag * lag) * dlag
    if turns:  # speed is zero at the turn, so only the time that is left knows when it was
        dv[c] = 0.0
        dh[c] += lag / speed * change
    else:
        dx[c] += after * dh[c]
        dv[c] = change + (speed - after) / lag * dh[c]


@njit(cache=True, nogil=True)
def _jammed(held, h, dheld, dh):
    """What is left of the time `held` that a stop keeps the motor, and of h, after the two have passed together."""
    if held >= h:
        for c in range(len(dh)):
            dheld[c] -= dh[c]
        return held - h, 0.0
    for c in range(len(dh)):
        dh[c] -= dheld[c]
        dheld[c] = 0.0
    return 0.0, h - held


@njit(cache=True, nogil=True)
def _strike(m, x, v, place, dx, dv, dheld, column):
    """The motor has gone beyond a stop to x at speed v: it is put there, and jams for jam |v| from when it struck."""
    stop = m[place]
    held = max(m[JAM] * abs(v) - (x - stop) / v, 0.0) if v != 0.0 else 0.0
    for c in range(len(dx)):
        own = 1.0 if c == column[place] else 0.0
        if held > 0.0:
            dheld[c] = m[JAM] * np.sign(v) * dv[c] - (dx[c] - own) / v + (x - stop) / (v * v) * dv[c]
            if c == column[JAM]:
                dheld[c] += abs(v)
        dx[c], dv[c] = own, 0.0
    return stop, 0.0, held


@njit(cache=True, nogil=True)
def _stretch(m, x, v, w, h, held, at, dx, dv, dw, dh, dheld, own, column):
    """Position, speed and rest of the jam `held` after a time h [samples] of constant input w.

    Their tangents dx, dv, dheld (n,) move along; dw (n,) is the tangent of w, dh (n,) that of h, which is used up.
    Between switches the motion is a first-order lag, taken exactly; load and Stribeck's curve are those of the
    stretch's start.
    """
    n = len(dx)
    if held > 0.0:
        held, h = _jammed(held, h, dheld, dh)
    for _ in range(_EVENTS):
        if h <= _TINY:
            break
        sign = np.sign(v) if v != 0.0 else _direction(m, x, w, at)
        if sign == 0.0:
            dv[:] = 0.0
            return x, 0.0, held
        speed, sx, sv, sw = _pull(m, x, v, w, sign, at, own, column)
        lag = m[LAG]
        decay = np.exp(-h / lag)
        after = speed + (v - speed) * decay
        turns = v != 0.0 and after * sign < 0.0
        span = lag * np.log(1.0 - v / speed) if turns else h
        if turns:
            decay = speed / (speed - v)
            after = 0.0
        spent = lag * (1.0 - decay)
        off = v - speed
        for c in range(n):
            ds = sx * dx[c] + sv * dv[c] + sw * dw[c] + own[c]
            dlag = 1.0 if c == column[LAG] else 0.0
            lag_tangent(dx, dv, dh, c, ds, dlag, lag, speed, off, after, span, spent, decay, turns)
        x += speed * span + off * spent
        v = after
        h -= span
        place = UPPER if x >= m[UPPER] else LOWER
        if x >= m[UPPER] or x <= m[LOWER]:
            beyond = x > m[UPPER] or x < m[LOWER]
            if beyond or v * (x - 0.5 * (m[UPPER] + m[LOWER])) > 0.0:
                x, v, held = _strike(m, x, v, place, dx, dv, dheld, column)
                if not turns:
                    return x, v, held
        if not turns:
            break
    return x, v, held


@njit(cache=True, nogil=True)
def motor(m, substeps, at, u, x, J, q, column, p):
    """Position x (N,) at each sample, before its input u (N,) [V] acts; J (N, P) as in `Block.propagate`.

    m (MOTOR,) holds all parameters; column (MOTOR,) says where each stands among the block's own p, -1 for none. Each
    input is held for one sample, `delay` late: a sample sees the end of one input and the beginning of the next.
    """
    N, n = u.shape[0], (q + p if J.shape[1] else 0)
    W = J[:, :q].copy() if n else np.zeros((0, 0))
    dx, dv, dw, dh, dheld = np.zeros(n), np.zeros(n), np.zeros(n), np.zeros(n), np.zeros(n)
    own, places = np.zeros(n + 1 if n else 0), np.full(MOTOR, -1)
    if n:
        for i in range(MOTOR):
            places[i] = q + column[i] if column[i] >= 0 else -1
        if places[X0] >= 0:
            dx[places[X0]] = 1.0
        if places[V0] >= 0:
            dv[places[V0]] = 1.0
    whole = int(np.floor(m[DELAY]))
    late = m[DELAY] - whole
    place, speed, held = m[X0], m[V0], 0.0
    for k in range(N):
        x[k] = place
        for c in range(n):
            J[k, c] = dx[c]
        for part in range(2):
            length = late if part == 0 else 1.0 - late
            if length <= _TINY and not (n and part == 0 and places[DELAY] >= 0):
                continue
            i = max(k - whole - 1 + part, 0)  # before the record its first input stood
            w = u[i]
            for c in range(q if n else 0):
                dw[c] = W[i, c]
            for _ in range(substeps):
                if n:
                    dh[:] = 0.0
                    if places[DELAY] >= 0:
                        dh[places[DELAY]] = (1.0 if part == 0 else -1.0) / substeps
                h = length / substeps
                place, speed, held = _stretch(m, place, speed, w, h, held, at, dx, dv, dw, dh, dheld, own, places)


@njit(cache=True, nogil=True)
def limited_integrator(gain, lower, upper, start, w, x, J, q):
    """x_{t+1} = x_t + gain w_t between two stops; own columns: gain, lower, upper, x0."""
    P = J.shape[1]
    n = q + 4 if P else 0
    dx, dw = np.zeros(n), np.zeros(n)
    place = min(max(start, lower), upper)
    if n:
        dx[q + 3 if place == start else (q + 1 if place == lower else q + 2)] = 1.0
    for t in range(len(w)):
        value = w[t]
        for c in range(q if n else 0):
            dw[c] = J[t, c]
        x[t] = place
        for c in range(n):
            J[t, c] = dx[c]
        place += gain * value
        for c in range(q if n else 0):
            dx[c] += gain * dw[c]
        if n:
            dx[q] += value
        if place > upper or place < lower:
            stop = 2 if place > upper else 1
            place = upper if place > upper else lower
            if n:
                dx[:] = 0.0
                dx[q + stop] = 1.0


@njit(cache=True, nogil=True)
def fractional_delay(delay, w, y, J, q):
    """y_t between w_{t-n} and w_{t-n-1}, delay = n + fraction; before the record w_0 held; own column: delay."""
    n = int(np.floor(delay))
    late = delay - n
    P, N = J.shape[1], len(w)
    W = J[:, :q].copy() if P else np.zeros((0, 0))
    for t in range(N):
        i, k = max(t - n, 0), max(t - n - 1, 0)
        y[t] = (1.0 - late) * w[i] + late * w[k]
        if P:
            for c in range(q):
                J[t, c] = (1.0 - late) * W[i, c] + late * W[k, c]
            J[t, q] = w[k] - w[i]
