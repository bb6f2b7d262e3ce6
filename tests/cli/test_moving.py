"""Outputs stand whole or not at all: a place that is taken, two runs at once, a kill, a request to stop."""

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from sysid.base.errors import InputError
from twin.cli import main, results
from twin.cli.output import output_folder, run_folder

posix = pytest.mark.skipif(os.name != "posix", reason="sends signals")


def tree(folder):
    return {str(path.relative_to(folder)): path.read_text() for path in folder.rglob("*") if path.is_file()}


def write(folder, text):
    (folder / "figures").mkdir(exist_ok=True)
    for name in ("a.json", "figures/b.png", "z.html"):
        (folder / name).write_text(text)


@pytest.mark.parametrize("taken", ["z.html", "figures"])
def test_a_place_that_is_taken_is_refused_before_anything_has_moved(taken, tmp_path):
    out = tmp_path / "out"
    out.mkdir()
    (out / "a.json").write_text("former")
    (out / taken).mkdir() if taken == "z.html" else (out / taken).touch()
    before = tree(out)
    with pytest.raises(InputError, match=f"cannot write to .*{taken}"), output_folder(out) as scratch:
        write(scratch, "new")
    assert tree(out) == before
    assert [path.name for path in tmp_path.iterdir()] == ["out"]


def test_a_failure_while_files_are_replaced_brings_the_former_ones_back(tmp_path, monkeypatch):
    out = tmp_path / "out"
    out.mkdir()
    write(out, "former")
    (out / "figures" / "b.png").unlink()
    (out / "figures").rmdir()
    before, replace = tree(out), os.replace

    def fails(source, target):
        if Path(target).name == "z.html":
            raise OSError(28, "No space left on device")
        replace(source, target)

    monkeypatch.setattr(os, "replace", fails)
    with pytest.raises(InputError, match="No space left"), output_folder(out) as scratch:
        write(scratch, "new")
    assert tree(out) == before
    assert not (out / "figures").exists()
    assert [path.name for path in tmp_path.iterdir()] == ["out"]


def test_files_of_a_former_run_are_replaced_and_others_stay(tmp_path):
    out = tmp_path / "out"
    out.mkdir()
    write(out, "former")
    (out / "notes.txt").write_text("mine")
    with output_folder(out) as scratch:
        write(scratch, "new")
    assert tree(out) == {"a.json": "new", "figures/b.png": "new", "z.html": "new", "notes.txt": "mine"}


def test_a_second_run_into_the_same_folder_is_refused_while_the_first_works(tmp_path):
    with output_folder(tmp_path / "out") as scratch:
        write(scratch, "first")
        with pytest.raises(InputError, match=r"another run .* is writing to"), output_folder(tmp_path / "out"):
            pass
        with output_folder(tmp_path / "out-2"):  # another folder, whatever its name begins with
            pass
    assert set(tree(tmp_path / "out").values()) == {"first"}
    with output_folder(tmp_path / "out") as scratch:
        write(scratch, "second")
    assert set(tree(tmp_path / "out").values()) == {"second"}


KILLED = """
import os, signal, sys
from pathlib import Path
from twin.cli import output
{patch}
with output.run_folder({out!r}, "info") as (folder, scratch):
    for name in "abc":
        (scratch / name).write_text("new")
    {inside}
"""
IN_THE_MIDDLE = """
replace = os.replace
def once(source, target):
    replace(source, target)
    os.kill(os.getpid(), signal.SIGKILL)
os.replace = once
"""
NOW = "os.kill(os.getpid(), signal.SIGKILL)"


def killed(folder, out, patch="", inside="pass"):
    code = KILLED.format(out=out, patch=patch, inside=inside)
    assert subprocess.run([sys.executable, "-c", code], cwd=folder).returncode == -signal.SIGKILL


@posix
@pytest.mark.parametrize("out", [None, "out"])
def test_what_a_killed_run_leaves_goes_with_the_next_one_there(out, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    killed(tmp_path, out, inside=NOW)
    assert list(tmp_path.rglob(".*.part"))
    with run_folder(out, "info") as (folder, _):
        pass
    left = [path for path in tmp_path.rglob("*") if path != tmp_path / "runs"]
    assert left == [tmp_path / folder]


@posix
def test_a_move_that_a_kill_cut_short_is_finished_by_the_next_run_there(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("out").mkdir()
    for name in "abc":
        Path("out", name).write_text("former")
    killed(tmp_path, "out", patch=IN_THE_MIDDLE)
    assert sorted(tree(tmp_path / "out").values()) == ["former", "former", "new"]
    with output_folder(Path("other")):
        pass
    assert tree(tmp_path / "out") == dict.fromkeys("abc", "new")
    assert sorted(os.listdir()) == ["other", "out"]


LATE = """
import os, signal, sys
from twin.cli import app, main, options, results
from twin.cli.output import run_folder
place = results._place_all
def interrupted(*where):
    os.kill(os.getpid(), signal.{number})
    place(*where)
results._place_all = interrupted
def late(out: options.Out = None) -> None:
    "Is stopped while its results move."
    with run_folder(out, "late") as (folder, scratch):
        for name in "abc":
            (scratch / name).write_text("new")
    print("not reached")
app.VERBS = (*app.VERBS, late)
sys.argv[1:] = ["late", "--out", "out"]
sys.exit(main())
"""


@posix
@pytest.mark.parametrize("number", ["SIGINT", "SIGTERM"])
def test_a_stop_while_results_move_comes_after_and_says_where_they_are(number, tmp_path):
    (tmp_path / "out").mkdir()
    done = subprocess.run(
        [sys.executable, "-c", LATE.format(number=number)], cwd=tmp_path, capture_output=True, text=True
    )
    assert (done.returncode, done.stderr) == (130, "qpal: stopped; its results are whole, in out\n")
    assert tree(tmp_path / "out") == dict.fromkeys("abc", "new")
    assert os.listdir(tmp_path) == ["out"]


WRAPS = """
import os, signal, sys
from twin.cli import app, main
def wraps() -> None:
    "A library makes an error of its own of the interrupt."
    try:
        os.kill(os.getpid(), signal.SIGTERM)
        import time; time.sleep(10)
    except KeyboardInterrupt as error:
        raise ImportError("half loaded") from error
app.VERBS = (*app.VERBS, wraps)
sys.argv[1:] = ["wraps"]
sys.exit(main())
"""
EARLY = """
import os, signal, sys
from twin.cli import main
class Late:
    def find_spec(self, name, *more):
        if name == "typer":
            try:
                os.kill(os.getpid(), signal.{number})
                sum(range(100))
            except KeyboardInterrupt:
                pass  # lost within a library
sys.meta_path.insert(0, Late())
sys.argv[1:] = ["info"]
sys.exit(main())
"""


@posix
@pytest.mark.parametrize("code", [WRAPS, EARLY.format(number="SIGINT"), EARLY.format(number="SIGTERM")])
def test_a_stop_that_a_library_swallows_or_renames_is_a_stop(code, tmp_path):
    done = subprocess.run([sys.executable, "-c", code], cwd=tmp_path, capture_output=True, text=True, timeout=60)
    assert (done.returncode, done.stderr) == (130, "qpal: stopped; nothing was written\n")
    assert not list(tmp_path.iterdir())


def test_what_was_written_is_told_of_this_run_alone(capsys):
    results.note_result("elsewhere")
    assert main(["--version"]) == 0
    assert results.outcome() == "nothing was written"
