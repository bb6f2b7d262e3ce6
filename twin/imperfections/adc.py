"""Quantisation."""

from math import inf
from typing import ClassVar

from twin.imperfections._declaration import Imperfection, board_row


class Adc(Imperfection):
    """Infinitely many bits: a converter without quantisation."""

    name, group = "adc", "sensor"
    title = "Quantisation"
    about = "The analogue-to-digital converter has a finite number of codes."
    model = "readings are rounded to multiples of pot_range / 2^adc_bits and limited to the first and the last code."
    parameters = "`adc_bits`, `pot_range`."
    rows = (
        board_row(
            "adc_bits",
            10,
            4,
            24,
            "1",
            "pot: 2^bits codes over pot_range",
            "assumption: the 10-bit converter usual on such an MCU board",
        ),
    )
    ideal: ClassVar = {"adc_bits": inf}
