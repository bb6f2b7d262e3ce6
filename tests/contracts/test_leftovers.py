"""What a killed process leaves goes with the next one, what is in use stays, and no worker outlives its parent."""

import os
import signal
import subprocess
import sys
import time

import pytest

from sysid.base import locks
from sysid.base.files import Lines, atomic_file

pytestmark = pytest.mark.skipif(os.name != "posix", reason="sends signals")

MARK = "from sysid.base import locks; print(locks.mark(), flush=True); import time; time.sleep({seconds})"
HALF = """
import os, signal, sys
from pathlib import Path
from sysid.base.files import atomic_file
with atomic_file(Path(sys.argv[1])) as file:
    file.write_text("half")
    os.kill(os.getpid(), signal.SIGKILL)
"""


def mark_of_the_gone():
    return subprocess.run([sys.executable, "-c", MARK.format(seconds=0)], capture_output=True, text=True).stdout.strip()


def test_what_a_killed_writer_left_goes_with_the_next_file_in_that_place(tmp_path, monkeypatch):
    done = subprocess.run([sys.executable, "-c", HALF, str(tmp_path / "a.json")], check=False)
    assert done.returncode == -signal.SIGKILL
    assert len(list(tmp_path.iterdir())) == 1
    monkeypatch.setattr(locks, "_swept", set())
    with atomic_file(tmp_path / "b.json") as file:
        file.write_text("whole")
    assert [path.name for path in tmp_path.iterdir()] == ["b.json"]


def test_only_what_belongs_to_a_process_that_is_gone_is_swept(tmp_path):
    gone = mark_of_the_gone()
    with subprocess.Popen([sys.executable, "-c", MARK.format(seconds=60)], stdout=subprocess.PIPE, text=True) as other:
        assert other.stdout is not None
        used = other.stdout.readline().strip()
        machine, process, began, number = used.split("-")[1:]
        elsewhere = f"qpal-{int(machine, 16) ^ 1:08x}-{gone.split('-', 2)[2]}"
        again = f"qpal-{machine}-{process}-{int(began) - 1}-{number}"  # a former process of the same number
        mine = locks.mark()
        (tmp_path / f".a.{gone}.part").mkdir()
        (tmp_path / f".a.{gone}.part" / "file").touch()
        stay = [f".a.{used}.part", f".a.{mine}.part", f".a.{elsewhere}.part", f".a.{gone}.ready", "a.part", "qpal-1"]
        for name in [f".b.{gone}.csv", f".b.{again}.csv", *stay]:
            (tmp_path / name).touch()
        locks.sweep(tmp_path)
        assert {path.name for path in tmp_path.iterdir()} == set(stay)
        other.kill()
        other.wait()
    locks.sweep(tmp_path)
    assert {path.name for path in tmp_path.iterdir()} == set(stay[1:])


def test_a_process_that_has_ended_but_is_not_yet_collected_is_gone():
    with subprocess.Popen([sys.executable, "-c", MARK.format(seconds=60)], stdout=subprocess.PIPE, text=True) as other:
        assert other.stdout is not None
        name = other.stdout.readline().strip()
        assert locks.is_in_use(name)
        other.kill()
        for _ in range(100):
            if not locks.is_in_use(name):
                break
            time.sleep(0.05)
        assert locks.is_in_use(name) is (not os.path.exists("/proc/self/stat"))


def test_a_link_among_leftovers_leads_nowhere_else(tmp_path):
    (tmp_path / "kept").mkdir()
    (tmp_path / "kept" / "file").touch()
    (tmp_path / f"{mark_of_the_gone()}").symlink_to(tmp_path / "kept")
    locks.sweep(tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == ["kept"]
    assert (tmp_path / "kept" / "file").exists()


def test_scratch_folders_of_killed_runs_go(tmp_path, monkeypatch):
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    monkeypatch.setattr(locks, "_swept", set())
    (tmp_path / mark_of_the_gone()).mkdir()
    with locks.scratch_folder() as folder:
        assert [path.name for path in tmp_path.iterdir()] == [folder.name]
        assert folder.stat().st_mode & 0o777 == 0o700
    assert not list(tmp_path.iterdir())


def test_a_file_keeps_the_mode_of_the_user(tmp_path):
    before = os.umask(0o027)
    try:
        with atomic_file(tmp_path / "a.json") as file:
            file.write_text("x")
    finally:
        os.umask(before)
    assert (tmp_path / "a.json").stat().st_mode & 0o777 == 0o640


APPENDS = """
import sys
from pathlib import Path
from sysid.base.files import Lines
for k in range(60):
    Lines(Path(sys.argv[1])).append(sys.argv[2] + " " + str(k))
"""


def test_two_writers_of_one_journal_lose_no_line(tmp_path):
    """Each mends the file before its first line, which must not take a line that the other has just written."""
    runs = [subprocess.Popen([sys.executable, "-c", APPENDS, str(tmp_path / "j"), name]) for name in "ab"]
    assert [run.wait() for run in runs] == [0, 0]
    assert sorted(Lines(tmp_path / "j").read()) == sorted(f"{name} {k}" for name in "ab" for k in range(60))


POOL = """
import os, sys, time
from sysid.base.parallel import results
def job(k):
    with open(sys.argv[1], "a") as file:
        file.write(f"{os.getpid()}\\n")
    time.sleep(60)
if __name__ == "__main__":
    list(results(job, [1, 2], 2))
"""


def alive(process):
    try:
        with open(f"/proc/{process}/stat") as file:
            return file.read().rpartition(")")[2].split()[0] not in "ZX"
    except FileNotFoundError:
        return False


@pytest.mark.skipif(not os.path.exists("/proc/self/stat"), reason="looks into /proc")
@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGINT])
def test_workers_end_with_the_process_that_started_them(number, tmp_path):
    script, said = tmp_path / "script.py", tmp_path / "said"
    script.write_text(POOL.replace("sys.argv[1]", repr(str(said))))
    run = subprocess.Popen([sys.executable, script], stderr=subprocess.PIPE, text=True, start_new_session=True)
    for _ in range(600):
        workers = said.read_text().split() if said.exists() else []
        if len(workers) == 2:
            break
        time.sleep(0.1)
    assert len(workers) == 2
    assert all(alive(worker) for worker in workers)
    if number == signal.SIGINT:
        os.killpg(run.pid, number)  # as a terminal does
    else:
        run.kill()
    _, err = run.communicate(timeout=60)
    for _ in range(80):
        if not any(alive(worker) for worker in workers):
            break
        time.sleep(0.1)
    assert not any(alive(worker) for worker in workers)
    assert err.count("Traceback") <= (number == signal.SIGINT), err  # the script's own; none of a worker


ORPHAN = """
import os, sys, time
from sysid.base.parallel import end_with
end_with({parent})
print("watched", flush=True)
time.sleep(60)
"""


@pytest.mark.skipif(not os.path.exists("/proc/self/stat"), reason="looks into /proc")
def test_a_worker_whose_parent_was_gone_before_it_began_ends_too():
    gone = int(mark_of_the_gone().split("-")[2])
    began = time.monotonic()
    done = subprocess.run([sys.executable, "-c", ORPHAN.format(parent=gone)], capture_output=True, timeout=50)
    assert done.returncode == 1
    assert time.monotonic() - began < 45.0


@pytest.mark.skipif(not os.path.exists("/proc/self/stat"), reason="looks into /proc")
def test_a_worker_that_another_process_started_for_its_parent_goes_on():
    """As a server of forks does."""
    between = "import subprocess, sys; subprocess.run([sys.executable, '-c', sys.argv[1]])"
    worker = ORPHAN.format(parent=os.getpid()).replace("60", "1.5") + "print('went on')"
    with subprocess.Popen(
        [sys.executable, "-c", between, worker],
        stdout=subprocess.PIPE,
        text=True,
    ) as process:
        assert process.communicate(timeout=50)[0] == "watched\nwent on\n"


@pytest.fixture
def machine(tmp_path, monkeypatch):
    """Tells which mark a machine has that is described by these texts."""

    def mark(**said):
        for name in ("MACHINE", "SERIAL", "BOOT"):
            path = tmp_path / name
            path.unlink(missing_ok=True)
            if name.lower() in said:
                path.write_text(said[name.lower()] + "\n")
            monkeypatch.setattr(locks, name, str(path))
        link = tmp_path / "pid"
        link.unlink(missing_ok=True)
        link.symlink_to(said.get("within", locks.OUTSIDE))
        monkeypatch.setattr(locks, "PROCESSES", str(link))
        return locks._machine.__wrapped__()

    return mark


def test_machines_of_one_name_are_told_apart_and_one_that_started_again_is_the_same(machine):
    first = machine(machine="a1", boot="b1")
    assert machine(machine="a1", boot="b2") == first, "after it started again"
    assert machine(machine="a2", boot="b1") != first
    assert machine(machine="a1", serial="c2", boot="b1") != first, "a copied card in another board"
    assert machine(boot="b1") != machine(boot="b2"), "without an id nothing else tells two machines apart"


def test_containers_of_one_image_on_two_machines_are_told_apart(machine):
    """Name, id and number within the kernel may all be the same."""
    own = machine(machine="image", boot="b1", within="pid:[4026532201]")
    assert machine(machine="image", boot="b1", within="pid:[4026532201]") == own
    assert machine(machine="image", boot="b2", within="pid:[4026532201]") != own
    assert machine(machine="image", boot="b1", within="pid:[4026532202]") != own
