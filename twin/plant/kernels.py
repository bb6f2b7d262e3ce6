"""The compiled motor board, which MuJoCo calls in every step.

The order in mj_forward is positions and constraints, velocities, `control`, forces, solver, `sense`. Both callbacks
allocate no memory and do not hold the GIL. Their state is in user data, so simulations in a batch are independent.
"""

from typing import Any

import numpy as np
from numba import carray, njit, types
from numba.core import cgutils
from numba.extending import intrinsic

from sysid.base.compiled import callback
from twin.imperfections import TABLE
from twin.plant import slots as s
from twin.plant.layout import offset

TIME, NE, NF, QPOS = (offset("mjData", name) for name in ("time", "ne", "nf", "qpos"))
CTRL, USERDATA, SENSORDATA = (offset("mjData", name) for name in ("ctrl", "userdata", "sensordata"))
LENGTH, VELOCITY, TORQUE, MOMENT, PASSIVE = (
    offset("mjData", name)
    for name in ("actuator_length", "actuator_velocity", "actuator_force", "actuator_moment", "qfrc_passive")
)
NONZEROS, START, COLUMN = (offset("mjData", f"moment_{name}") for name in ("rownnz", "rowadr", "colind"))
EFC_TYPE, EFC_ID, EFC_LOSS, EFC_FORCE = (
    offset("mjData", f"efc_{name}") for name in ("type", "id", "frictionloss", "force")
)
NUSERDATA = offset("mjModel", "nuserdata")
AFTER_SOLVER = 3  # mjtStage.mjSTAGE_ACC
FAR = 2**30  # longer than any array: the callbacks keep inside by the counts they read


@intrinsic
def _as_pointer(typingctx, address):
    """An integer address as a pointer."""

    def generate(context, builder, signature, args):
        return builder.inttoptr(args[0], cgutils.voidptr_t)

    return types.voidptr(types.intp), generate


_pointer: Any = _as_pointer  # called without its first argument, which type checkers cannot know


@njit(inline="always")
def _numbers(data, field):
    """The array of numbers to which a field of mjData points."""
    return carray(_pointer(carray(_pointer(data + field), 1, np.intp)[0]), FAR, np.float64)


@njit(inline="always")
def _integers(data, field):
    """The array of integers to which a field of mjData points."""
    return carray(_pointer(carray(_pointer(data + field), 1, np.intp)[0]), FAR, np.int32)


@njit(inline="always")
def _joints(model, data, mark):
    """Number of joints on the board; 0 if the user data does not belong to a board."""
    if carray(_pointer(model + NUSERDATA), 1, np.int64)[0] < s.HEAD:
        return 0
    board = _numbers(data, USERDATA)
    return int(board[s.JOINTS]) if board[s.MAGIC] == mark else 0


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


_rubbed, _driven, _seen, _move = _effect("friction"), _effect("bridge"), _effect("sensor"), _steps()


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
def _angle_read(j, qpos):
    """Angle [rad] read by the potentiometer, without noise and ADC."""
    angle = qpos[int(j[s.HINGE])]
    if j[s.POT_PLAY] >= 0:
        angle += qpos[int(j[s.POT_PLAY])]
    return _seen(j, angle + j[s.POT_NONLINEARITY] * np.sin(j[s.POT_WAVE] * angle))


angle_read = _angle_read  # for a board outside of MuJoCo's callbacks


@njit
def _servo(board, j, joint, tick, period, reference, qpos):
    """Voltage [V] commanded by the position loop: PID on the potentiometer voltage, integral held at saturation."""
    reading = _angle_read(j, qpos)
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
def _duty(board, j, demand, position):
    """Share of the supply voltage at the bridge's output: limits, switches, PWM levels, dead zone."""
    duty = min(max(demand / board[s.SUPPLY], -1.0), 1.0)
    if (duty > 0.0 and position >= j[s.UPPER]) or (duty < 0.0 and position <= j[s.LOWER]):
        return 0.0
    if board[s.LEVELS] > 0.0:
        duty = np.floor(duty * board[s.LEVELS] + 0.5) / board[s.LEVELS]
    loss = board[s.DEAD_BAND] / board[s.SUPPLY]
    return np.sign(duty) * max(abs(duty) - loss, 0.0)


@njit
def _bus(board, joints, velocity):
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
def _row(j, data):
    """Index of the joint's dry-friction constraint; -1 if it has none."""
    kind, name = _integers(data, EFC_TYPE), _integers(data, EFC_ID)
    first = carray(_pointer(data + NE), 1, np.int32)[0]
    for i in range(first, first + carray(_pointer(data + NF), 1, np.int32)[0]):
        if kind[i] == int(j[s.ROW_TYPE]) and name[i] == int(j[s.ROW_ID]):
            return i
    return -1


@njit
def _bounds(j, speed):
    """Dry friction against upward and downward motion at this speed and the averaged load."""
    ratio = speed / j[s.STRIBECK_SPEED]
    factor = 1.0 + j[s.STRIBECK] * np.exp(-ratio * ratio)
    axial = j[s.LOAD_FRICTION] * abs(j[s.LOAD])
    return _rubbed(j, factor * j[s.COULOMB_UP] + axial), _rubbed(j, factor * j[s.COULOMB_DOWN] + axial)


@njit
def _rub(j, data, k, speed):
    """Set the bounds of dry friction for this step.

    MuJoCo's constraint has one bound for both directions; half the difference of the two is applied as a separate
    force.
    """
    row = _row(j, data)
    if row < 0:
        return
    rising, falling = _bounds(j, speed)
    _numbers(data, EFC_LOSS)[row] = 0.5 * (rising + falling)
    bias = 0.5 * (falling - rising)
    if bias != 0.0:
        moment, column, passive = _numbers(data, MOMENT), _integers(data, COLUMN), _numbers(data, PASSIVE)
        start = _integers(data, START)[k]
        for i in range(start, start + _integers(data, NONZEROS)[k]):
            passive[column[i]] += bias * moment[i] / j[s.GEAR]


@njit
def _weigh(board, j, speed):
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


# Numba keeps compiled callbacks by this file's age and by what they close over. They close over the mark of the layout,
# so that a number more or less on the board compiles them anew, and never runs them on the places of another layout.
def _control(mark):
    """The callback before the solver, for boards whose first number is `mark`."""

    @callback(types.void(types.intp, types.intp), error_model="numpy")
    def control(model, data):
        """mjcb_control: replaces commands in ctrl by motor voltages and sets dry friction for this step."""
        joints = _joints(model, data, mark)
        if joints == 0:
            return
        board, ctrl, velocity = _numbers(data, USERDATA), _numbers(data, CTRL), _numbers(data, VELOCITY)
        length, qpos = _numbers(data, LENGTH), _numbers(data, QPOS)
        step = int(np.floor(carray(_pointer(data + TIME), 1, np.float64)[0] / board[s.STEP] + 0.5))
        period = int(board[s.PERIOD])
        for k in range(joints):
            j = board[s.HEAD + k * s.WIDTH :]
            speed = velocity[k] / j[s.GEAR]
            if step % period == 0:
                demand = ctrl[k]
                if j[s.SERVO] == 1.0:
                    demand = _servo(board, j, k, step // period, period * board[s.STEP], demand, qpos)
                j[s.DUTY] = _duty(board, j, demand, length[k] / j[s.GEAR] + j[s.OFFSET])
            _weigh(board, j, speed)
            j[s.SPEED] = speed
            _rub(j, data, k, speed)
        board[s.BUS] = _bus(board, joints, velocity)
        for k in range(joints):
            j = board[s.HEAD + k * s.WIDTH :]
            ctrl[k] = _driven(j, j[s.DUTY] * board[s.BUS])
            _move(board, j)

    return control


control = _control(s.MAGIC_VALUE)


def _sense(mark):
    """The callback after the solver, for boards whose first number is `mark`."""

    @callback(types.void(types.intp, types.intp, types.int32), error_model="numpy")
    def sense(model, data, stage):
        """mjcb_sensor: writes the board's outputs and stores the solver's forces for the next step's load."""
        joints = _joints(model, data, mark) if stage == AFTER_SOLVER else 0
        if joints == 0:
            return
        board, ctrl, qpos = _numbers(data, USERDATA), _numbers(data, CTRL), _numbers(data, QPOS)
        torque, constraint_force = _numbers(data, TORQUE), _numbers(data, EFC_FORCE)
        for k in range(joints):
            j = board[s.HEAD + k * s.WIDTH :]
            j[s.GIVEN] = torque[k] * j[s.GEAR]
            row = _row(j, data)
            if row >= 0:
                rising, falling = _bounds(j, j[s.SPEED])
                j[s.GIVEN] += constraint_force[row] + 0.5 * (falling - rising)
            angle = qpos[int(j[s.HINGE])]
            if j[s.PLAY] >= 0:
                angle += qpos[int(j[s.PLAY])]
            outputs = _numbers(data, SENSORDATA)[int(board[s.SENSOR]) + k * s.COLUMNS :]
            outputs[s.ANGLE], outputs[s.READING] = angle, _angle_read(j, qpos)
            outputs[s.VOLTS], outputs[s.FORCE] = ctrl[k], j[s.FORCE_NOW]

    return sense


sense = _sense(s.MAGIC_VALUE)
