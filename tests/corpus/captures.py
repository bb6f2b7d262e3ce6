"""JSON in the forms of several programs, JSON lines, and what a microcontroller printed."""

import json

from corpus._log import PAIRS, ROWS, SAFE, TS, Log, Right, T, U, Y, log, refused, with_row

SAMPLES = [{"t": t, "u": u, "y": y} for t, u, y in zip(T, U, Y, strict=True)]
COLUMNS = {"t": list(T), "u": list(U), "y": list(Y)}
LINES = "".join(json.dumps(sample) + "\n" for sample in SAMPLES)
BRIDGED = Right(y=(*Y[:5], 1.875, *Y[6:]))
COUNTS = Right(tuple(float(k % 5 * 20 - 40) for k in range(30)), tuple(512.0 + k * k % 17 for k in range(30)), 0.01)
PRINTED = [f"{1000 + 10 * k},{k % 5 * 20 - 40},{512 + k * k % 17}" for k in range(30)]


def js(value: object, answer: object = None, file: str = "a.json", fails: str = "", **options: object) -> Log:
    """An entry with this value as JSON."""
    return log(json.dumps(value), answer or Right(), file, fails, **options)  # type: ignore[arg-type]


def changed(place: int, **entries: object) -> list[dict]:
    """The samples with other entries in one of them; ... takes an entry out."""
    found = [dict(sample) for sample in SAMPLES]
    found[place] |= entries
    found[place] = {key: value for key, value in found[place].items() if value is not ...}
    return found


def printed(**rows: str) -> str:
    """The lines of a microcontroller behind its start; `row7=` is row 7 instead, where the names are row 2."""
    lines = ["boot 1.7 ok", "ms,pwm,adc", *PRINTED]
    for name, text in rows.items():
        lines[int(name[3:]) - 1] = text
    return "\r\n".join(lines) + "\r\n"


def without(*places: int) -> Right:
    """The printed record without the samples at these places, which are filled again."""
    y = list(COUNTS.y)
    u = list(COUNTS.u)
    for k in places:
        u[k], y[k] = u[k - 1], (y[k - 1] + y[k + 1]) / 2
    return Right(tuple(u), tuple(y), COUNTS.Ts)


LOGS: dict[str, Log] = {
    # JSON
    "JSON, a list of samples": js(SAMPLES),
    "JSON, columns as lists": js(COLUMNS),
    "JSON, rows as lists": js([list(row) for row in zip(T, U, Y, strict=True)], time="1", input="2", output="3"),
    "JSON, columns as lists of a list": js([list(T), list(U), list(Y)], time="1", input="2", output="3"),
    "JSON, as pandas splits it": js(
        {"columns": ["t", "u", "y"], "index": list(range(12)), "data": [list(row) for row in zip(T, U, Y, strict=True)]}
    ),
    "JSON, as pandas writes columns": js(
        {name: {str(k): x for k, x in enumerate(values)} for name, values in COLUMNS.items()}
    ),
    "JSON, as pandas writes an index": js({str(k): sample for k, sample in enumerate(SAMPLES)}, SAFE),
    "JSON, as pandas writes a table": js({"schema": {"fields": [{"name": "t", "type": "number"}]}, "data": SAMPLES}),
    "JSON, samples beside what was said": js({"rig": 7, "Ts": 0.1, "samples": SAMPLES}),
    "JSON, nested objects": js(
        [{"t": s["t"], "motor": {"u": s["u"]}, "arm": {"y": s["y"]}} for s in SAMPLES], input="motor.u", output="arm.y"
    ),
    "JSON, lists in samples": js([{"t": s["t"], "x": [s["u"], s["y"]]} for s in SAMPLES], input="x[0]", output="x[1]"),
    "JSON, texts beside": js([{**s, "mode": "auto"} for s in SAMPLES]),
    "JSON, numbers as texts": js([{k: str(v) for k, v in s.items()} for s in SAMPLES], SAFE),
    "JSON, booleans": js(
        [{"t": s["t"], "u": s["u"] > 0, "y": s["y"]} for s in SAMPLES], Right(u=tuple(float(u > 0) for u in U))
    ),
    "JSON, a null": js(changed(5, y=None), BRIDGED, missing="mark"),
    "JSON, a null refused": js(changed(5, y=None), refused("entry 6", "'y'")),
    "JSON, a key is missing": js(changed(5, y=...), refused("entry 6", "'y'")),
    "JSON, a list for a number": js(changed(5, y=[2.0]), refused("y")),
    "JSON, a text for a number": js(changed(5, y="two"), refused("entry 6", "'two'")),
    "JSON, NaN": log(json.dumps(changed(5, y=float("nan"))), BRIDGED, "a.json", missing="mark"),
    "JSON, infinite": log(json.dumps(changed(5, y=float("inf"))), refused("entry 6", "infinite"), "a.json"),
    "JSON, a number of 400 digits": log(json.dumps(changed(5, y=10**400)), refused("entry 6"), "a.json"),
    "JSON, columns of two lengths": js({**COLUMNS, "y": list(Y[:-1])}, refused("y")),
    "JSON, a key twice": log('[{"t": 0, "u": 1, "t": 2, "y": 3}]', refused("'t'"), "a.json"),
    "JSON, byte order mark": log("\ufeff" + json.dumps(SAMPLES), file="a.json"),
    "JSON, UTF-16": log(json.dumps(SAMPLES).encode("utf-16"), SAFE, "a.json"),
    "JSON, single quotes": log(json.dumps(SAMPLES).replace('"', "'"), refused("not a readable JSON"), "a.json"),
    "JSON, a comma too many": log(json.dumps(SAMPLES)[:-1] + ",]", refused("not a readable JSON"), "a.json"),
    "JSON, cut": log(json.dumps(SAMPLES)[:200], refused("not a readable JSON", "cut"), "a.json"),
    "JSON, nothing": log("{}", refused("no samples"), "a.json"),
    "JSON, a sampling time of nonsense": js({"Ts": {"a": []}, "u": list(U), "y": list(Y)}, refused("--ts")),
    "JSON, a sampling time of true": js({"Ts": True, "u": list(U), "y": list(Y)}, refused("--ts")),
    "JSON, a sampling time": js({"Ts": 0.1, "u": list(U), "y": list(Y)}),
    "JSON, 20,000 brackets": log("[" * 10_000 + "]" * 9_990, refused("not a readable JSON"), "a.json"),
    "JSON lines": log(LINES, file="a.jsonl"),
    "JSON lines called json": log(LINES, file="a.json"),
    "JSON lines called ndjson": log(LINES, file="a.ndjson"),
    "JSON lines with blank ones between": log(LINES.replace("\n", "\n\n"), file="a.jsonl"),
    "JSON lines, a head before them": log('{"rig": 7, "Ts": 0.1}\n' + LINES, file="a.jsonl"),
    "JSON lines, CR LF": log(LINES.replace("\n", "\r\n"), file="a.jsonl"),
    "JSON lines, the last is cut": log(LINES[:-8], Right(U[:-1], Y[:-1]), file="a.jsonl"),
    "JSON lines, one in the middle is cut": log(LINES.replace('"y": 2.0}', '"y": '), refused("row 6"), file="a.jsonl"),
    "JSON lines, columns in another order": log(
        "".join(json.dumps(dict(reversed(s.items())) if k % 2 else s) + "\n" for k, s in enumerate(SAMPLES)),
        file="a.jsonl",
    ),
    "JSON lines, one has one more": log(LINES.replace('"y": 2.0}', '"y": 2.0, "note": "kick"}'), file="a.jsonl"),
    # what a microcontroller printed
    "printed lines": log(printed(), COUNTS, "a.log"),
    "printed lines called txt": log(printed(), COUNTS, "a.txt"),
    "printed lines without a start": log(
        "\r\n".join(PRINTED) + "\r\n", COUNTS, "a.log", time="1", input="2", output="3", time_unit="ms"
    ),
    "a printed line lost its end": log(printed(row12="1090,"), without(9), "a.log"),
    "a printed line lost a digit of the clock": log(printed(row12="109,40,525"), without(9), "a.log"),
    "a printed line with binary noise": log(printed(row12="10\ufffd90,,5").encode(), without(9), "a.log"),
    "two printed lines run together": log(printed(row12="1090,40,5251100,-40,527"), without(9), "a.log"),
    "printed lines gain a number": log(
        printed() + "".join(f"{1300 + 10 * k},0,512,1\r\n" for k in range(20)), refused("row 33", "form"), "a.log"
    ),
    "printed lines lose a number, called txt": log(
        "ms,pwm,adc\n" + "".join(f"{700 + 10 * k},0,512,1\n" for k in range(20)) + "\n".join(PRINTED) + "\n",
        refused("row 2", "4 cells"),
        "a.txt",
    ),
    "the sensor of printed pairs comes off": log(
        "".join(f"ms:{1000 + 10 * k} u:{k % 5} y:{k if k < 20 else '---'}\n" for k in range(30)),
        refused("row 21", "tenth"),
        "a.log",
    ),
    "words of a board around printed lines": log(
        "".join(f"load:0x3fff{k:04x},len:{k}\r\n" for k in range(30)) + printed() + "halted\r\nPC: 0x40\r\nbye\r\n",
        COUNTS,
        "a.log",
    ),
    "a message between printed lines": log(printed(row12="1090,40,525\r\nbrown-out detected"), COUNTS, "a.log"),
    "every fourth printed line is garbled": log(
        printed(**{f"row{k}": "?\x07,," for k in range(4, 32, 4)}), refused("tenth"), "a.log"
    ),
    "printed pairs": log(
        "".join(f"t={line.split(',')[0]} u={line.split(',')[1]} y={line.split(',')[2]}\n" for line in PRINTED),
        refused("--time-unit"),
        "a.log",
    ),
    "printed pairs with colons": log(
        "".join(f"ms:{line.split(',')[0]},u:{line.split(',')[1]},y:{line.split(',')[2]}\n" for line in PRINTED),
        COUNTS,
        "a.log",
    ),
    "printed blanks": log(printed().replace(",", " "), COUNTS, "a.log"),
    "printed semicolons": log(printed().replace(",", ";"), COUNTS, "a.log"),
    "a printed table without a clock": log("u,y\n" + PAIRS, SAFE, "a.log", Ts=TS),
    "printed messages alone": log("boot\nready\n", refused("no line has numbers"), "a.log"),
    "a table called log": log("t,u,y\n" + ROWS, file="a.log"),
    "a table called log with an empty cell": log("t,u,y\n" + with_row(6, "0.5,2,"), BRIDGED, "a.log"),
    "a table called log with a thousands mark": log(
        "t;u;y\n" + with_row(6, "0.5;2,000;2", ROWS.replace(",", ";")), BRIDGED, "a.log"
    ),
}
