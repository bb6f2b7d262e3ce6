"""Signals with clocks of their own in tables of every kind: the rows are the output's, the input is held."""

import json
from itertools import zip_longest

import numpy as np

from corpus._log import Log, T, U, Y, log, refused
from corpus.binaries import mat, npz

CHANGES = [0, 2, 4, 6, 8, 10, 11]  # rows in which the input has another value: it is written then alone
T_U, U_ON_CHANGE = [T[k] for k in CHANGES], [U[k] for k in CHANGES]
LATER = [round(t + 0.03, 2) for t in T]  # the output's own clock
APART = "name it as clock of [[input]]"


def table(head: str, *columns: list[float] | tuple[float, ...], mark: str = ",") -> str:
    """Columns beside each other; shorter ones end in empty cells."""
    rows = (mark.join("" if x is None else f"{x:g}" for x in row) for row in zip_longest(*columns))
    return "\n".join([head, *rows, ""])


EACH = (T_U, U_ON_CHANGE, T, Y)
SHIFTED = (T, U, LATER, Y)
FEW = dict(zip(("t_u", "u", "t_y", "y"), map(np.array, EACH), strict=True))

LOGS: dict[str, Log] = {
    # the names say which
    "a clock for each signal by its name": log(table("t_u,u,t_y,y", *EACH)),
    "a clock for each signal, units in brackets": log(table("time_u [s],u,time_y [s],y", *EACH)),
    "a clock for each signal, time behind the name": log(table("u_time,u_value,y_time,y_value", *EACH)),
    "a clock for each signal, output first": log(table("y,t_y,u,t_u", Y, T, U_ON_CHANGE, T_U)),
    "a clock for each signal by its role": log(table("t_in,t_out,u,y", T_U, T, U_ON_CHANGE, Y)),
    "a clock for each signal in two units": log(table("t_u_ms,u,t_y_s,y", [1000 * t for t in T_U], U_ON_CHANGE, T, Y)),
    "a clock for each signal, semicolons and commas": log(table("t_u;u;t_y;y", *EACH, mark=";").replace(".", ",")),
    "a clock for each signal beside that of the log": log(table("time_log,t_u,u,t_y,y", [7 * t for t in T], *EACH)),
    # the place says which
    "clock and signal in turn": log(table("t1,u,t2,y", *EACH)),
    "clock and signal in turn, counted by a spreadsheet": log(table("Time,u,Time.1,y", *EACH)),
    "x and y of two traces": log(table("X,Y,X2,Y2", *EACH), input="Y", output="Y2"),
    "x and y of two traces, no roles": log(table("X,Y,X2,Y2", *EACH), refused("'Y', 'Y2'", "--output")),
    "x and y of two traces without names": log(table("", *EACH).lstrip("\n"), input="2", output="4"),
    # a shift that is the same in all rows
    "a shift between two clocks with names": log(table("t_u,u,t_y,y", *SHIFTED)),
    "a shift between two clocks in turn": log(table("t1,u,t2,y", *SHIFTED)),
    "two clocks of a row that are apart": log(table("time_s,u,stamp_s,y", *SHIFTED)),
    "two clocks of a row, out of step, whose owners nothing says": log(
        table("time_a,time_b,u,y", T, [1.3 * t for t in T], U, Y), refused("do not agree", APART)
    ),
    "a sampling time where each signal has its clock": log(
        table("t_u,u,t_y,y", *EACH), refused("leave --ts out"), Ts=0.1
    ),
    "newest first, a clock for each signal": log(table("t_u,u,t_y,y", *(list(x)[::-1] for x in SHIFTED))),
    # other formats
    "objects of times and values": log(
        json.dumps({"input": {"t": T_U, "v": U_ON_CHANGE}, "output": {"t": T, "v": Y}}), file="a.json"
    ),
    "objects of times and values within another": log(
        json.dumps({"rig": 3, "log": {"cmd": {"time": T_U, "value": U_ON_CHANGE}, "pos": {"time": T, "value": Y}}}),
        file="a.json",
    ),
    "arrays of other lengths": log(npz(**FEW), file="a.npz"),
    "arrays of other lengths, matrices of time and value": log(
        npz(u=np.column_stack(EACH[:2]), y=np.column_stack(EACH[2:])), file="a.npz"
    ),
    "arrays of other lengths, no clock": log(
        npz(u=FEW["u"], y=FEW["y"]), refused("u", "12", "clock of [[input]]"), file="a.npz", Ts=0.1
    ),
    "structs of Time and Data": log(mat(u={"Time": T_U, "Data": U_ON_CHANGE}, y={"Time": T, "Data": Y}), file="a.mat"),
    "structs of Time and Data in one": log(
        mat(logsout={"u": {"Time": T_U, "Data": U_ON_CHANGE}, "y": {"Time": T, "Data": Y}}), file="a.mat"
    ),
    "vectors of MATLAB, each with its time": log(mat(**FEW), file="a.mat"),
}
