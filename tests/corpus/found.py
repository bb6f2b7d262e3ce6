"""What the fuzzers found, cut down to what matters."""

import json

from corpus._log import ROWS, Log, T, U, Y, log, refused, stamped

SPLIT = {"columns": ["t", "u", "y"], "data": [list(row) for row in zip(T, U, Y, strict=True)]}

LOGS: dict[str, Log] = {
    "a header's sampling time is no way around a clock that runs back": log(
        '# qpal: {"Ts": 7}\nt,u,y\n' + stamped("0 0.1 0.2 0.9 0.4 0.5 0.6 0.7 0.8 0.3 1.0 1.1"), refused("row")
    ),
    "a tab at the end of each row but not of names with blanks": log(
        "t [s]\tu [V]\ty [rad]\n" + ROWS.replace(",", "\t").replace("\n", "\t\n")
    ),
    "a name of 5,000 letters that is not there": log(
        f"t,u,{'y' * 5000}\n" + ROWS, refused("'z'"), input="u", output="z"
    ),
    "a column of remarks that nobody made, between tabs": log(
        "note\tt\tu [V]\ty\n\t" + "\n\t".join(ROWS.replace(",", "\t").splitlines())
    ),
    "a digit of another script in an hour": log(
        "time,u,y\n" + stamped([f"{hour}:00:0{t}" for t, hour in zip(T, ["11"] * 6 + ["1\u0661"] * 6, strict=True)]),
        refused("row 8", "correct the cell"),
    ),
    "JSON, a sample of a split table is null": log(
        json.dumps({**SPLIT, "data": [SPLIT["data"][0], None, *SPLIT["data"][2:]]}),
        refused("entry 2", "null"),
        "a.json",
    ),
    "JSON, a stamp of 2^63": log(
        json.dumps([{"t": 2**63 if t == 1.1 else t, "u": u, "y": y} for t, u, y in zip(T, U, Y, strict=True)]),
        refused("entry 12", "--range"),
        "a.json",
    ),
}
