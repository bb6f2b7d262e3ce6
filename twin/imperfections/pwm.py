"""PWM resolution."""

from math import inf
from typing import ClassVar

from twin.imperfections._declaration import Imperfection, board_row


def levels(bits: float) -> int:
    """Number of duty levels from 0 to full of a timer of `bits`; 0 means a duty without levels."""
    return 0 if bits == inf else 2 ** round(bits) - 1


class Pwm(Imperfection):
    """Infinitely many bits: a bridge without duty levels."""

    name, group = "pwm", "bridge"
    title = "PWM resolution"
    about = "The timer of the bridge has a finite number of duty levels."
    model = (
        "the duty ratio is rounded to a multiple of 1 / (2^pwm_bits − 1). Ripple is not modelled, because the rotor "
        "does not follow it."
    )
    parameters = "`pwm_bits`, `supply_voltage`."
    rows = (board_row("pwm_bits", 8, 4, 16, "1", "drive: duty in steps of 1 / (2^bits - 1)"),)
    ideal: ClassVar = {"pwm_bits": inf}
    board: ClassVar = {"LEVELS": lambda p, joint: levels(p["pwm_bits"])}
