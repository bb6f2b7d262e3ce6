"""Logs that led a newcomer in a circle: each is read, or its first sentence is the one that helps."""

from corpus._log import PAIRS, ROWS, SEMI, Log, Right, U, Y, log, refused, with_row

HEAD = "time [s],voltage [V],angle [rad]\n"
STILL_U = HEAD + "".join(f"{k / 10},12,{y:g}\n" for k, y in enumerate(Y))
STILL_Y = HEAD + "".join(f"{k / 10},{u:g},0\n" for k, u in enumerate(U))
ONE = "time [s],voltage [V]\n" + "".join(f"{k / 10},{u:g}\n" for k, u in enumerate(U))
UNITS = "t,duty [%],angle [rad]\n" + "".join(
    f"{k / 10},{u}%,{y}rad\n" for k, (u, y) in enumerate(zip(U, Y, strict=True))
)
MILLI = [(k * 100, 1000 * u, y) for k, (u, y) in enumerate(zip(U, Y, strict=True))]


def parted(mark: str, decimal: str) -> str:
    """The rows in ms and mV, with thousands marks."""
    lines = (f"{t:,};{u:,.1f};{y:.2f}\n" for t, u, y in MILLI)
    return "t [ms];u [mV];y [rad]\n" + "".join(lines).replace(",", "_").replace(".", decimal).replace("_", mark)


LOGS: dict[str, Log] = {
    # one header too many
    "the header again where the time goes on": log(
        HEAD + with_row(7, HEAD.strip() + "\n" + ROWS.splitlines()[6]),
    ),
    "two logs under one another": log(HEAD + ROWS + HEAD + ROWS, Right(u=U + U, y=Y + Y)),
    "two logs under one another without a clock": log(
        2 * ("voltage [V],angle [rad]\n" + PAIRS), refused("row 14", "the header again", "split it there"), Ts=0.1
    ),
    "hexadecimal words without 0x": log(
        "time [ms],command,position\n" + "".join(f"{100 * k},F{k:X}A,{k:X}F\n" for k in range(12)),
        refused("hexadecimal words without 0x are in command, position: set base = 16"),
    ),
    # nothing that moves
    "a constant input": log(STILL_U, refused("voltage [V] never changes", "record again while the input moves")),
    "a constant input, named": log(
        STILL_U, refused("'voltage [V]' is 12 in all 12 samples; choose a column that moves"), input="voltage [V]"
    ),
    "a constant input, the output named": log(
        STILL_U, refused("record again while the input moves"), output="angle [rad]"
    ),
    "a constant output": log(STILL_Y, refused("angle [rad] never changes", "record again while the output moves")),
    "a constant output, named": log(
        STILL_Y, refused("'angle [rad]' is 0 in all 12 samples; choose a column that moves"), output="angle [rad]"
    ),
    "no output": log(ONE, refused("time [s] shows time", "no column is left for the output")),
    "no output, and the input named as one": log(ONE, refused("no column is left for the input"), output="voltage [V]"),
    "no output, and the clock named as the input": log(
        ONE, refused("no sampling time is given"), output="voltage [V]", input="time [s]"
    ),
    # numbers that are spelled otherwise
    "a minus of Unicode": log(HEAD + ROWS.replace("-", "\u2212")),
    "a minus of Unicode and decimal commas": log("t;u;y\n" + SEMI.replace("-", "\u2212")),
    "cells with units": log(UNITS, refused("row 2", "duty [%]", "'0.5%'", "a number with its unit")),
    "an error of a spreadsheet": log(
        HEAD + with_row(6, "0.5,2,#N/A"), refused("row 7", "'#N/A'", "empty the cell, which is then a missing value")
    ),
    "thousands parted by blanks": log(parted("\u202f", ","), refused("row 4", "thousands marks, -1000,0 if")),
    "thousands parted by points": log(parted(".", ","), refused("'1.000' parts thousands, remove")),
    "thousands parted by commas": log(parted(",", "."), refused("'1,000' parts thousands, remove")),
    "thousands and decimals parted by points": log(parted(".", "."), refused("'-1.000.0', which is not a number")),
    "thousands not parted": log(parted("", ","), Right(y=tuple(round(y, 2) for y in Y))),
}
