"""Corrupt logs by name: a file, its content, and what the sentence holds or which numbers are right."""

import io
import json
import pickle
import re
import zipfile
from pathlib import Path

import numpy as np
import polars
import scipy.io
from mat_bytes import level_5, opaque, vector

N = 60
T = np.arange(N) / 100
U = np.round(np.sin(0.7 * np.arange(N)) * 5, 3)
Y = np.round(np.cos(0.3 * np.arange(N)) * 90, 3)
WHOLE = {"t": T, "u": U, "y": Y}


def lines(mark: str = ",", header: str | None = "t,u,y", **rows: str) -> list[str]:
    """A good table as lines; `row17=...` is row 17 of the file instead, where the header is row 1."""
    found = [] if header is None else [header.replace(",", mark)]
    found += [mark.join(f"{value:.3f}" for value in row) for row in zip(T, U, Y, strict=True)]
    for name, text in rows.items():
        found[int(name.removeprefix("row")) - 1] = text
    return found


def text(mark: str = ",", header: str | None = "t,u,y", end: str = "\n", **rows: str) -> bytes:
    return (end.join(lines(mark, header, **rows)) + end).encode()


def capture(**rows: str) -> bytes:
    """What a microcontroller prints: milliseconds, ADC counts, PWM; 100 lines below a start-up line and the names."""
    found = ["boot ok", "ms,adc,pwm", *(f"{1000 + 10 * k},{512 + k},{-80 - k % 3}" for k in range(100))]
    for name, content in rows.items():
        found[int(name.removeprefix("row")) - 1] = content
    return ("\r\n".join(found) + "\r\n").encode("latin-1")


CAPTURED = {
    "ms": 1000.0 + 10 * np.arange(100),
    "adc": 512.0 + np.arange(100),
    "pwm": -80.0 - np.arange(100) % 3,
}


def without(columns: dict[str, np.ndarray], *places: int) -> dict[str, np.ndarray]:
    return {name: np.delete(values, places) for name, values in columns.items()}


def saved(write, *arguments, **options) -> bytes:
    file = io.BytesIO()
    write(file, *arguments, **options)
    return file.getvalue()


def mat(**variables) -> bytes:
    return saved(scipy.io.savemat, variables)


def npz(**arrays) -> bytes:
    return saved(np.savez, **arrays)


def zipped(**members: bytes) -> bytes:
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w") as archive:
        for name, content in members.items():
            archive.writestr(name, content)
    return file.getvalue()


def parquet(**columns) -> bytes:
    return saved(lambda file: polars.DataFrame(columns).write_parquet(file))


def samples(**replaced) -> list:
    found: list = [{"t": t, "u": u, "y": y} for t, u, y in zip(T.tolist(), U.tolist(), Y.tolist(), strict=True)]
    for name, entry in replaced.items():
        found[int(name.removeprefix("entry")) - 1] = entry
    return found


def js(value) -> bytes:
    return json.dumps(value).encode()


class Runs:
    """Pickled, it would make a file when loaded."""

    def __reduce__(self):
        return (Path("run-by-pickle").touch, ())


Refused = list[str]  # what the sentence holds
Kept = tuple[dict[str, np.ndarray], list[str]]  # the right numbers, and what the notes hold

NO_NUMBER = "not a number"
CASES: dict[str, tuple[str, bytes, Refused | Kept]] = {
    # text tables
    "empty": ("a.csv", b"", ["is empty"]),
    "blank lines": ("a.csv", b"\n \n\t\n", ["no rows"]),
    "comments alone": ("a.csv", b"# a\n% b\n", ["no rows"]),
    "byte order mark alone": ("a.csv", b"\xef\xbb\xbf", ["no rows"]),
    "header alone": ("a.csv", b"t,u,y\n", ["header and no rows"]),
    "header cut": ("a.csv", b"t,u", ["header and no rows"]),
    "header and units alone": ("a.csv", b"t,u\ns,V\n", ["no whole row"]),
    "text in numbers": ("a.csv", text(row17="0.15,abc,1"), ["row 17, column 'u'", "'abc'", NO_NUMBER]),
    "text in the first row, no header": ("a.csv", b"x,0.5\n1,2\n3,4\n", ["row 1, column '1'", "'x'", NO_NUMBER]),
    "empty cell": ("a.csv", text(row17="0.15,,1"), ["row 17, column 'u'", "empty cell", "fill it"]),
    "cell of blanks": ("a.csv", text(row17="0.15,   ,1"), ["row 17, column 'u'", "empty cell"]),
    "nan": ("a.csv", text(row17="0.15,NaN,1"), ["row 17, column 'u'", "NaN"]),
    "inf": ("a.csv", text(row17="0.15,1,-inf"), ["row 17, column 'y'", "infinite"]),
    "overflow": ("a.csv", text(row17="0.15,1e999,1"), ["row 17, column 'u'", "infinite"]),
    "huge": ("a.csv", text(row17="0.15,1e200,1"), ["row 17, column 'u'", "1e100"]),
    "underscore": ("a.csv", text(row17="0.15,1_000,1"), ["row 17, column 'u'", "'1_000'", NO_NUMBER]),
    "hexadecimal": ("a.csv", text(row17="0.15,0x1F,1"), ["row 17, column 'u'", "'0x1F'", NO_NUMBER]),
    "two points": ("a.csv", text(row17="0.15,1.2.3,1"), ["row 17, column 'u'", "'1.2.3'", NO_NUMBER]),
    "two numbers in a cell": ("a.csv", text(row17="0.15,1 2,1"), ["row 17, column 'u'", "'1 2'", NO_NUMBER]),
    "unit in a cell": ("a.csv", text(row17="0.15,1 V,1"), ["row 17, column 'u'", "'1 V'", "a number with its unit"]),
    "letter O": ("a.csv", text(row17="0.15,1O,1"), ["row 17, column 'u'", "'1O'", NO_NUMBER]),
    "minus of a typesetter": ("a.csv", text(row17="0.15,\u22121,1"), ({"u": np.where(T == 0.15, -1.0, U)}, [])),
    "row too short": ("a.csv", text(row17="0.15,1"), ["row 17", "2 cells", "row 1 has 3"]),
    "row too long": ("a.csv", text(row17="0.15,1,2,3"), ["row 17", "4 cells", "row 1 has 3"]),
    "one short, one long": ("a.csv", text(row17="0.15,1", row18="0.16,1,2,3"), ["row 17", "2 cells"]),
    "short row below a comment": ("a.csv", text(row5="# said", row17="1,2"), ["row 17", "2 cells"]),
    "short row below blank lines": ("a.csv", text(row5="", row6="  ", row17="1,2"), ["row 17", "2 cells"]),
    "names too few": ("a.csv", text(header="t,u"), ["row 2", "3 cells", "row 1 has 2"]),
    "two tables": ("a.csv", text() + b"a,b\n1,2\n", ["row 62", "2 cells"]),
    "other mark in a row": ("a.csv", text(row17="0.15;1;2"), ["row 17", "1 cell ", "row 1 has 3"]),
    "other mark in the header": ("a.csv", text(header="t;u;y"), ["row 2", "3 cells", "row 1 has 1"]),
    "quote never closed": ("a.csv", text(row17='0.15,"1,2'), ["row 17", "split", "quotes"]),
    "quote never closed in the header": ("a.csv", text(header='t,"u,y'), ["row 1", "quotes"]),
    "quoted line break": ("a.csv", text(row17='0.15,"1\n2",3'), ["row 17", "quotes"]),
    "zero bytes": ("a.csv", text(row17="0.15,1,\0\0"), ["not a text file", "row 17"]),
    "zero bytes at the end": ("a.csv", text() + b"\0" * 512, ["not a text file", "row 62"]),
    "binary noise": ("a.csv", bytes(range(256)) * 8, ["not a text file", "suffix"]),
    "noise in the middle": ("a.csv", text()[:500] + b"\x00\xff\x13" + text()[500:], ["not a text file", "row 2"]),
    "parquet called csv": ("a.csv", parquet(**WHOLE), ["not a text file", "suffix"]),
    "zip called csv": ("a.csv", zipped(a=b"1"), ["not a text file", "suffix"]),
    "UTF-16 cut in a character": ("a.csv", text().decode().encode("utf-16")[:-1], ["row 61", "half a character"]),
    "half a pair of UTF-16": ("a.csv", "t,u\n1,2\n\U0001f600".encode("utf-16")[:-2], ["row 3", "half a character"]),
    "UTF-16 without its mark": ("a.csv", text().decode().encode("utf-16-le"), ["not a text file"]),
    "point and comma": (
        "a.csv",
        text(";", row17="0,15;1;2"),
        ["row 2", "'0.000'", "row 17", "'0,15'", "point"],
    ),
    "comma that may part thousands": ("a.tsv", b"a\tb\n1,500\t2\n12,250\t3\n", ["row 2", "'1,500'", "thousands"]),
    "thousands": ("a.csv", text(";", row17="1;1,234,567;2"), ["row 17, column 'u'", "'1,234,567'", NO_NUMBER]),
    "decimal commas between commas": ("a.csv", b"u,y\n1,5,2,5\n1,6,2,6\n", ["row 2", "4 cells", "row 1 has 2"]),
    # text tables that are repaired, or right as they are
    "last row cut in a cell": ("a.csv", text()[:-2], (without(WHOLE, N - 1), ["row 61", "cut off"])),
    "last row cut at a mark": ("a.csv", text()[:-7], (without(WHOLE, N - 1), ["row 61", "cut off"])),
    "last row cut in the first cell": ("a.csv", text()[:-15], (without(WHOLE, N - 1), ["row 61", "cut off"])),
    "last row short, decimals vary": (
        "a.csv",
        b"u,y\n1,2.5\n1,2.25\n1",
        ({"y": np.array([2.5, 2.25])}, ["row 4", "cut"]),
    ),
    "byte order mark": ("a.csv", b"\xef\xbb\xbf" + text(), (WHOLE, [])),
    "no line end": ("a.csv", text()[:-1], (WHOLE, [])),
    "no line end, whole numbers": (
        "a.csv",
        b"u,y\n1,20\n2,30\n3,41",
        ({"y": np.array([20.0, 30, 41])}, ["row 4", "last"]),
    ),
    "CR alone": ("a.csv", text(end="\r"), (WHOLE, [])),
    "CR LF": ("a.csv", text(end="\r\n"), (WHOLE, [])),
    "UTF-16": ("a.csv", text().decode().encode("utf-16"), (WHOLE, [])),
    "latin-1": ("a.csv", text(header="t,u,y").replace(b"y", b"\xb0", 1), ({"t": T, "u": U, "\u00b0": Y}, [])),
    "blank lines between": ("a.csv", text(end="\n\n"), (WHOLE, [])),
    "separators at the end": ("a.csv", text(end=",\n"), (WHOLE, [])),
    "separators at the end of some": ("a.csv", text(row17="0.150,-4.447,-18.971,,"), ({"t": T}, [])),
    "everything quoted": ("a.csv", re.sub(rb"[^,\n]+", rb'"\g<0>"', text()), (WHOLE, [])),
    "blanks around": ("a.csv", text(" ,  "), ({"t": T, "u": U, "y": Y}, [])),
    "table called txt": ("a.txt", text("\t"), (WHOLE, [])),
    "table called log": ("a.log", text(), (WHOLE, [])),
    "decimal commas": ("a.csv", text(";").replace(b".", b","), (WHOLE, ["decimal marks"])),
    "numbers that no float64 holds": (
        "a.csv",
        b"a\n0.1000000000000000055511151231257827\n123456789012345678901234567890\n",
        ({"a": np.array([0.1, 123456789012345678901234567890.0])}, []),
    ),
    # captures
    "garbled lines": (
        "a.log",
        capture(row10="10\xff0,5", row20="1180,5301190,531,-81", row30="127,-82", row31="12?0,541,-82"),
        (without(CAPTURED, 7, 17, 27, 28), ["4 garbled lines (rows 10, 20, 30, 31)"]),
    ),
    "digit lost in the clock": (
        "a.log",
        capture(row50="147,559,-82", row60="15700,569,-81"),
        (without(CAPTURED, 47, 57), ["2 lines (rows 50, 60) whose 'ms'"]),
    ),
    "digit changed in the clock": (
        "a.log",
        capture(row50="1520,559,-82", row60="1520,569,-81"),
        (without(CAPTURED, 47, 57), ["2 lines (rows 50, 60) whose 'ms'"]),
    ),
    "decimal lost": (
        "a.log",
        b"t,u\n" + b"".join(b"%d,%d.25\n" % (k, k % 5) for k in range(150)) + b"150,1.2\n151,1.25\n",
        ({"t": np.delete(np.arange(152.0), 150)}, ["1 garbled line (row 152)"]),
    ),
    "two wrong clocks in a row": (
        "a.log",
        capture(row50="147,559,-82", row51="148,560,-80"),
        (without(CAPTURED, 47, 48), ["2 lines (rows 50, 51)"]),
    ),
    "digit lost in a value": (
        "a.log",
        capture(row50="1470,59,-82"),
        (without(CAPTURED, 47), ["1 line (row 50) with a number"]),
    ),
    "capture starts in a line": (
        "a.log",
        b"\r\n".join(capture().split(b"\r\n")[2:])[2:],
        ({"1": CAPTURED["ms"][1:], "2": CAPTURED["adc"][1:]}, ["1 line (row 1) whose '1'"]),
    ),
    "capture ends in a line": ("a.log", capture()[:-3], (without(CAPTURED, 99), ["row 102, the last"])),
    "capture called txt": ("a.txt", capture(row20="1180,530"), (without(CAPTURED, 17), ["1 garbled line (row 20)"])),
    "capture with noise called txt": ("a.txt", capture(row20="\x01\x02"), (without(CAPTURED, 17), ["row 20"])),
    "clock that starts again": (
        "a.log",
        capture(**{f"row{k + 3}": f"{10 * k - 490},{512 + k},{-80 - k % 3}" for k in range(50, 100)}),
        ({**CAPTURED, "ms": np.r_[1000.0 + 10 * np.arange(50), 10.0 + 10 * np.arange(50)]}, []),
    ),
    "garbled by a wrong baud rate": (
        "a.log",
        capture(**{f"row{k}": "\x8f\x13?,\xfe" for k in range(5, 95, 3)}),
        ["row 5", "30 of 100", "tenth", "baud rate"],
    ),
    "messages alone": ("a.log", b"started\nstopped\n", ["no line has numbers alone", "one sample a line"]),
    "noise called log": ("a.log", bytes(range(128, 256)) * 20, ["not a capture"]),
    # JSON
    "JSON cut": ("a.json", js(samples())[:700], ["row 1", "not a readable JSON", "cut"]),
    "JSON of another kind": ("a.json", b"'t': 1", ["row 1", "not a readable JSON"]),
    "JSON of one number": ("a.json", b"7", ["holds 7", "list of samples"]),
    "JSON of nothing": ("a.json", b"[]", ["no samples"]),
    "JSON of texts": ("a.json", js(["a", "b"]), ["no samples with numbers"]),
    "JSON nested too deep": ("a.json", b"[" * 100_000, ["not a readable JSON"]),
    "JSON nested garbage": ("a.json", js({"a": {"b": [{"c": [{"d": {}}]}]}}), ["no samples with numbers"]),
    "key missing": ("a.json", js(samples(entry17={"t": 0.16})), ["entry 17, column 'u'", "NaN"]),
    "null": ("a.json", js(samples(entry17={"t": 0.16, "u": None, "y": 1})), ["entry 17, column 'u'", "NaN"]),
    "text for a number": ("a.json", js(samples(entry17={"t": 0, "u": "x", "y": 1})), ["entry 17, column 'u'", "'x'"]),
    "a list among objects": ("a.json", js(samples(entry17=[1, 2, 3])), ["entry 17", "a list", "an object"]),
    "a number among objects": ("a.json", js(samples(entry17=5)), ["entry 17", "found 5", "an object"]),
    "rows of two lengths": ("a.json", js([[1, 2], [3, 4], [5]]), ["entry 3", "1 values", "entry 1 has 2"]),
    "key twice": ("a.json", b'[{"t": 1, "u": 2, "t": 3}]', ["'t'", "rename"]),
    "whole number too large": ("a.json", b'{"a": [1, 1' + b"0" * 400 + b"]}", ["entry 2, column 'a'", "infinite"]),
    "whole number far too large": ("a.json", b'{"a": [1, 1' + b"0" * 5000 + b"]}", ["not a readable JSON"]),
    "NaN in JSON": ("a.json", b'{"a": [1, NaN, 3]}', ["entry 2, column 'a'", "NaN"]),
    "latin-1 in JSON": ("a.json", b'{"\xb0": [1, 2]}', ["not a readable JSON"]),
    "JSON line broken": ("a.jsonl", b'{"a": 1}\n{"a": \n{"a": 3}\n', ["row 2", "not a readable JSON"]),
    "JSON line cut": ("a.jsonl", b'{"a": 1}\n{"a": 2}\n{"a": 3', ({"a": np.array([1.0, 2.0])}, ["row 3", "cut"])),
    "JSON lines called json": ("a.json", b'{"a": 1}\n{"a": 2}\n', ({"a": np.array([1.0, 2.0])}, [])),
    "numbers as texts": ("a.json", js({"a": ["1", "2.5"]}), ["no samples with numbers"]),
    # NumPy
    "zip that is no npz": ("a.npz", zipped(**{"a.txt": b"1 2 3"}), ["no numeric vector"]),
    "npz cut": ("a.npz", npz(**WHOLE)[:900], ["not a readable npz", "cut"]),
    "npz with a changed byte": ("a.npz", npz(t=T).replace(T[5].tobytes(), T[6].tobytes(), 1), ["not a readable npz"]),
    "npz of pickled objects": ("a.npz", npz(u=np.array([Runs()], dtype=object)), ["pickled", "np.savez"]),
    "pickle called npy": ("a.npy", pickle.dumps([Runs()]), ["pickled", "np.savez"]),
    "npy cut": ("a.npy", saved(np.save, T)[:-5], ["not a readable npy", "cut"]),
    "npy called npz": ("a.npz", saved(np.save, T), ["not a readable npz", "rename"]),
    "npz called npy": ("a.npy", npz(t=T), ["not a readable npy", "rename"]),
    "npz of one number": ("a.npz", npz(u=3.0), ["no numeric vector", "u (numeric 1)"]),
    "NaN in npz": ("a.npz", npz(u=np.array([1.0, np.nan, 3.0])), ["element 2, column 'u'", "NaN"]),
    # MATLAB
    "MAT cut": ("a.mat", mat(**WHOLE)[:800], ["not a readable MAT"]),
    "MAT cut in the header": ("a.mat", mat(**WHOLE)[:100], ["not a readable MAT"]),
    "MAT of noise": ("a.mat", b"MATLAB 5.0 MAT-file" + bytes(range(256)) * 4, ["not a readable MAT"]),
    "MAT 7.3 cut": ("a.mat", b"MATLAB 7.3 MAT-file".ljust(124) + b"\0\2IM" + b"\x89HDF\r\n\x1a\n".ljust(512), ["7.3"]),
    "MAT of a timeseries": ("a.mat", level_5(opaque(b"log")), ["log (timeseries object)", "log.Time", "log.Data"]),
    "MAT of a timeseries and vectors": (
        "a.mat",
        level_5(opaque(b"log"), vector(b"u", U)),
        ({"u": U}, ["log (timeseries object)", "log.Time"]),
    ),
    "MAT with an imaginary part that is not there": (
        "a.mat",
        level_5(vector(b"u", U, bits=0x08), vector(b"y", Y)),
        ["not a readable MAT"],
    ),
    "MAT with fewer numbers than its size": ("a.mat", level_5(vector(b"u", U, rows=600)), ["not a readable MAT"]),
    "MAT variable twice": ("a.mat", level_5(vector(b"u", U), vector(b"u", Y)), ["not a readable MAT"]),
    "MAT of complex numbers": ("a.mat", mat(z=U + 1j * Y), ["no numeric vector", "z (complex 1x60)"]),
    "NaN in MAT": ("a.mat", mat(u=np.array([1.0, np.nan])), ["element 2, column 'u'", "NaN"]),
    # Parquet
    "parquet cut": ("a.parquet", parquet(**WHOLE)[:-20], ["not a readable Parquet"]),
    "parquet without its end": ("a.parquet", parquet(**WHOLE)[:100], ["not a readable Parquet"]),
    "parquet of texts": ("a.parquet", parquet(a=["x", "y"]), ["no numeric column", "a"]),
    "parquet of nothing": ("a.parquet", parquet(a=polars.Series([], dtype=polars.Float64)), ["no rows"]),
    "empty cell in parquet": ("a.parquet", parquet(u=[1.0, None, 3.0]), ["row 2, column 'u'", "NaN"]),
    "csv called json": ("a.json", text(), ["not a readable JSON"]),
    # robots
    "noise called mcap": ("a.mcap", bytes(range(256)), ["not a readable robot log", "record it again"]),
}
