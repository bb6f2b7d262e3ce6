"""The motor board's numbers in MuJoCo's user data: one name a place. HEAD of the board, then WIDTH for each joint.

Slots are numbered automatically; the numbers of the imperfections follow the board's own. Plain
integers, so that compiled code can use them by name.
"""

import inspect
from collections import namedtuple
from pathlib import Path
from zlib import crc32

from twin.imperfections import TABLE

# The board. MAGIC marks user data as the board's own: a model whose first number is another is left alone.
(
    MAGIC,
    JOINTS,
    STEP,  # [s] of the simulation
    PERIOD,  # simulation steps between two looks at commands, switches and potentiometers
    SUPPLY,  # [V] without load
    SEED,  # of the noise in the servo loop
    SENSOR,  # where the board's sensor begins in sensordata
    FILTER,  # share of a new load that enters its average
    BUS,  # [V] state: supply under load
) = range(9)

# A joint. "Drive" is the rod [m, N] or the shoulder's gear output [rad, N m].
(
    GEAR,  # rotor angle per drive position
    CONSTANT,  # [V s/rad]
    RESISTANCE,  # [Ohm]
    INERTIA,  # of the rotor, at the drive
    VISCOUS,
    ROW_TYPE,  # of the dry friction among MuJoCo's constraints
    ROW_ID,
    COULOMB_UP,
    COULOMB_DOWN,
    OFFSET,  # drive position less actuator length / gear
    LOWER,  # limit switches
    UPPER,
    HINGE,  # address in qpos
    PLAY,  # address in qpos; -1: none
    POT_PLAY,  # the same if the potentiometer sees the play, else -1
    SERVO,  # 1: the command is a reference
    KP,
    KI,
    KD,
    POT_SCALE,  # [V/rad]
    POT_STEP,  # [rad]; 0: no ADC
    POT_HALF,  # codes to one side
    POT_NONLINEARITY,  # [rad]
    POT_WAVE,  # [rad/rad]
    DUTY,  # state: part of the supply, -1 to 1
    LOAD,  # state: averaged force of the drive on the link
    INTEGRAL,  # state: of the servo's error [V s]
    LAST,  # state: the servo's last reading [V]; NaN before the first
    GIVEN,  # state: motor and dry friction on the drive in the last step; NaN before the first
    SPEED,  # state: of the drive in the last step
    FORCE_NOW,  # state: force of the drive on the link in the last step
) = range(31)

# What imperfections need, by name: of the board, and of each joint.
OF_BOARD = {name: k for k, name in enumerate((n for each in TABLE.values() for n in each.board), start=BUS + 1)}
OF_JOINT = {name: k for k, name in enumerate((n for each in TABLE.values() for n in each.joint), start=FORCE_NOW + 1)}
HEAD = BUS + 1 + len(OF_BOARD)
WIDTH = FORCE_NOW + 1 + len(OF_JOINT)
_twice = {name for name in (*OF_BOARD, *OF_JOINT) if name in globals() or (name in OF_BOARD and name in OF_JOINT)}
assert not _twice, f"two numbers of the board are called {', '.join(_twice)}"
globals().update(OF_BOARD | OF_JOINT)


def __getattr__(name: str) -> int:
    """Names of OF_BOARD and OF_JOINT are also integers here; this declares them for type checkers."""
    raise AttributeError(f"no number of the board is called {name}")


# What the sensor shows of each joint: angle between the links [rad], what the potentiometer would read without noise
# and ADC [rad], motor voltage [V], force of the drive on the link [N or N m].
ANGLE, READING, VOLTS, FORCE = range(4)
COLUMNS = 4

PLACES_BY_NAME = {name: value for name, value in globals().items() if name.isupper() and isinstance(value, int)}
PLACES = namedtuple("PLACES", PLACES_BY_NAME)(**PLACES_BY_NAME)  # for the steps and effects of imperfections

# The first number tells boards of this very layout, and of these very steps, effects and electronics: compiled code in
# the cache of another one must not touch them.
_compiled = [
    Path(__file__).with_name("electronics.py").read_text(encoding="utf-8"),
    *(
        kind.group + inspect.getsource(function)
        for kind in TABLE.values()
        for function in (kind.step, kind.effect)
        if function is not None
    ),
]
MAGIC_VALUE = 20161001.0 + crc32("".join([repr(PLACES_BY_NAME), *_compiled]).encode())
