"""Every run has a folder of its own, also among runs that begin in the same second."""

import errno
import json
import os
import shutil
import subprocess
import sys
from datetime import datetime
from pathlib import Path

import pytest

from sysid.base import files
from sysid.base.errors import InputError
from sysid.base.files import Lines
from twin.cli import main, output
from twin.cli.output import run_folder

NOW = datetime(2026, 1, 2, 3, 4, 5)
# Waits until all of the processes are ready, so that they choose their folders at one moment; all see one clock.
RUN = """
import sys, time
from datetime import datetime
from pathlib import Path
from twin.cli import output

class Clock(datetime):
    @classmethod
    def now(cls, tz=None):
        return cls(2026, 1, 2, 3, 4, 5)

output.datetime = Clock
me, count = sys.argv[1], int(sys.argv[2])
Path(f"ready-{me}").touch()
while len(list(Path().glob("ready-*"))) < count:
    pass
for k in range(20):
    with output.run_folder(None, "identify") as (folder, scratch):
        (scratch / "summary.json").write_text(f"{me} {k}")
        (scratch / f"{me}-{k}").touch()
    assert (folder / "summary.json").read_text() == f"{me} {k}", folder
    print(folder.name)
"""


@pytest.fixture
def clock(monkeypatch):
    class Clock(datetime):
        @classmethod
        def now(cls, tz=None):
            return NOW

    monkeypatch.setattr(output, "datetime", Clock)


def test_simultaneous_processes_share_no_folder(tmp_path):
    count = 4
    runs = [
        subprocess.Popen(
            [sys.executable, "-c", RUN, str(k), str(count)],
            cwd=tmp_path,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )
        for k in range(count)
    ]
    said = [run.communicate(timeout=120) for run in runs]
    assert [run.returncode for run in runs] == [0] * count, said
    names = [name for out, _ in said for name in out.split()]
    assert len(set(names)) == len(names) == 20 * count
    for folder in (tmp_path / "runs").iterdir():
        assert len(list(folder.iterdir())) == 2  # one run's files: its summary and its mark
    assert {path.name for path in (tmp_path / "runs").iterdir()} == set(names)


def test_verbs_of_one_second_keep_both_results(tmp_path, monkeypatch, clock, capsys):
    monkeypatch.chdir(tmp_path)
    for joint in ("thigh", "shank"):
        assert main(["simulate", "--joint", joint, "--duration", "20"]) == 0
    capsys.readouterr()
    names = ["20260102-030405-simulate", "20260102-030405-simulate-2"]
    assert sorted(path.name for path in Path("runs").iterdir()) == names
    joints = [json.loads(Path("runs", name, "summary.json").read_text())["joint"] for name in names]
    assert joints == ["thigh", "shank"]
    assert all(Path("runs", name, "log.csv").is_file() for name in names)


def test_the_name_is_taken_before_the_work_begins(tmp_path, monkeypatch, clock):
    monkeypatch.chdir(tmp_path)
    with run_folder(None, "info") as (first, _):
        assert first.is_dir()
        with run_folder(None, "info") as (second, _):
            assert second != first


def test_a_run_that_fails_leaves_nothing_of_its_own(tmp_path, monkeypatch, clock):
    monkeypatch.chdir(tmp_path)

    def fails() -> None:
        with run_folder(None, "info") as (_, scratch):
            (scratch / "half").touch()
            raise InputError("no")

    with pytest.raises(InputError):
        fails()
    assert list(tmp_path.iterdir()) == []
    with run_folder(None, "info") as (other, _), pytest.raises(InputError):
        fails()
    assert list(tmp_path.iterdir()) == [tmp_path / "runs"]
    assert [path.name for path in (tmp_path / "runs").iterdir()] == [other.name]


def test_runs_that_is_a_file_is_a_sentence(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "runs").touch()
    with pytest.raises(InputError, match="cannot write to runs"), run_folder(None, "info"):
        pass


@pytest.mark.parametrize("out", [".", "../here"])
def test_the_current_folder_can_be_written_to(out, tmp_path, monkeypatch):
    (tmp_path / "here").mkdir()
    monkeypatch.chdir(tmp_path / "here")
    with run_folder(out, "info") as (_, scratch):
        (scratch / "summary.json").touch()
    assert [path.name for path in (tmp_path / "here").iterdir()] == ["summary.json"]
    assert [path.name for path in tmp_path.iterdir()] == ["here"]


def test_files_that_no_run_had_made_are_named_when_they_are_replaced(tmp_path, monkeypatch, capsys):
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "summary.json").write_text('{"a": 1}')
    (tmp_path / "mine" / "notes.txt").write_text("kept")
    monkeypatch.chdir(tmp_path / "mine")

    def run(*names):
        with run_folder(".", "info") as (_, scratch):
            (scratch / "summary.json").write_text('{"versions": {"qpal": "1"}}')
            for name in names:
                (scratch / name).write_text("new")
        return capsys.readouterr().err

    assert run().endswith("mine: summary.json\n")
    assert run() == ""  # a former run made it
    Path("summary.json").write_text("[" * 100_000)
    said = run(*(f"{k}.png" for k in range(4)))
    assert "files of the same name were replaced in" in said
    Path("summary.json").unlink()
    assert run(*(f"{k}.png" for k in range(9))).endswith(": 0.png, 1.png, 2.png, 3.png\n")
    Path("summary.json").unlink()
    assert run(*(f"{k}.png" for k in range(9))).endswith(": 0.png, 1.png, 2.png, 3.png, 4.png and 4 more\n")
    assert Path("notes.txt").read_text() == "kept"


def test_a_link_to_a_folder_is_written_to_as_that_folder(tmp_path):
    """The scratch folder lies beside the folder itself: a link may lead to another disk."""
    (tmp_path / "real" / "out").mkdir(parents=True)
    (tmp_path / "link").symlink_to(tmp_path / "real" / "out")
    with run_folder(str(tmp_path / "link"), "info") as (folder, scratch):
        assert scratch.parent == tmp_path / "real"
        (scratch / "report.html").touch()
    assert folder == tmp_path / "link"
    assert [path.name for path in (tmp_path / "real" / "out").iterdir()] == ["report.html"]
    assert (tmp_path / "link").is_symlink()
    (tmp_path / "astray").symlink_to(tmp_path / "nowhere")
    with pytest.raises(InputError, match=r"cannot write to .*astray"), run_folder(str(tmp_path / "astray"), "info"):
        pass


@pytest.mark.parametrize(("why", "said"), [("denied", "cannot be written to"), ("mounted", "is on another disk")])
def test_a_folder_beside_which_nothing_can_be_made_is_refused_before_the_work(why, said, tmp_path, monkeypatch):
    """Root may write everywhere, and a test mounts nothing: what the system would say is put in its place."""
    place = tmp_path / "disk"
    place.mkdir()
    access, stat = output.os.access, Path.stat

    def device(path, **how):
        found = stat(path, **how)
        return os.stat_result([*found[:2], found[2] + (path == place), *found[3:]])

    if why == "denied":
        monkeypatch.setattr(output.os, "access", lambda path, mode: path != tmp_path and access(path, mode))
    else:
        monkeypatch.setattr(Path, "stat", device)
    told = pytest.raises(InputError, match=rf"{said}; give a new folder in it, for example .*results")
    with told, run_folder(str(place), "info"):
        pytest.fail("the work begins")
    with run_folder(str(place / "results"), "info") as (folder, scratch):
        (scratch / "report.html").touch()
    assert (folder / "report.html").is_file()
    assert [path.name for path in tmp_path.iterdir()] == ["disk"]


@pytest.mark.parametrize("out", ["~", "~/runs"])
def test_a_tilde_that_no_shell_has_replaced_makes_no_folder_of_that_name(out, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("HOME", "/home/me")
    assert main(["info", f"--out={out}"]) == 2
    said = capsys.readouterr().err
    assert f"--out is {out!r}, and the shell has not put your home folder in place of ~" in said
    assert f"give {out.replace('~', '/home/me')!r}, or ./~" in said
    assert list(tmp_path.iterdir()) == []
    (tmp_path / "~").mkdir()
    assert main(["info", "--out=~"]) == 0
    assert (tmp_path / "~" / "report.html").is_file()


@pytest.mark.parametrize("root", [Path.cwd().anchor, "//", "/.."])
def test_the_root_is_refused_before_the_work(root):
    with (
        pytest.raises(InputError, match=r"cannot write to .*the root.*give a new folder in it"),
        run_folder(root, "info"),
    ):
        raise AssertionError("the work began")


def test_what_leads_nowhere_is_told_and_makes_no_folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("dang").symlink_to("away")
    for out, said in (("dang", "it is a link to away, which does not exist"), ("x/../y", "there is no folder x, ")):
        with pytest.raises(InputError, match=f"cannot write to {out} .{said}"), run_folder(out, "info"):
            pytest.fail("it cannot begin")
    assert [path.name for path in tmp_path.iterdir()] == ["dang"]


def test_a_read_only_disk_is_told(tmp_path, monkeypatch):
    class Disk:
        f_flag = os.ST_RDONLY

    monkeypatch.setattr(output.os, "access", lambda place, how: False)
    for flag, said in ((os.ST_RDONLY, "read-only file system"), (0, "permission denied")):
        Disk.f_flag = flag
        monkeypatch.setattr(output.os, "statvfs", lambda place: Disk)
        with pytest.raises(InputError, match=rf"\({said}\)"), run_folder(str(tmp_path), "info"):
            pytest.fail("it cannot begin")
        with pytest.raises(InputError, match=rf"\({said}\)"):
            output.check_writable_file(tmp_path / "log.csv")


@pytest.mark.parametrize("number", [errno.ENOSPC, errno.EDQUOT, errno.EFBIG])
def test_a_full_disk_is_told_with_the_folder_and_leaves_nothing(number, tmp_path, monkeypatch):
    output.results.begin()  # a run; what those before it wrote is not its own
    monkeypatch.setattr(output.shutil, "disk_usage", lambda place: shutil._ntuple_diskusage(10**6, 10**6, 100))
    told = pytest.raises(InputError, match=rf"cannot write to .*out .*{os.strerror(number)}.*nothing was written")
    with told, run_folder(str(tmp_path / "out"), "info"):
        raise OSError(number, os.strerror(number))
    assert not list(tmp_path.iterdir())


def test_standard_output_that_is_full_is_not_taken_for_the_disk(tmp_path):
    with pytest.raises(OSError, match="No space"), run_folder(str(tmp_path / "out"), "info"):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))


def test_a_line_that_cannot_be_written_leaves_no_empty_file(tmp_path, monkeypatch):
    def full(number):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    lines, kept = Lines(tmp_path / "j.jsonl"), Lines(tmp_path / "kept.jsonl")
    kept.append("first")
    monkeypatch.setattr(files.os, "fsync", full)
    monkeypatch.setattr(Lines, "_complete_lines", lambda self: b"" if self is lines else b"first\n")
    for each in (lines, kept):
        with pytest.raises(OSError, match="No space"):
            each.append("a row")
    assert [path.name for path in tmp_path.iterdir()] == ["kept.jsonl"]
