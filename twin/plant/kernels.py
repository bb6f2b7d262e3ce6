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
from twin.plant import slots as s
from twin.plant.electronics import angle_read, bounds, bus, driven, duty, move, servo, weigh
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
def _rub(j, data, k, speed):
    """Set the bounds of dry friction for this step.

    MuJoCo's constraint has one bound for both directions; half the difference of the two is applied as a separate
    force.
    """
    row = _row(j, data)
    if row < 0:
        return
    rising, falling = bounds(j, speed)
    _numbers(data, EFC_LOSS)[row] = 0.5 * (rising + falling)
    bias = 0.5 * (falling - rising)
    if bias != 0.0:
        moment, column, passive = _numbers(data, MOMENT), _integers(data, COLUMN), _numbers(data, PASSIVE)
        start = _integers(data, START)[k]
        for i in range(start, start + _integers(data, NONZEROS)[k]):
            passive[column[i]] += bias * moment[i] / j[s.GEAR]


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
                    demand = servo(board, j, k, step // period, period * board[s.STEP], demand, qpos)
                j[s.DUTY] = duty(board, j, demand, length[k] / j[s.GEAR] + j[s.OFFSET])
            weigh(board, j, speed)
            j[s.SPEED] = speed
            _rub(j, data, k, speed)
        board[s.BUS] = bus(board, joints, velocity)
        for k in range(joints):
            j = board[s.HEAD + k * s.WIDTH :]
            ctrl[k] = driven(j, j[s.DUTY] * board[s.BUS])
            move(board, j)

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
                rising, falling = bounds(j, j[s.SPEED])
                j[s.GIVEN] += constraint_force[row] + 0.5 * (falling - rising)
            angle = qpos[int(j[s.HINGE])]
            if j[s.PLAY] >= 0:
                angle += qpos[int(j[s.PLAY])]
            outputs = _numbers(data, SENSORDATA)[int(board[s.SENSOR]) + k * s.COLUMNS :]
            outputs[s.ANGLE], outputs[s.READING] = angle, angle_read(j, qpos)
            outputs[s.VOLTS], outputs[s.FORCE] = ctrl[k], j[s.FORCE_NOW]

    return sense


sense = _sense(s.MAGIC_VALUE)
