"""Every kind of bad input ends in exit code 2 and one sentence with the place and the remedy, and leaves nothing."""

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import scipy.io

from sysid.formats import TABLE
from twin.cli import main

GOOD = [(np.sin(0.7 * k) + np.sign(np.sin(0.1 * k)), np.cos(0.3 * k)) for k in range(200)]


def csv(header: str = "u,y", rows: list | None = None, **replaced: str) -> str:
    """A table of good rows; `row17="a,b"` replaces row 17 of the file (row 1 is the header)."""
    lines = [header] if header else []
    lines += [f"{u:.6f},{y:.6f}" for u, y in (GOOD if rows is None else rows)]
    for row, text in replaced.items():
        lines[int(row.removeprefix("row")) - 1] = text
    return "\n".join(lines) + "\n"


def timed(times: list[float]) -> str:
    return csv("t,u,y", rows=[]) + "".join(f"{t:.6f},{u:.5f},{y:.5f}\n" for t, (u, y) in zip(times, GOOD, strict=False))


steps = [0.1 * k for k in range(200)]
FILES: dict[str, str | bytes] = {
    "good.csv": csv(),
    "empty.csv": "",
    "blank.csv": "\n\n",
    "header.csv": "u,y\n",
    "text.csv": csv(row17="abc,1.0"),
    "nan.csv": csv(row17="nan,1.0"),
    "cell.csv": csv(row17=",1.0"),
    "inf.csv": csv(row17="1.0,inf"),
    "huge.csv": csv(row17="1e300,1.0"),
    "ragged.csv": csv(row17="1.0"),
    "twice.csv": csv(header="u,u"),
    "constant_u.csv": csv(rows=[(1.5, y) for _, y in GOOD]),
    "constant_y.csv": csv(rows=[(u, 2.5) for u, _ in GOOD]),
    "still_start.csv": csv(rows=[(1.5 if k < 100 else u, y) for k, (u, y) in enumerate(GOOD)]),
    "still_end.csv": csv(rows=[(u, y if k < 100 else 0.5) for k, (u, y) in enumerate(GOOD)]),
    "short.csv": csv(rows=GOOD[:30]),
    "one.csv": csv(rows=GOOD[:1]),
    "gap.csv": timed([*steps[:50], *(t + 0.1 for t in steps[50:])]),
    "back.csv": timed([*steps[:50], 1.0, *steps[51:]]),
    "time.csv": timed(steps),
    "binary.csv": bytes(range(256)) * 4,
    "corrupt.mat": b"MATLAB 5.0 MAT-file" + bytes(range(256)) * 4,
    "junk.parquet": b"PAR1 nothing of the kind PAR1",
    "table.xlsx": "u,y\n1,2\n",
}
TIMED = ["--input", "u", "--output", "y", "--time", "t"]

CASES: dict[str, tuple[list[str], list[str]]] = {
    "missing file": (["nowhere.csv", "--ts", "1"], ["nowhere.csv", "does not exist", "check"]),
    "folder": ([".", "--ts", "1"], ["folder", "give one file"]),
    "suffix": (["table.xlsx", "--ts", "1"], ["table.xlsx", "'.xlsx'", ".csv", ".mat"]),
    "empty file": (["empty.csv", "--ts", "1"], ["empty.csv", "is empty"]),
    "blank file": (["blank.csv", "--ts", "1"], ["blank.csv", "no rows"]),
    "header alone": (["header.csv", "--ts", "1"], ["header.csv", "no rows"]),
    "binary": (["binary.csv", "--ts", "1"], ["binary.csv", "not a text file"]),
    "corrupt mat": (["corrupt.mat", "--ts", "1"], ["corrupt.mat", "not a readable MAT file"]),
    "junk parquet": (["junk.parquet", "--ts", "1"], ["junk.parquet", "not a readable Parquet file"]),
    "mat 7.3": (["new.mat", "--ts", "1"], ["new.mat", "7.3", "-v7"]),
    "mat without vectors": (["struct.mat", "--ts", "1"], ["struct.mat", "no numeric vector", "s (struct 1x1)"]),
    "mat of two lengths": (
        ["lengths.mat", "--ts", "1", "--input", "u", "--output", "y"],
        ["lengths.mat", "'u' has 50", "'y' has 60"],
    ),
    "unknown column": (["good.csv", "--ts", "1", "--input", "v", "--output", "y"], ["good.csv", "'v'", "u, y"]),
    "one column named": (["time.csv", "--ts", "1", "--input", "y"], ["time.csv", "t, u, y", "--output"]),
    "same column": (["good.csv", "--ts", "1", "--input", "u", "--output", "u"], ["'u'", "two columns"]),
    "text": (["text.csv", "--ts", "1"], ["text.csv, row 17, column 'u'", "'abc'", "not a number"]),
    "nan": (["nan.csv", "--ts", "1"], ["nan.csv, row 17, column 'u'", "NaN"]),
    "empty cell": (["cell.csv", "--ts", "1"], ["cell.csv, row 17, column 'u'", "empty cell"]),
    "infinite": (["inf.csv", "--ts", "1"], ["inf.csv, row 17, column 'y'", "infinite"]),
    "huge": (["huge.csv", "--ts", "1"], ["huge.csv, row 17, column 'u'", "1e100", "unit"]),
    "ragged": (["ragged.csv", "--ts", "1"], ["ragged.csv, row 17", "1 cell ", "row 1 has 2"]),
    "name twice": (["twice.csv", "--ts", "1"], ["twice.csv", "'u', 'u 2'", "--input"]),
    "constant input": (["constant_u.csv", "--ts", "1"], ["constant_u.csv", "input 'u' is 1.5", "200 samples"]),
    "constant output": (["constant_y.csv", "--ts", "1"], ["constant_y.csv", "output 'y' is 2.5", "200 samples"]),
    "still while fitted": (["still_start.csv", "--ts", "1", "--split", "0.5"], ["still_start.csv", "one of the two"]),
    "still while scored": (["still_end.csv", "--ts", "1"], ["still_end.csv", "output", "validation part"]),
    "too short": (["short.csv", "--ts", "1"], ["short.csv", "too few", "give --structure process"]),
    "one row": (["one.csv", "--ts", "1"], ["one.csv", "at least 2"]),
    "gap in time": (["gap.csv", *TIMED], ["gap.csv, row 52, column 't'", "0.2 s", "0.1 s", "1%"]),
    "time runs back": (["back.csv", *TIMED], ["back.csv, row 52, column 't'", "1 s after 4.9 s", "increase"]),
    "unknown time": (["good.csv", "--time", "t"], ["good.csv", "'t'", "u, y"]),
    "no sampling time": (["good.csv"], ["good.csv", "--ts", "--time"]),
    "ts and time differ": (["time.csv", *TIMED, "--ts", "0.2"], ["time.csv", "0.2 s", "0.1 s", "leave one"]),
    "ts zero": (["good.csv", "--ts", "0"], ["--ts is 0", "positive"]),
    "ts infinite": (["good.csv", "--ts", "inf"], ["--ts is inf", "positive"]),
    "ts text": (["good.csv", "--ts", "fast"], ["'--ts'", "'fast'", "give a number"]),
    "starts text": (["good.csv", "--starts", "2.5"], ["'--starts'", "'2.5'", "give a whole number"]),
    "structure": (["good.csv", "--ts", "1", "--structure", "nn"], ["structure 'nn'", "hammerstein_wiener"]),
    "input map": (["good.csv", "--ts", "1", "--input-map", "x"], ["input map 'x'", "saturation"]),
    "output map": (["good.csv", "--ts", "1", "--output-map", "x"], ["output map 'x'", "saturation"]),
    "map without a place": (
        ["good.csv", "--ts", "1", "--structure", "output_error", "--input-map", "saturation"],
        ["output_error", "no input map"],
    ),
    "search": (["good.csv", "--ts", "1", "--search", "luck"], ["search 'luck'", "lm"]),
    "detrend": (["good.csv", "--ts", "1", "--detrend", "all"], ["detrend 'all'", "mean", "none"]),
    "orders length": (
        ["good.csv", "--ts", "1", "--orders", "2,3"],
        ["'2,3'", "2 part(s)", "nk (delay in samples)", "2,3,1"],
    ),
    "orders text": (["good.csv", "--ts", "1", "--orders", "a,b,c"], ["'a,b,c'", "whole numbers"]),
    "orders fraction": (["good.csv", "--ts", "1", "--orders", "1.5,2,1"], ["'1.5,2,1'", "whole numbers"]),
    "orders negative": (["good.csv", "--ts", "1", "--orders", "2,-1,1"], ["'2,-1,1'", "nf -1", "from 0"]),
    "orders nb zero": (["good.csv", "--ts", "1", "--orders", "0,3,1"], ["'0,3,1'", "nb 0", "from 1"]),
    "orders huge": (["good.csv", "--ts", "1", "--orders", "2,3000,1"], ["nf 3000", "to 100"]),
    "orders of nlarx": (
        ["good.csv", "--ts", "1", "--structure", "nlarx", "--orders", "2,0,1"],
        ["'2,0,1'", "nb 0", "from 1"],
    ),
    "input map of nlarx": (
        ["good.csv", "--ts", "1", "--structure", "nlarx", "--input-map", "saturation"],
        ["nlarx", "no input map", "leave it out"],
    ),
    "focus": (["good.csv", "--ts", "1", "--structure", "nlarx", "--focus", "x"], ["focus 'x'", "simulation"]),
    "focus of a chain": (["good.csv", "--ts", "1", "--focus", "simulation"], ["--focus", "nlarx"]),
    "auto with orders": (["good.csv", "--ts", "1", "--structure", "auto", "--orders", "2,3,1"], ["--orders", "auto"]),
    "auto with a map": (
        ["good.csv", "--ts", "1", "--structure", "auto", "--output-map", "saturation"],
        ["--output-map", "auto", "leave it out"],
    ),
    "auto with a search": (["good.csv", "--ts", "1", "--structure", "auto", "--search", "x"], ["search 'x'", "lm"]),
    "joint with orders": (
        ["good.csv", "--ts", "1", "--structure", "actuated_joint", "--orders", "2,3,1"],
        ["--orders", "actuated_joint", "leave it out"],
    ),
    "joint without its zero": (
        ["good.csv", "--ts", "1", "--structure", "actuated_joint", "--detrend", "mean"],
        ["detrend is 'mean'", "actuated_joint", "leave it out or give none"],
    ),
    "driver of a joint": (
        ["good.csv", "--ts", "1", "--structure", "actuated_joint", "--input-map", "x"],
        ["driver map 'x'", "dead_zone_saturation"],
    ),
    "resume without auto": (["good.csv", "--ts", "1", "--resume", "j"], ["--resume", "auto"]),
    "resume from no journal": (
        ["good.csv", "--ts", "1", "--structure", "auto", "--resume", "text.csv"],
        ["text.csv", "not a journal", "path"],
    ),
    "split": (["good.csv", "--ts", "1", "--split", "1.5"], ["split is 1.5", "between 0 and 1"]),
    "split zero": (["good.csv", "--ts", "1", "--split", "0"], ["split is 0", "between 0 and 1"]),
    "starts": (["good.csv", "--ts", "1", "--starts", "0"], ["starts is 0", "at least 1"]),
    "seed": (["good.csv", "--ts", "1", "--seed", "-1"], ["--seed is -1", "of at least 0"]),
    "option": (["good.csv", "--tss", "1"], ["--tss", "--help"]),
    "no file": ([], ["FILE", "--help"]),
}
SIMULATE: dict[str, tuple[list[str], list[str]]] = {
    "joint": (["--joint", "knee"], ["joint 'knee'", "shoulder, thigh, shank"]),
    "excitation": (["--excitation", "noise"], ["excitation 'noise'", "sweep"]),
    "imperfection": (["--without", "friction,rust"], ["'rust'", "backlash"]),
    "duration": (["--duration", "-5"], ["duration", "-5", "positive"]),
    "duration nan": (["--duration", "nan"], ["duration", "nan", "positive"]),
    "too short": (["--duration", "0.1"], ["duration 0.1", "at least"]),
    "ts": (["--ts", "0"], ["Ts", "positive"]),
    "ts off the step": (["--ts", "0.0123456"], ["Ts is 0.0123456", "milliseconds"]),
    "seed": (["--seed", "-3"], ["--seed is -3", "of at least 0"]),
    "log suffix": (["--duration", "2", "--log", "log.xyz"], ["log.xyz", ".csv", ".mat"]),
    "log folder": (["--duration", "2", "--log", "nowhere/log.csv"], ["nowhere/log.csv", "no folder"]),
    "log is a folder": (["--duration", "2", "--log", "taken.csv"], ["taken.csv", "folder"]),
}


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """A working folder with every bad file in it; nothing else may appear there."""
    for name, content in FILES.items():
        (tmp_path / name).write_bytes(content if isinstance(content, bytes) else content.encode())
    (tmp_path / "taken.csv").mkdir()
    head = b"MATLAB 7.3 MAT-file".ljust(124) + bytes([0, 2]) + b"IM"  # version 2 in the header is 7.3
    (tmp_path / "new.mat").write_bytes(head + b"\x89HDF\r\n\x1a\n".ljust(512, b"\0"))
    scipy.io.savemat(tmp_path / "struct.mat", {"s": {"a": 1.0}})
    scipy.io.savemat(tmp_path / "lengths.mat", {"u": np.arange(50.0), "y": np.arange(60.0)})
    monkeypatch.chdir(tmp_path)
    return tmp_path


def expect(arguments: list[str], fragments: list[str], folder: Path, capsys) -> None:
    before = sorted(folder.rglob("*"))
    code = main(arguments)
    out, err = capsys.readouterr()
    assert code == 2, err
    assert out == ""
    assert err.endswith("\n")
    assert err.count("\n") == 1, f"more than one line: {err}"
    for fragment in fragments:
        assert fragment in err
    assert sorted(folder.rglob("*")) == before


@pytest.mark.parametrize(("arguments", "fragments"), CASES.values(), ids=CASES)
def test_identify(arguments, fragments, folder, capsys):
    expect(["identify", *arguments], fragments, folder, capsys)


@pytest.mark.parametrize("suffix", TABLE)
def test_a_file_that_is_not_what_its_suffix_says(suffix, folder, capsys):
    (folder / f"junk{suffix}").write_bytes(b"PK" + bytes(range(256)) * 4)
    expect(["identify", f"junk{suffix}", "--ts", "1"], [f"junk{suffix}", "not a ", "; "], folder, capsys)


@pytest.mark.parametrize(("arguments", "fragments"), SIMULATE.values(), ids=SIMULATE)
def test_simulate(arguments, fragments, folder, capsys):
    expect(["simulate", *arguments], fragments, folder, capsys)


@pytest.mark.parametrize("value", ["-1", "0", "nan", "inf", "10"])
def test_reproduce_duration(value, folder, capsys):
    expect(["reproduce", "--duration", value], ["--duration", "at least 60 s"], folder, capsys)


def test_unknown_verb(folder, capsys):
    expect(["improve"], ["improve"], folder, capsys)


@pytest.mark.parametrize("out", ["good.csv", "good.csv/below", "/proc/nowhere/out"])
def test_out_that_cannot_be_written(out, folder, capsys):
    expect(["identify", "good.csv", "--ts", "1", "--out", out], ["cannot write", out, "give a place"], folder, capsys)


def test_the_process_itself_ends_with_2_and_no_traceback(folder):
    done = subprocess.run(
        [sys.executable, "-m", "twin.cli", "identify", "text.csv", "--ts", "1"],
        capture_output=True,
        text=True,
        env={**os.environ, "COLUMNS": "40"},  # a narrow terminal does not break the sentence
        check=False,
    )
    assert done.returncode == 2
    assert done.stdout == ""
    assert len(done.stderr.splitlines()) == 1
