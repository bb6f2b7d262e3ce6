"""Compiled recursion of a motor whose dry friction is a free function of position, with its sensitivities."""

import numpy as np
from numba import njit

from sysid.block.kernels_motion import lag_tangent

INERTIA, DRAG_UP, DRAG_DOWN, PROFILE = range(4)  # of the block's own parameters; rise and fall at each knot follow
_EVENTS = 4  # turns within one stretch of constant input
_TINY = 1e-12


@njit(cache=True, nogil=True)
def _place(x, low, high, knots):
    """Segment i of x, share f of the way through it, and df/dx; beyond the ends the last value holds."""
    if knots == 1:
        return 0, 0.0, 0.0
    per = (knots - 1) / (high - low)
    s = (x - low) * per
    i = min(max(int(np.floor(s)), 0), knots - 2)
    f = s - i
    if f < 0.0 or f > 1.0:
        return i, min(max(f, 0.0), 1.0), 0.0
    return i, f, per


@njit(cache=True, nogil=True)
def _level(theta, start, i, f, knots):
    """Profile that starts at theta[start], in segment i at share f, and its rise over the segment."""
    here = theta[start + i]
    rise = theta[start + i + 1] - here if knots > 1 else 0.0
    return here + f * rise, rise


@njit(cache=True, nogil=True)
def profiled_motor(theta, knots, low, high, substeps, u, y, J, q):
    """Position y (N,) at each sample, before its input u (N,) [V] acts; J (N, P) as in `Block.propagate`.

    Over each of `substeps` parts of a sample friction is that of the part's start; the lag is then taken exactly.
    """
    N, p = len(u), PROFILE + 2 * knots + 2
    n = q + p if J.shape[1] else 0
    dx, dv, dw = np.zeros(n), np.zeros(n), np.zeros(n)
    x, v = theta[p - 2], theta[p - 1]
    if n:
        dx[n - 2], dv[n - 1] = 1.0, 1.0
    M = theta[INERTIA]
    for t in range(N):
        w = u[t]
        y[t] = x
        for c in range(n):
            if c < q:
                dw[c] = J[t, c]
            J[t, c] = dx[c]
        for _ in range(substeps):
            h = 1.0 / substeps
            dh = np.zeros(n)
            for _ in range(_EVENTS):
                if h <= _TINY:
                    break
                i, f, per = _place(x, low, high, knots)
                sign = np.sign(v)
                if sign == 0.0:
                    if w > _level(theta, PROFILE, i, f, knots)[0]:
                        sign = 1.0
                    elif w < -_level(theta, PROFILE + knots, i, f, knots)[0]:
                        sign = -1.0
                    else:
                        dv[:] = 0.0
                        break
                start = PROFILE if sign > 0.0 else PROFILE + knots
                C, rise = _level(theta, start, i, f, knots)
                side = DRAG_UP if sign > 0.0 else DRAG_DOWN
                drag = theta[side]
                speed, lag = (w - sign * C) / drag, M / drag
                decay = np.exp(-h / lag)
                off = v - speed
                after = speed + off * decay
                turns = v != 0.0 and after * sign < 0.0
                span = lag * np.log(1.0 - v / speed) if turns else h
                if turns:
                    decay, after = speed / (speed - v), 0.0
                spent = lag * (1.0 - decay)
                for c in range(n):
                    ds = (dw[c] - sign * rise * per * dx[c]) / drag
                    dlag = 0.0
                    if c == q + INERTIA:
                        dlag = 1.0 / drag
                    elif c == q + side:
                        ds -= speed / drag
                        dlag = -lag / drag
                    elif c == q + start + i:
                        ds -= sign * (1.0 - f) / drag
                    elif knots > 1 and c == q + start + i + 1:
                        ds -= sign * f / drag
                    lag_tangent(dx, dv, dh, c, ds, dlag, lag, speed, off, after, span, spent, decay, turns)
                x += speed * span + off * spent
                v = after
                h -= span
                if not turns:
                    break


@njit(cache=True, nogil=True)
def friction_lag(gain, drag, friction, onset, start, substeps, u, y, J, q):
    """Speed y (N,) of v' = gain u - drag v - friction tanh(v / onset), by the midpoint rule; own columns in that order.

    The last of the five own columns is the speed at the start.
    """
    n = q + 5 if J.shape[1] else 0
    dv, dw = np.zeros(n), np.zeros(n)
    v, h = start, 1.0 / substeps
    if n:
        dv[n - 1] = 1.0
    for t in range(len(u)):
        w = u[t]
        y[t] = v
        for c in range(n):
            if c < q:
                dw[c] = J[t, c]
            J[t, c] = dv[c]
        for _ in range(substeps):
            T = np.tanh(v / onset)
            rate = gain * w - drag * v - friction * T
            slope = -drag - friction * (1.0 - T * T) / onset
            middle = v + 0.5 * h * rate
            Tm = np.tanh(middle / onset)
            slope_m = -drag - friction * (1.0 - Tm * Tm) / onset
            for c in range(n):
                first, last = gain * dw[c], gain * dw[c]
                if c == q:
                    first, last = w, w
                elif c == q + 1:
                    first, last = -v, -middle
                elif c == q + 2:
                    first, last = -T, -Tm
                elif c == q + 3:
                    first = friction * (1.0 - T * T) * v / (onset * onset)
                    last = friction * (1.0 - Tm * Tm) * middle / (onset * onset)
                dm = dv[c] + 0.5 * h * (slope * dv[c] + first)
                dv[c] += h * (slope_m * dm + last)
            v += h * (gain * w - drag * middle - friction * Tm)
