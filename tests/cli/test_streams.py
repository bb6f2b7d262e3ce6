"""Standard streams as they come: a reader that goes away, few letters, a closed or a full one."""

import io
import os
import subprocess
import sys

import pytest

from twin.cli import environment

QPAL = [sys.executable, "-m", "twin.cli"]
SAYS = """
import sys
from typing import Annotated
import typer
from sysid.report.page import Grid
from twin.cli import app, console, main, options
from twin.cli.output import run_folder

def says(big: bool = False, out: options.Out = None) -> None:
    "Write and say."
    with run_folder(out, "says") as (folder, scratch):
        (scratch / "summary.json").touch()
    grid = Grid(["θ", "Größe"], [["σ²", "1 µm ± 2 °"]] * (3000 if big else 1))
    console.finish(folder, {}, False, [grid], ["β ≤ 1 — 日本"])
    raise typer.Exit(1)

app.VERBS = (*app.VERBS, says)
sys.argv[1:] = sys.argv[1:] or ["says", "--out", "out"]
sys.exit(main())
"""


def run(tmp_path, arguments=(), **more):
    more.setdefault("stdout", subprocess.PIPE)
    more.setdefault("stderr", subprocess.PIPE)
    return subprocess.run([sys.executable, "-c", SAYS, *arguments], cwd=tmp_path, timeout=100, **more)


@pytest.mark.parametrize("encoding", ["ascii", "latin-1", "utf-8"])
def test_a_stream_of_few_letters_gets_plain_ones(encoding, tmp_path):
    done = run(tmp_path, env={**os.environ, "PYTHONIOENCODING": encoding})
    assert (done.returncode, done.stderr) == (1, b"")
    said = done.stdout.decode(encoding)
    assert ("θ" in said, "日本" in said) == ((encoding == "utf-8"),) * 2
    assert "Größe" in said if encoding != "ascii" else "Grosse" in said or "Gro" in said
    if encoding == "ascii":
        assert "theta" in said
        assert "sigma^2" in said
        assert "1 um +/- 2 deg" in said
        assert "beta <= 1 - \\u65e5\\u672c" in said


@pytest.mark.skipif(os.name != "posix", reason="closes file numbers")
@pytest.mark.parametrize("big", [[], ["--big"]], ids=["at the end", "in a table"])
def test_a_reader_that_goes_away_is_no_failed_check(big, tmp_path):
    read, write = os.pipe()
    os.close(read)
    done = run(tmp_path, ["says", *big, "--out", "out"], stdout=write)
    os.close(write)
    assert done.stderr == b""
    assert done.returncode == 0
    assert (tmp_path / "out" / "summary.json").is_file()


@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="a device of Linux")
@pytest.mark.parametrize("big", [[], ["--big"]], ids=["at the end", "in a table"])
def test_a_full_disk_below_the_output_is_a_sentence_that_says_what_stands(big, tmp_path):
    with open("/dev/full", "w") as full:
        done = run(tmp_path, ["says", *big, "--out", "out"], stdout=full)
    said = b"qpal: output: No space left on device; its results are whole, in out\n"
    assert (done.returncode, done.stderr) == (2, said)


@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="a device of Linux")
def test_an_error_that_nobody_can_hear_keeps_its_code(tmp_path):
    with open("/dev/full", "w") as full:
        assert run(tmp_path, ["says", "--no-such"], stderr=full).returncode == 2


@pytest.mark.skipif(os.name != "posix", reason="closes file numbers")
def test_closed_streams_take_no_file_in_their_place(tmp_path):
    """The next file that opens would get the number 1, and all that is printed."""
    shut = "import os, sys\nfor k in (0, 1, 2): os.close(k)\nos.execv(sys.executable, [sys.executable, *sys.argv[1:]])"
    done = subprocess.run([sys.executable, "-c", shut, "-c", SAYS], cwd=tmp_path, timeout=100)
    assert done.returncode == 1
    assert (tmp_path / "out" / "summary.json").read_bytes() == b""


@pytest.mark.parametrize(
    ("text", "plain"),
    [
        ("─━│┃┌┼", "--||++"),
        ("ΔΩ", "DeltaOmega"),
        ("x⁻¹ é", "x^-^1 e"),
        ("a…b", "a...b"),
        ("→", "->"),
        ("plain", "plain"),
    ],
)
def test_letters_become_what_they_look_like_or_are_called(text, plain):
    assert environment.plain(text) == plain


def test_a_byte_of_a_file_name_that_is_no_text_is_shown_as_its_number(monkeypatch):
    below = io.BytesIO()
    monkeypatch.setattr(sys, "stdout", io.TextIOWrapper(below, encoding="utf-8"))
    with environment.streams():
        print(os.fsdecode(b"a\x9b.csv"), flush=True)  # to a terminal of one byte a letter it begins a command
    assert below.getvalue() == b"a\\udc9b.csv\n"
