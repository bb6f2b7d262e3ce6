"""Imperfections of the leg: one file, one class and one line in `TABLE` each.

`TABLE` has the order of the documentation.

A class declares its parameter rows, their ideal values when it is switched off, its numbers for the motor board, its
text, and what it may have of a state that moves, an effect, and an experiment that shows it. What the motor board does
of itself stands in `twin.plant.electronics`, and experiments that need the leg's hardware stand in `twin.signatures`.
"""

from twin.imperfections._declaration import GROUPS, GUESS, Imperfection, Row, board_row, slot_value
from twin.imperfections._signature import (
    Axis,
    Lab,
    Line,
    Mark,
    Show,
    Signature,
    Size,
    Trial,
    holds,
    line_fit,
    steady_speeds,
)
from twin.imperfections.adc import Adc
from twin.imperfections.asymmetry import Asymmetry
from twin.imperfections.backlash import Backlash
from twin.imperfections.contact import Contact
from twin.imperfections.dead_band import DeadBand
from twin.imperfections.delay import Delay
from twin.imperfections.dropouts import Dropouts
from twin.imperfections.end_stops import EndStops
from twin.imperfections.friction import Friction
from twin.imperfections.gravity import Gravity
from twin.imperfections.jitter import Jitter
from twin.imperfections.load_friction import LoadFriction
from twin.imperfections.noise import Noise
from twin.imperfections.nonlinearity import Nonlinearity
from twin.imperfections.pwm import Pwm
from twin.imperfections.sag import Sag
from twin.imperfections.stribeck import Stribeck

TABLE: dict[str, type[Imperfection]] = {
    "friction": Friction,
    "asymmetry": Asymmetry,
    "stribeck": Stribeck,
    "load_friction": LoadFriction,
    "end_stops": EndStops,
    "backlash": Backlash,
    "pwm": Pwm,
    "dead_band": DeadBand,
    "sag": Sag,
    "delay": Delay,
    "nonlinearity": Nonlinearity,
    "noise": Noise,
    "adc": Adc,
    "jitter": Jitter,
    "dropouts": Dropouts,
    "gravity": Gravity,
    "contact": Contact,
}
IMPERFECTIONS = tuple(TABLE)


def of_group(*groups: str) -> tuple[str, ...]:
    """Names of the imperfections in these groups, of `GROUPS`."""
    return tuple(name for name, kind in TABLE.items() if kind.group in groups)


__all__ = [
    "GROUPS",
    "GUESS",
    "IMPERFECTIONS",
    "TABLE",
    "Axis",
    "Imperfection",
    "Lab",
    "Line",
    "Mark",
    "Row",
    "Show",
    "Signature",
    "Size",
    "Trial",
    "board_row",
    "holds",
    "line_fit",
    "of_group",
    "slot_value",
    "steady_speeds",
]
