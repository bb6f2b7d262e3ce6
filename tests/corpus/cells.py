"""What stands in a cell: nothing, words, booleans, very large and very small numbers; and files of few rows."""

from corpus._log import PAIRS, ROWS, SAFE, TS, Log, Right, U, Y, log, refused, with_row

HEAD = "t,u,y\n"
BRIDGED = Right(y=(*Y[:5], 1.875, *Y[6:]))  # the output at 0.5 s on the line between 0.25 and 3.5
ZERO_ONE = Right(u=(0.0, 0.0, 1.0, 1.0, 0.0, 0.0, 1.0, 1.0, 0.0, 0.0, 1.0, 0.0))


def missing(word: str) -> str:
    """The rows without the output at 0.5 s."""
    return with_row(6, f"0.5,2,{word}")


def scaled(u: float, y: float) -> Log:
    """The rows with both signals in other units."""
    rows = "".join(f"{k / 10},{u * a!r},{y * b!r}\n" for k, (a, b) in enumerate(zip(U, Y, strict=True)))
    return log(HEAD + rows, Right(tuple(u * a for a in U), tuple(y * b for b in Y), or_refused=not min(u, y) > 1e-30))


def switched(off: str, on: str) -> str:
    """Rows with a switch as their input."""
    return "".join(f"{k / 10},{(off, on)[int(s)]},{y:g}\n" for k, (s, y) in enumerate(zip(ZERO_ONE.u, Y, strict=True)))


def more(*cells: str) -> str:
    """The rows with one more column."""
    return "".join(f"{row},{cells[k % len(cells)]}\n" for k, row in enumerate(ROWS.split()))


LOGS: dict[str, Log] = {
    # no value
    "an empty output": log(HEAD + missing(""), refused("row 7", "empty")),
    "an empty output is marked": log(HEAD + missing(""), BRIDGED, missing="mark"),
    "an empty input": log(HEAD + with_row(6, "0.5,,2"), refused("row 7", "'u'", "empty")),
    "an empty input is never marked": log(HEAD + with_row(6, "0.5,,2"), refused("'u'"), missing="mark"),
    "NaN, as Python writes it": log(HEAD + missing("nan"), BRIDGED, missing="mark"),
    "NaN, as MATLAB writes it": log(HEAD + missing("NaN"), BRIDGED, missing="mark"),
    "NaN, refused": log(HEAD + missing("NaN"), refused("row 7", "NaN")),
    "-nan, as C writes it": log(HEAD + missing("-nan"), Right(y=BRIDGED.y, or_refused=True), missing="mark"),
    "-nan(ind), as Windows writes it": log(
        HEAD + missing("-nan(ind)"), Right(y=BRIDGED.y, or_refused=True), missing="mark"
    ),
    "1.#QNAN, as old Windows writes it": log(
        HEAD + missing("1.#QNAN"), Right(y=BRIDGED.y, or_refused=True), missing="mark"
    ),
    "NA": log(HEAD + missing("NA"), BRIDGED, missing="mark"),
    "N/A": log(HEAD + missing("N/A"), BRIDGED, missing="mark"),
    "#N/A, as Excel writes it": log(HEAD + missing("#N/A"), Right(y=BRIDGED.y, or_refused=True), missing="mark"),
    "#DIV/0!": log(HEAD + missing("#DIV/0!"), Right(y=BRIDGED.y, or_refused=True), missing="mark"),
    "null": log(HEAD + missing("null"), BRIDGED, missing="mark"),
    "None": log(HEAD + missing("None"), BRIDGED, missing="mark"),
    "a dash": log(HEAD + missing("-"), BRIDGED, missing="mark"),
    "two dashes": log(HEAD + missing("--"), BRIDGED, missing="mark"),
    "a question mark": log(HEAD + missing("?"), Right(y=BRIDGED.y, or_refused=True), missing="mark"),
    "OVERFLOW": log(HEAD + missing("OVERFLOW"), Right(y=BRIDGED.y, or_refused=True), missing="mark"),
    "infinite": log(HEAD + missing("inf"), refused("row 7", "infinite"), missing="mark"),
    "-1.#INF, as old Windows writes it": log(HEAD + missing("-1.#INF"), refused("row 7"), missing="mark"),
    "two empty outputs": log(HEAD + with_row(6, "0.5,2,", missing("")), BRIDGED, missing="mark"),
    "the first output is empty": log(HEAD + with_row(1, "0.0,0.5,"), Right(U[1:], Y[1:]), missing="mark"),
    "an empty row between": log(HEAD + with_row(6, ",,"), SAFE),
    "empty rows at the end": log(HEAD + ROWS + ",,\n,,\n", SAFE),
    "all outputs are empty": log(
        HEAD + "".join(row.rpartition(",")[0] + ",\n" for row in ROWS.split()), refused("y"), missing="mark"
    ),
    # words
    "a word in a cell": log(HEAD + missing("broken"), refused("row 7", "'broken'"), missing="mark"),
    "a unit in a cell": log(HEAD + missing("2 V"), refused("row 7", "'2 V'")),
    "a letter O for a zero": log(HEAD + missing("2.O"), refused("row 7", "'2.O'")),
    "a letter l for a one": log(HEAD + missing("l.5"), refused("row 7", "'l.5'")),
    "two points": log(HEAD + missing("2.0.0"), refused("row 7", "'2.0.0'")),
    "a long minus": log(HEAD + with_row(3, "0.2,\u22121,-0.5"), SAFE),
    "digits of another alphabet": log(HEAD + missing("\u0662"), SAFE),
    "a hexadecimal number": log(HEAD + missing("0x02"), refused("row 7", "'0x02'")),
    "a fraction": log(HEAD + missing("4/2"), refused("row 7", "'4/2'")),
    "a column of words beside": log("t,u,y,mode\n" + more("auto", "hand")),
    "a column of words in front": log("mode,t,u,y\n" + "".join(f"auto,{row}\n" for row in ROWS.split())),
    "a remark in the last cell of some rows": log("t,u,y,remark\n" + more("", "", "", "touched")),
    "a column of error codes": log("t,u,y,status\n" + more("0", "0", "17")),
    "a column that is always zero": log("t,u,y,v\n" + more("0")),
    "a column of another program that is empty": log("t,u,y,z\n" + more("")),
    # booleans
    "a switch of 0 and 1": log(HEAD + switched("0", "1"), ZERO_ONE),
    "a switch of False and True": log(HEAD + switched("False", "True"), Right(ZERO_ONE.u, or_refused=True)),
    "a switch of off and on": log(HEAD + switched("off", "on"), Right(ZERO_ONE.u, or_refused=True)),
    "a boolean column beside": log("t,u,y,ok\n" + more("True", "False")),
    # short files
    "nothing": log("", refused("is empty")),
    "blanks alone": log(" \n\t\n", refused("no rows")),
    "a byte order mark alone": log("\ufeff", refused("no rows")),
    "names alone": log(HEAD, refused("no rows")),
    "names and units alone": log("t,u,y\ns,V,V\n", refused("no whole row")),
    "one row": log(HEAD + "0,1,2\n", refused("--ts")),
    "one row and a sampling time": log("u,y\n1,2\n", refused("2"), Ts=TS),
    "two rows": log(HEAD + "0,1,2\n0.1,2,3\n", Right((1.0, 2.0), (2.0, 3.0), or_refused=True)),
    "three rows": log(HEAD + "0,1,2\n0.1,2,3\n0.2,1,5\n", Right((1.0, 2.0, 1.0), (2.0, 3.0, 5.0))),
    "one column": log("y\n" + "".join(f"{y}\n" for y in Y), refused("left for the input"), Ts=TS),
    "one column without a name": log("".join(f"{y}\n" for y in Y), refused("left for the input"), Ts=TS),
    "one row of many numbers": log(",".join(map(str, range(200))) + "\n", refused("--")),
    "text of a letter": log("Dear Ms Meyer,\nhere are the data, as you asked.\nYours\n", refused("")),
    "a web page": log("<!DOCTYPE html>\n<html><body>404, not found</body></html>\n", refused("")),
    "source of a program": log("import numpy as np\n\nx = np.zeros((3, 2))\nprint(x, x.T)\n", refused("")),
    "the last row is cut behind a mark": log((HEAD + ROWS)[:-6], Right(U[:-1], Y[:-1])),
    "the last row is cut within its first cell": log((HEAD + ROWS)[:-9], Right(U[:-1], Y[:-1])),
    # sizes of numbers
    "numbers near 1e-12": scaled(1e-12, 1e-12),
    "numbers near 1e12": scaled(1e12, 1e12),
    "numbers near 1e60": scaled(1e60, 1e60),
    "numbers near 1e-60": scaled(1e-60, 1e-60),
    "numbers above 1e100": log(HEAD + missing("1e160"), refused("row 7", "1e100")),
    "a number that no float64 holds": log(HEAD + missing("1e999"), refused("row 7", "infinite")),
    "a number of 400 digits": log(HEAD + missing("2" + "0" * 400), refused("row 7", "infinite")),
    "a number of 40 decimals": log(HEAD + missing("2." + "0" * 40)),
    "a cell of 5,000 letters": log(HEAD + missing("x" * 5000), refused("row 7")),
    "minus zero": log(HEAD + with_row(11, "1.0,-0.0,-2.25")),
    "a number below the smallest": log(HEAD + with_row(11, "1.0,1e-400,-2.25")),
    "an input that never moves": log(
        "t,u,y\n" + "".join(f"{k / 10},1,{y}\n" for k, y in enumerate(Y)), refused("u"), input="u", output="y"
    ),
    "an output that never moves": log(
        "t,u,y\n" + "".join(f"{k / 10},{u},1\n" for k, u in enumerate(U)), refused("y"), input="u", output="y"
    ),
    "pairs without a clock": log("u,y\n" + PAIRS, refused("--ts")),
}
