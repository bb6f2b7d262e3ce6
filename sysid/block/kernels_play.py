"""Compiled recursions of play, with their sensitivities carried along.

Derivatives at a switch (one side or the other, flight, rest) are those of the branch that is taken.
"""

import numpy as np
from numba import njit


@njit(cache=True, nogil=True)
def play(width, rest, x, y, J, q):
    """Backlash: y follows x when it has crossed `width`, starting at x_0 + rest width; own columns: width, rest."""
    P = J.shape[1]
    n = q + 2 if P else 0
    d = np.zeros(n)
    place = x[0] + rest * width
    if P:
        _take(d, J, 0, q, rest)
        d[q + 1] = width
    for t in range(len(x)):
        low, high = x[t] - 0.5 * width, x[t] + 0.5 * width
        if place < low or place > high:
            if P:
                _take(d, J, t, q, -0.5 if place < low else 0.5)
            place = low if place < low else high
        y[t] = place
        for c in range(n):
            J[t, c] = d[c]


@njit(cache=True, nogil=True)
def _take(d, J, t, q, side):
    """Tangent d of an output that lies at `side` of the width from x_t."""
    d[:] = 0.0
    d[:q] = J[t, :q]
    d[q] = side


@njit(cache=True, nogil=True)
def coasting_play(width, rest, drag, pull0, pull1, x, y, J, q):
    """Backlash of a link with inertia; own columns: width, rest, drag, pull0, pull1.

    Between the two sides it flies, v' = -(pull0 + pull1 y) - drag sign v; at either side it goes on as x goes.
    """
    P = J.shape[1]
    n = q + 5 if P else 0
    d, dv, dh, base, before = np.zeros(n), np.zeros(n), np.zeros(n), np.zeros(n), np.zeros(n)
    place, speed = x[0] + rest * width, 0.0
    if P:
        _take(d, J, 0, q, rest)
        d[q + 1] = width
        before[:q] = J[0, :q]
    y[0] = place
    for c in range(n):
        J[0, c] = d[c]
    for t in range(1, len(x)):
        for c in range(n):
            base[c] = -pull1 * d[c]
        if P:
            base[q + 3] -= 1.0
            base[q + 4] -= place
        place, speed = _fly(place, speed, pull0 + pull1 * place, drag, d, dv, dh, base, q + 2)
        low, high = x[t] - 0.5 * width, x[t] + 0.5 * width
        if place < low or place > high:
            if P:
                _take(d, J, t, q, -0.5 if place < low else 0.5)
                dv[:] = 0.0
                dv[:q] = J[t, :q] - before[:q]
            place = low if place < low else high
            speed = x[t] - x[t - 1]
        y[t] = place
        for c in range(q if P else 0):
            before[c] = J[t, c]
        for c in range(n):
            J[t, c] = d[c]


@njit(cache=True, nogil=True)
def _fly(place, speed, pull, drag, d, dv, dh, base, own):
    """Place and speed after one sample of free flight under a constant pull; d, dv (n,) move along.

    base (n,) is the tangent of -pull, dh (n,) takes up that of the time that is left, own is the drag's column. A link
    that comes to rest stays there, or falls the other way where the pull is stronger than the drag.
    """
    left = 1.0
    dh[:] = 0.0
    for _ in range(2):
        sign = np.sign(speed) if speed != 0.0 else (-np.sign(pull) if abs(pull) > drag else 0.0)
        if sign == 0.0:
            dv[:] = 0.0
            return place, 0.0
        rate = -pull - drag * sign
        rests = speed != 0.0 and (speed + rate * left) * sign < 0.0
        span = -speed / rate if rests else left
        after = 0.0 if rests else speed + rate * span
        for c in range(len(d)):
            change = base[c] - (sign if c == own else 0.0)
            d[c] += span * dv[c] + 0.5 * span * span * change + after * dh[c]
            if rests:
                dh[c] += (dv[c] + span * change) / rate
                dv[c] = 0.0
            else:
                dv[c] += span * change + rate * dh[c]
        place += (speed + 0.5 * rate * span) * span
        speed = after
        left -= span
        if not rests:
            break
    return place, speed
