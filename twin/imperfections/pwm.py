"""PWM resolution."""

from collections.abc import Mapping
from math import inf
from typing import ClassVar

from twin.declared import GUESS, Imperfection, OfBoard, Row


def levels(bits: float) -> int:
    """Levels of the duty from 0 to full of a timer of `bits`; 0 stands for a duty without levels."""
    return 0 if bits == inf else 2 ** round(bits) - 1


class Pwm(Imperfection):
    """Infinitely many bits are a bridge without levels."""

    name, group = "pwm", "bridge"
    title = "PWM resolution"
    about = "The bridge's timer counts to a power of two, less one."
    model = (
        "the duty is rounded to a multiple of 1 / (2^pwm_bits − 1). Ripple is not modelled: the rotor does not follow"
        " it."
    )
    parameters = "`pwm_bits`, `supply_voltage`."
    rows = (Row("pwm_bits", 8, 4, 16, "1", GUESS, "drive: duty in steps of 1 / (2^bits - 1)", compiled=False),)
    ideal: ClassVar[Mapping[str, float]] = {"pwm_bits": inf}
    board: ClassVar[Mapping[str, OfBoard]] = {"LEVELS": lambda p: levels(p["pwm_bits"])}
