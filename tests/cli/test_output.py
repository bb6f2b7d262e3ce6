"""Every run has a folder of its own, also among runs that begin in the same second."""

import json
import subprocess
import sys
from datetime import datetime
from pathlib import Path

import pytest

from sysid.base.errors import InputError
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
