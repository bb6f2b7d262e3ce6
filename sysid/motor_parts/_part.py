"""What a part of a motor is."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

from sysid.block.block import Slot


@dataclass(frozen=True)
class Known:
    """Centre and spread of a parameter, in the unit `of` that a joint gives it (see `sysid.joint.prior.units_of`)."""

    centre: float
    spread: float
    of: str


@dataclass(frozen=True)
class MotorPart:
    """A part by name: its term in the motor's step, parameters, prior, symmetry and words.

    `drag(s, p)` are volts of friction against the motion beside the dry ones; `drive(s, w, h, p)` is what is left of a
    drive of w volts over a time h, and may move states of its own, which begin at zero. `absent`: the parameters'
    values of a motor without the part. `known`: what is usual of each parameter. `shown`: the parameter that is zero
    without the part. `volts` and `places`: the power of a parameter's value that goes with the unit of the input
    and of the position. `equation`: a line with {} for each parameter, in their order.
    """

    name: str
    words: str
    slots: tuple[Slot, ...]
    absent: Mapping[str, float]
    known: Mapping[str, Known]
    shown: str
    equation: str
    drag: Callable | None = None
    drive: Callable | None = None
    volts: Mapping[str, float] = field(default_factory=dict)
    places: Mapping[str, float] = field(default_factory=dict)

    @property
    def term(self) -> Callable:
        """What it adds to the step: the drag, or the drive."""
        term = self.drag or self.drive
        assert term is not None
        return term
