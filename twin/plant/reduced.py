"""One joint of the bench with MuJoCo's equations for it alone: two hinges about one axis, and no general machinery.

The bench's other joints are held, so the driven hinge and its play turn about one axis and the mass matrix has three
numbers besides the rotor's. The board is that of `twin.plant.electronics`. Constraints (dry friction, ends of stroke,
play) are MuJoCo's convex ones with the same impedance, and the step is its implicit one; see "Computation" in its
manual. A test holds both simulations together, sample by sample.
"""

import numpy as np
from numba import njit

from sysid.base.compiled import kernel
from twin.plant import slots as s
from twin.plant.added import DRAG, HOTTER, PUSH, RUB, WEAKER
from twin.plant.electronics import angle_read, bounds, bus, driven, duty, move, servo, weigh

# The mechanics, one number a place.
(
    LEVER,  # inertia of what moves with the drive alone [kg m2]
    LINK,  # and of what moves with the link
    LEVER_COS,  # torque of gravity against the lever at angle q: LEVER_COS cos q + LEVER_SIN sin q [N m]
    LEVER_SIN,
    LINK_COS,
    LINK_SIN,
    BASE,  # from the axis to the pins of the linear actuator [m]; 0: the drive is the hinge itself
    ROD,
    ENCLOSED,  # between the pins at joint angle 0 [rad]
    LOW,  # ends of stroke, at the drive
    HIGH,
    LIMITED,  # 1: they are there
    PLAY,  # half of the backlash [rad]
    PLAYS,  # 1: there is a play hinge
    RUBS,  # 1: the drive has dry friction
    VISCOUS,  # of the drive
    BEARING,  # dry friction between the links
    BEARING_VISCOUS,
) = range(18)
SIZE = 18
# Parameters of MuJoCo's constraints: time constant, damping ratio, then d0, width and dwidth, midpoint, power.
FRICTION, END, PLAY_END = range(3)
_TINY = 1e-15


@njit
def _impedance(soft, distance):
    """Impedance d(r) of a constraint violated by `distance`, MuJoCo's manual, "Parameters", "Impedance"."""
    low, high, width, middle, power = soft[2], soft[3], soft[4], soft[5], soft[6]
    x = abs(distance) / width
    if x >= 1.0:
        return high
    if x == 0.0:
        return low
    if power == 1.0:
        y = x
    elif x <= middle:
        y = x**power / middle ** (power - 1.0)
    else:
        y = 1.0 - (1.0 - x) ** power / (1.0 - middle) ** (power - 1.0)
    return low + y * (high - low)


@njit
def _row(rows, n, J0, J1, soft, distance, speed, scale, loss, stiff):
    """Write constraint n: its Jacobian, D = 1 / R, reference acceleration, bound of dry friction (-1: an end)."""
    d = min(max(_impedance(soft, distance), 1e-4), 0.9999)
    high = min(max(soft[3], 1e-4), 0.9999)
    R = max((1.0 - d) / d * scale, _TINY)
    damping, stiffness = 2.0 / (high * soft[0]), 1.0 / (high * soft[0] * soft[1]) ** 2
    rows[n, 0], rows[n, 1], rows[n, 2] = J0, J1, 1.0 / R
    rows[n, 3] = -damping * speed - (stiffness * d * distance if stiff else 0.0)
    rows[n, 4] = loss


@njit
def _force(row, jar):
    """Force of one constraint at J a - aref, and whether it is in its quadratic zone."""
    if row[4] >= 0.0:
        if row[2] * jar >= row[4]:
            return -row[4], False
        if row[2] * jar <= -row[4]:
            return row[4], False
        return -row[2] * jar, True
    return (-row[2] * jar, True) if jar < 0.0 else (0.0, False)


@njit
def _gradient(rows, n, m0, m1, m2, a, b, x, y):
    """Gradient and Hessian of the cost at acceleration (x, y), whose unconstrained value is (a, b)."""
    g0, g1 = m0 * (x - a) + m1 * (y - b), m1 * (x - a) + m2 * (y - b)
    h0, h1, h2 = m0, m1, m2
    for i in range(n):
        row = rows[i]
        force, quadratic = _force(row, row[0] * x + row[1] * y - row[3])
        g0 -= row[0] * force
        g1 -= row[1] * force
        if quadratic:
            h0 += row[2] * row[0] * row[0]
            h1 += row[2] * row[0] * row[1]
            h2 += row[2] * row[1] * row[1]
    return g0, g1, h0, h1, h2


@njit
def _solve(rows, n, m0, m1, m2, a, b, x, y):
    """The acceleration of least cost by Newton's method from (x, y); the cost is convex and piecewise quadratic."""
    g0, g1, h0, h1, h2 = _gradient(rows, n, m0, m1, m2, a, b, x, y)
    least = 1e-22 * (1.0 + m0 * a * a + m2 * b * b)
    for _ in range(50):
        det = h0 * h2 - h1 * h1
        d0, d1 = (h1 * g1 - h2 * g0) / det, (h1 * g0 - h0 * g1) / det
        slope = g0 * d0 + g1 * d1
        if -slope <= least:
            break
        low, high, t = 0.0, -1.0, 1.0
        for _ in range(60):  # the slope along the step grows: find where it is nothing
            g0, g1, h0, h1, h2 = _gradient(rows, n, m0, m1, m2, a, b, x + t * d0, y + t * d1)
            now = g0 * d0 + g1 * d1
            if abs(now) <= max(1e-10 * -slope, least):
                break
            if now < 0.0:
                low = t
            else:
                high = t
            t -= now / (h0 * d0 * d0 + 2.0 * h1 * d0 * d1 + h2 * d1 * d1)
            if high > 0.0 and not low < t < high:
                t = 0.5 * (low + high)
        x += t * d0
        y += t * d1
    return x, y


@njit
def _drive(c, angle):
    """Position of the drive at a joint angle, its moment arm, and the arm's slope."""
    if c[BASE] == 0.0:
        return angle, 1.0, 0.0
    product = c[BASE] * c[ROD]
    sine, cosine = np.sin(c[ENCLOSED] + angle), np.cos(c[ENCLOSED] + angle)
    length = np.sqrt(c[BASE] ** 2 + c[ROD] ** 2 - 2.0 * product * cosine)
    arm = product * sine / length
    return length, arm, (product * cosine - arm * arm) / length


@njit
def _masses(c, rotor, arm):
    """The mass matrix m0, m1, m2 of the two hinges; without a play the second one is alone, and rests."""
    m0 = c[LEVER] + c[LINK] + rotor * arm * arm
    return (m0, c[LINK], c[LINK]) if c[PLAYS] > 0.0 else (m0, 0.0, 1.0)


@njit
def _inverse(m0, m1, m2, s0, s1):
    """The solution of the symmetric equations with matrix m0, m1, m2."""
    det = m0 * m2 - m1 * m1
    return (m2 * s0 - m1 * s1) / det, (m0 * s1 - m1 * s0) / det


@njit
def _scales(c, rotor):
    """Inverse weights of constraints on drive, play and link, which MuJoCo takes at angle zero."""
    arm = _drive(c, 0.0)[1]
    m0, m1, m2 = _masses(c, rotor, arm)
    det = m0 * m2 - m1 * m1
    return arm * arm * m2 / det, m0 / det, (m0 - 2.0 * m1 + m2) / det if c[PLAYS] > 0.0 else 1.0 / m0


@njit
def _constraints(rows, c, soft, scales, place, v, w, length, arm, rubbed):
    """Write the constraints that act, the dry friction of the drive first; returns how many."""
    n, second = 0, c[PLAYS]
    if c[RUBS] > 0.0:
        _row(rows, n, arm, 0.0, soft[FRICTION], 0.0, arm * v, scales[0], rubbed, False)
        n += 1
    if c[BEARING] > 0.0:
        _row(rows, n, 1.0, second, soft[FRICTION], 0.0, v + second * w, scales[2], c[BEARING], False)
        n += 1
    for sign, end in ((1.0, c[LOW]), (-1.0, c[HIGH])):
        if c[LIMITED] > 0.0 and sign * (length - end) < 0.0:
            _row(rows, n, sign * arm, 0.0, soft[END], sign * (length - end), sign * arm * v, scales[0], -1.0, True)
            n += 1
    for sign, end in ((1.0, -c[PLAY]), (-1.0, c[PLAY])):
        if second > 0.0 and sign * (place[1] - end) < 0.0:
            _row(rows, n, 0.0, sign, soft[PLAY_END], sign * (place[1] - end), sign * w, scales[1], -1.0, True)
            n += 1
    return n


@njit
def _entry(row, x, low, span):
    """The value at x of a table over low to low + span; those at its ends hold beyond."""
    place = min(max((x - low) / span, 0.0), 1.0) * (len(row) - 1)
    k = min(int(place), len(row) - 2)
    return row[k] + (place - k) * (row[k + 1] - row[k])


def _roll(mark):
    """The simulation, for boards whose first number is `mark`: numba keeps it by this file's age and by the mark."""

    @kernel
    def roll(board, c, soft, q, commands, delay, hold, lead, out, added, spans):
        """Readings [rad] of the potentiometer in out (steps,), before each step; False for another layout of the board.

        `board` is user data of one joint, c (SIZE,) the mechanics, soft (3, 7) MuJoCo's parameters of the constraints,
        q the angle of the drive at the start. A command of `commands` (steps,) acts `delay` steps late; `hold` before,
        also during `lead` steps that go before. `added` (ROWS, n) and `spans` (4,) are of `twin.plant.added`; n is 0
        for a drive without additions.
        """
        if board[s.MAGIC] != mark:
            return False
        h, period, j = board[s.STEP], int(board[s.PERIOD]), board[s.HEAD :]
        place, v, w, x, y = np.array([q, 0.0]), 0.0, 0.0, 0.0, 0.0
        rows, velocity = np.zeros((6, 5)), np.zeros(1)
        gear, rotor, per_volt = j[s.GEAR], j[s.INERTIA], j[s.CONSTANT] / j[s.RESISTANCE]
        scales, changed, push, rub = _scales(c, rotor), added.shape[1] > 0, 0.0, 0.0
        for t in range(lead + len(out)):
            length, arm, bend = _drive(c, place[0])
            speed, turn, link = arm * v, v + c[PLAYS] * w, place[0] + c[PLAYS] * place[1]
            # The board, as in kernels.control.
            k = t - lead - delay
            demand = hold if k < 0 else commands[min(k, len(commands) - 1)]
            velocity[0] = gear * speed
            if t % period == 0:
                if j[s.SERVO] == 1.0:
                    demand = servo(board, j, 0, t // period, period * h, demand, place)
                j[s.DUTY] = duty(board, j, demand, length + j[s.OFFSET])
            weigh(board, j, speed)
            j[s.SPEED] = speed
            rising, falling = bounds(j, speed) if c[RUBS] > 0.0 else (0.0, 0.0)
            board[s.BUS] = bus(board, 1, velocity)
            volts = driven(j, j[s.DUTY] * board[s.BUS])
            move(board, j)
            if changed:
                drag = _entry(added[DRAG], abs(speed), 0.0, spans[2])
                push = _entry(added[PUSH], place[0], spans[0], spans[1]) - (drag if speed > 0.0 else -drag)
                rub = gear * j[s.CONSTANT] / j[s.RESISTANCE] * _entry(added[RUB], place[0], spans[0], spans[1])
                rising, falling = max(rising + rub, 0.0), max(falling + rub, 0.0)
                now = max(t - lead, 0) * h
                volts *= 1.0 - _entry(added[WEAKER], now, 0.0, spans[3])
                hotter = 1.0 + _entry(added[HOTTER], now, 0.0, spans[3])
                per_volt = j[s.CONSTANT] / j[s.RESISTANCE] / hotter
                push *= hotter
            # Forces on the two hinges, and what the constraints add.
            torque = per_volt * (volts + push - j[s.CONSTANT] * velocity[0])
            weight = c[LINK_COS] * np.cos(link) + c[LINK_SIN] * np.sin(link)
            s1 = -weight - c[BEARING_VISCOUS] * turn
            s0 = s1 - c[LEVER_COS] * np.cos(place[0]) - c[LEVER_SIN] * np.sin(place[0]) - rotor * arm * bend * v * v
            s0 += arm * (gear * torque - c[VISCOUS] * speed + 0.5 * (falling - rising))
            s1 *= c[PLAYS]
            m0, m1, m2 = _masses(c, rotor, arm)
            n = _constraints(rows, c, soft, scales, place, v, w, length, arm, 0.5 * (rising + falling))
            a, b = _inverse(m0, m1, m2, s0, s1)
            x, y = _solve(rows, n, m0, m1, m2, a, b, x, y)
            for i in range(n - 1, -1, -1):  # the friction of the drive comes last, and stays in `force`
                force = _force(rows[i], rows[i, 0] * x + rows[i, 1] * y - rows[i, 3])[0]
                s0 += rows[i, 0] * force
                s1 += rows[i, 1] * force
            # The sensor, as in kernels.sense.
            j[s.GIVEN] = torque * gear
            if c[RUBS] > 0.0:
                rising, falling = bounds(j, j[s.SPEED])  # `rub` acts alike in both directions
                j[s.GIVEN] += force + 0.5 * (falling - rising)
            if t >= lead:
                out[t - lead] = angle_read(j, place)
            # The implicit step.
            drag = arm * arm * (c[VISCOUS] + gear * gear * per_volt * j[s.CONSTANT])
            d = h * c[BEARING_VISCOUS]
            a, b = _inverse(m0 + h * drag + d, m1 + c[PLAYS] * d, m2 + c[PLAYS] * d, s0, s1)
            v += h * a
            w += h * b
            place[0] += h * v
            place[1] += h * w
        return True

    return roll


roll = _roll(s.MAGIC_VALUE)
