"""The motor board's own arithmetic on its numbers: bridge, supply, position loop, dry friction, potentiometer.

MuJoCo's callbacks (`twin.plant.kernels`) and the bench of one joint (`twin.plant.reduced`) run it.
"""

import numpy as np
from numba import njit

from twin.imperfections import TABLE
from twin.plant import slots as s


def _effect(group):
    """What the imperfections of a group, one after the other, make of a value of joint j."""
    run = njit(lambda j, value: value)
    for kind in TABLE.values():
        if kind.group == group and kind.effect is not None:
            run = _after(run, njit(kind.effect))
    return run


def _after(first, effect):
    return njit(lambda j, value: effect(j, s.PLACES, first(j, value)))


def _steps():
    """The states of all imperfections moved by one step."""
    run = njit(lambda board, j: None)
    for kind in TABLE.values():
        if kind.step is not None:
            run = _both(run, njit(kind.step))
    return run


def _both(first, step):
    @njit
    def run(board, j):
        first(board, j)
        step(board, j, s.PLACES)

    return run


_rubbed, driven, _seen, move = _effect("friction"), _effect("bridge"), _effect("sensor"), _steps()


@njit
def _uniform(seed, joint, tick, k):
    """A number in (0, 1) from a counter: splitmix64 (Steele, Lea and Flood, OOPSLA 2014)."""
    z = np.uint64(seed) + np.uint64(0x9E3779B97F4A7C15) * np.uint64(1 + 2 * (tick * 64 + joint) + k)
    z = (z ^ (z >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    z = (z ^ (z >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    z = z ^ (z >> np.uint64(31))
    return (float(z >> np.uint64(11)) + 0.5) / 9007199254740992.0


@njit
def _normal(seed, joint, tick):
    """A standard normal number by Box and Muller (Ann. Math. Statist. 29, 1958)."""
    radius = np.sqrt(-2.0 * np.log(_uniform(seed, joint, tick, 0)))
    return radius * np.cos(2.0 * np.pi * _uniform(seed, joint, tick, 1))


@njit
def angle_read(j, qpos):
    """Angle [rad] read by the potentiometer, without noise and ADC."""
    angle = qpos[int(j[s.HINGE])]
    if j[s.POT_PLAY] >= 0:
        angle += qpos[int(j[s.POT_PLAY])]
    return _seen(j, angle + j[s.POT_NONLINEARITY] * np.sin(j[s.POT_WAVE] * angle))


@njit
def servo(board, j, joint, tick, period, reference, qpos):
    """Voltage [V] commanded by the position loop: PID on the potentiometer voltage, integral held at saturation."""
    reading = angle_read(j, qpos)
    if j[s.POT_NOISE] > 0.0:
        reading += j[s.POT_NOISE] * _normal(board[s.SEED], joint, tick)
    if j[s.POT_STEP] > 0.0:
        code = np.floor(reading / j[s.POT_STEP] + 0.5)
        reading = min(max(code, -j[s.POT_HALF]), j[s.POT_HALF] - 1.0) * j[s.POT_STEP]
    reading *= j[s.POT_SCALE]
    rate = 0.0 if np.isnan(j[s.LAST]) else (reading - j[s.LAST]) / period
    j[s.LAST] = reading
    error = reference - reading
    integral = j[s.INTEGRAL] + period * error
    demand = j[s.KP] * error + j[s.KI] * integral - j[s.KD] * rate
    if abs(demand) <= board[s.SUPPLY]:
        j[s.INTEGRAL] = integral
    return demand


@njit
def duty(board, j, demand, position):
    """Share of the supply voltage at the bridge's output: limits, switches, PWM levels, dead zone."""
    duty = min(max(demand / board[s.SUPPLY], -1.0), 1.0)
    if (duty > 0.0 and position >= j[s.UPPER]) or (duty < 0.0 and position <= j[s.LOWER]):
        return 0.0
    if board[s.LEVELS] > 0.0:
        duty = np.floor(duty * board[s.LEVELS] + 0.5) / board[s.LEVELS]
    loss = board[s.DEAD_BAND] / board[s.SUPPLY]
    return np.sign(duty) * max(abs(duty) - loss, 0.0)


@njit
def bus(board, joints, velocity):
    """Supply voltage under the load of all bridges, V = V0 - R sum(d i) with i = (d V - K w) / Ra, solved for V."""
    if board[s.SUPPLY_R] == 0.0:
        return board[s.SUPPLY]
    numerator, denominator = board[s.SUPPLY], 1.0
    for k in range(joints):
        j = board[s.HEAD + k * s.WIDTH :]
        conductance = board[s.SUPPLY_R] * j[s.DUTY] / j[s.RESISTANCE]
        numerator += conductance * j[s.CONSTANT] * velocity[k]
        denominator += conductance * j[s.DUTY]
    return max(numerator / denominator, 0.0)


@njit
def bounds(j, speed):
    """Dry friction against upward and downward motion at this speed and the averaged load."""
    ratio = speed / j[s.STRIBECK_SPEED]
    factor = 1.0 + j[s.STRIBECK] * np.exp(-ratio * ratio)
    axial = j[s.LOAD_FRICTION] * abs(j[s.LOAD])
    return _rubbed(j, factor * j[s.COULOMB_UP] + axial), _rubbed(j, factor * j[s.COULOMB_DOWN] + axial)


@njit
def weigh(board, j, speed):
    """Force of the drive on the link in the last step, and its average, which sets the dry friction.

    It is the force of motor and friction minus the force that accelerates the rotor; MuJoCo's implicit step takes
    viscous friction and back-EMF at the new speed.
    """
    if np.isnan(j[s.GIVEN]):
        return
    change = speed - j[s.SPEED]
    braking = (j[s.CONSTANT] * j[s.GEAR]) ** 2 / j[s.RESISTANCE]
    force = j[s.GIVEN] - braking * change - j[s.VISCOUS] * speed - j[s.INERTIA] * change / board[s.STEP]
    j[s.FORCE_NOW] = force
    j[s.LOAD] += board[s.FILTER] * (force - j[s.LOAD])
