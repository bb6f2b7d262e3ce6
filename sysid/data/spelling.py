"""Why a cell is no number, and what to write instead."""

import re

PARTED = re.compile(r"[+-]?\d{1,3}(?:([,.'\u2019 \u00a0\u202f])\d{3})(?:\1\d{3})*(?:(?!\1)[.,]\d*)?")
FORTRAN = re.compile(r"[+-]?(?:\d+\.?\d*|\.\d+)[dD][+-]?\d+")
UNITS = "[mkuµμ]?V|[muµμ]?A|°|º|deg|Grad|m?rad|%|[mnuµμ]?s|sec|rpm|1/min|[mc]?Nm?|[cmk]?m|Hz|kHz|counts?|ticks?"
WITH_UNIT = re.compile(rf"[+-]?(?:\d+[.,]?\d*|[.,]\d+)(?:[eE][+-]?\d+)?\s*({UNITS})")
LETTERS = re.compile(r"[+-]?[.,]?\d[\d.,]{0,40}")
ERRORS = ("#n/a", "#div/0!", "#value!", "#ref!", "#name?", "#num!", "#null!")  # of a spreadsheet, in small letters
LONGEST = 40  # letters of a cell that is looked at, and shown


def why_no_number(cell: str, column: str, decimal: str = ".") -> str:
    """What stands in a cell of `column` that is no number, and what to do."""
    text, short = cell.strip(), cell if len(cell) <= LONGEST else cell[: LONGEST - 3] + "..."
    found = f"found {short!r}"
    if text == column.strip():
        return (
            f"{found}, the header again: where two logs stand in one file, split it there into two (qpal identify "
            "takes several); where the time goes on, remove the row"
        )
    if text.lower() in ERRORS:
        return f"{found}, an error of a spreadsheet; empty the cell, which is then a missing value"
    if len(text) <= LONGEST and (unit := WITH_UNIT.fullmatch(text)):
        return f"{found}, a number with its unit; write numbers alone: {unit[1]!r} belongs into the header"
    return f"{found}, which is not a number; correct the cell{_as_number(text, decimal) if is_spelled(text) else ''}"


def _as_number(text: str, decimal: str) -> str:
    """How a number is written that other programs spell with thousands marks or with the exponent of Fortran."""
    if FORTRAN.fullmatch(text):
        return f": write {text.upper().replace('D', 'e')}"
    parted = PARTED.fullmatch(text)
    assert parted is not None
    number = text.replace(parted[1], "").replace(",", ".").rstrip(".").replace(".", decimal)
    return f": write numbers without thousands marks, {number} if that is meant"


def is_like_a_number(text: str) -> bool:
    """Whether a text that is no number was meant as one: it is spelled as one, or has the letters of one."""
    return is_spelled(text) or LETTERS.fullmatch(text.strip()) is not None


def is_spelled(text: str) -> bool:
    """Whether a text that is no number stands for one beyond doubt: with thousands marks, a unit, or as in Fortran."""
    text = text.strip()
    return len(text) <= LONGEST and any(form.fullmatch(text) for form in (FORTRAN, PARTED, WITH_UNIT))
