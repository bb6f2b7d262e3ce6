"""Declarations that the whole twin reads: the row of a physical parameter, and an imperfection."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import ClassVar

from twin.imperfections._signature import Show

GUESS = "assumption"
GROUPS = ("friction", "mechanics", "bridge", "sensor")

Values = Mapping[str, float]  # of the rows, by name
Slot = str | float | Callable[[Values, str], float]  # a row's name, a number, or a function of values and joint


@dataclass(frozen=True)
class Row:
    """A physical parameter. The twin accepts, and a calibration searches, values from `lower` to `upper`.

    `compiled`: whether MuJoCo's compiled model depends on it; the motor board, the potentiometer or the logger reads
    the others.
    """

    name: str
    nominal: float
    lower: float
    upper: float
    unit: str
    source: str
    enters: str
    compiled: bool = True


def board_row(
    name: str, nominal: float, lower: float, upper: float, unit: str, enters: str, source: str = GUESS
) -> Row:
    """A row on which MuJoCo's model does not depend; the motor board, the potentiometer or the logger reads it."""
    return Row(name, nominal, lower, upper, unit, source, enters, compiled=False)


class Imperfection:
    """An imperfection of the leg with its own switch. Subclasses fill in class attributes.

    `group`: its place, one of `GROUPS`: dry and viscous friction, other mechanics, between the command and the motor,
    or between the angle and the log. `rows`: parameters that only this imperfection has and that all joints share.
    Parameters of a single joint are in `twin.parameters`. `ideal`: values by row of a leg without it; JOINT stands for
    each joint. They may lie outside the row's bounds.

    `board` and `joint`: its numbers for the compiled motor board, one for the board or one for each joint, by the name
    of their slot in `twin.plant.slots`: the name of a row, where JOINT stands for the joint; a number, with which a
    state begins; or a function of the parameter values, in which switched-off imperfections are at `ideal`, and of
    the joint.

    `step(board, j, s)` moves the states in `j`, the slots of a joint, or in `board` by one step of the simulation,
    board[s.STEP] [s]. `effect(j, s, value)` gives what becomes of a value of the joint: of the bound of dry friction
    for the group "friction", of the motor voltage [V] for "bridge", of the angle [rad] read by the potentiometer for
    "sensor". `s` has the places of `twin.plant.slots` by name. Both are static methods that numba can compile.

    `show(p, lab)` is its signature: an experiment on the `lab` with the parameters `p`; without it the signature
    stands in `twin.signatures`.

    `title`, `about`, `model`, `parameters` and `remark` make its section in docs/imperfections.md, in Markdown.
    """

    name: ClassVar[str]
    group: ClassVar[str]
    title: ClassVar[str]
    about: ClassVar[str]
    model: ClassVar[str]
    parameters: ClassVar[str]
    remark: ClassVar[str] = ""
    rows: ClassVar[tuple[Row, ...]] = ()
    ideal: ClassVar[Mapping[str, float]]
    board: ClassVar[Mapping[str, Slot]] = {}
    joint: ClassVar[Mapping[str, Slot]] = {}
    step: ClassVar[Callable[..., None] | None] = None
    effect: ClassVar[Callable[..., float] | None] = None
    show: ClassVar[Show | None] = None


def slot_value(slot: Slot, values: Values, joint: str) -> float:
    """The number that stands in a slot of the board of `joint` at first."""
    if isinstance(slot, str):
        return values[slot.replace("JOINT", joint)]
    return slot(values, joint) if callable(slot) else slot
