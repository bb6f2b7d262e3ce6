"""What is declared once and read by the whole twin: the row of a physical parameter, and an imperfection."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import ClassVar

GUESS = "assumption"
GROUPS = ("friction", "mechanics", "bridge", "sensor")

Values = Mapping[str, float]  # of the rows, by name
OfBoard = Callable[[Values], float]
OfJoint = Callable[[Values, str], float]


@dataclass(frozen=True)
class Row:
    """A physical parameter. `lower` and `upper` bound what the twin accepts and what a calibration may search.

    `compiled` says whether the model that MuJoCo compiles depends on it; the motor board, the potentiometer or the
    logger reads the others.
    """

    name: str
    nominal: float
    lower: float
    upper: float
    unit: str
    source: str
    enters: str
    compiled: bool = True


class Imperfection:
    """What is not ideal about the leg, behind a switch of its own. Subclasses fill in class attributes.

    `group`: where it sits, one of `GROUPS`: in dry and viscous friction, elsewhere in the mechanics, between a command
    and the motor, or between the angle and the log.
    `rows`: parameters that it alone has and that all joints share. Those of a single joint are in `twin.parameters`.
    `ideal`: values, by row, of a leg without it; JOINT stands for each joint. They need not lie within the
    row's bounds.
    `board` and `joint`: numbers that the compiled motor board needs of it, by the name of their slot in
    `twin.plant.slots`, which numbers them; functions of the parameters' values, with those of what is off at `ideal`.
    `title`, `about`, `model`, `parameters` and `remark` are its section in docs/imperfections.md, in Markdown.
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
    board: ClassVar[Mapping[str, OfBoard]] = {}
    joint: ClassVar[Mapping[str, OfJoint]] = {}
