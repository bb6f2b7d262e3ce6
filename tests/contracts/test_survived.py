"""Files of other programs: whatever their reader does, the process goes on and says one sentence."""

import os
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import bad_readers
import numpy as np
import pytest
from foreign import FOREIGN
from mat_bytes import level_5, opaque, vector

from sysid.base.errors import InputError
from sysid.formats import FOREIGN as KINDS
from sysid.formats import TABLE, _sandbox, read_table

U, Y = np.sin(np.arange(30.0)), np.cos(np.arange(30.0))
LINUX = pytest.mark.skipif(sys.platform != "linux", reason="forks and limits of memory are those of Linux")


@pytest.fixture(params=["forked", "started"])
def way(request, monkeypatch):
    """One process that forks, or one for each file."""
    if request.param == "forked" and sys.platform != "linux":
        pytest.skip("no fork here")
    monkeypatch.setattr(_sandbox, "FORKS", request.param == "forked")


@pytest.fixture
def path(tmp_path):
    (tmp_path / "a.bin").write_text("SIGSEGV")
    return tmp_path / "a.bin"


def refused(path: Path, reader: type) -> str:
    with pytest.raises(InputError) as error:
        _sandbox.read(path, reader)
    said = str(error.value)
    assert said.startswith(str(path))
    assert "\n" not in said
    return said.removeprefix(str(path))


@pytest.mark.usefixtures("way")
def test_what_a_reader_found_comes_back_whole(path):
    table, header = _sandbox.read(path, bad_readers.Good)
    assert header == "head"
    assert table.path == path
    assert table.names == ("u",)
    assert table.columns[0].tolist() == [0.0, 1.0, 2.0]
    assert list(table.rows[0]) == [1, 2, 3]
    assert (table.notes, table.units, table.meta, table.place) == (("as read",), {"u": "V"}, {"k": 1}, "row")
    table.columns[0][0] = 5.0  # the caller's own


READ_SO = [name for name in FOREIGN if TABLE[Path(name).suffix] in KINDS]


@pytest.mark.parametrize(("name", "forks"), [*((name, True) for name in READ_SO), ("vectors.mat", False)])
def test_the_same_table_as_in_one_process(name, forks, tmp_path, monkeypatch):
    monkeypatch.setattr(_sandbox, "FORKS", forks and _sandbox.FORKS)
    FOREIGN[name](tmp_path / name, U, Y)
    monkeypatch.chdir(tmp_path)
    found, right = read_table(name), TABLE[Path(name).suffix]().read(Path(name))
    assert found.names == right.names
    for a, b in zip(found.columns, right.columns, strict=True):
        assert a.dtype == np.asarray(b).dtype
        assert a.tobytes() == np.asarray(b).tobytes()
    for field in ("path", "place", "units", "notes", "meta"):
        assert getattr(found, field) == getattr(right, field)
    assert [list(rows) for rows in found.rows] == [list(rows) for rows in right.rows]


@pytest.mark.usefixtures("way")
def test_a_reader_that_ends_on_a_signal_is_a_sentence_and_the_next_file_is_read(path):
    said = refused(path, bad_readers.Crashes)
    if sys.platform != "win32":
        assert "SIGSEGV" in said
    assert re.search("damaged.*write it again", said)
    assert _sandbox.read(path, bad_readers.Good)[1] == "head"


@LINUX
@pytest.mark.parametrize(
    ("reader", "words"),
    [
        (bad_readers.Panics, "PanicError"),
        (bad_readers.Leaves, "exit status 3"),
        (bad_readers.Refuses, " is refused"),
    ],
)
def test_every_other_end_is_a_sentence(reader, words, path):
    assert words in refused(path, reader)


@LINUX
@pytest.mark.parametrize("name", ["SIGBUS", "SIGABRT", "SIGFPE", "SIGILL", "SIGTERM"])
def test_every_signal_has_its_name(name, path):
    path.write_text(name)
    assert name in refused(path, bad_readers.Crashes)


@LINUX
def test_a_reader_that_the_system_ended_is_no_damaged_file(path):
    path.write_text("SIGKILL")
    assert "memory runs out" in refused(path, bad_readers.Crashes)


@LINUX
@pytest.mark.parametrize("reader", [bad_readers.Loops, bad_readers.Waits])
def test_a_reader_without_end_is_ended(reader, path, monkeypatch):
    monkeypatch.setattr(_sandbox, "SECONDS", 1.0)
    monkeypatch.setattr(_sandbox, "WAIT", 0.0)
    began = time.monotonic()
    assert "not read within 1 s" in refused(path, reader)
    assert time.monotonic() - began < 30.0


@LINUX
def test_a_reader_that_takes_all_memory_is_refused_it(path, monkeypatch):
    monkeypatch.setattr(_sandbox, "BYTES", 1 << 30)
    monkeypatch.setattr(_sandbox, "BYTES_PER_CORE", 0)
    assert "more than 1 GiB of memory" in refused(path, bad_readers.Takes)


def test_names_in_a_damaged_file_neither_break_nor_flood_the_sentence(path):
    path.write_text("a\0b\nc\x1b[31m" + "x" * 100_000)
    said = refused(path, bad_readers.Babbles)
    assert said.isprintable()
    assert len(said) < 2100
    assert said.startswith(r" has a\x00b\nc\x1b[31mxxx")
    assert said.endswith("; save it again")


def test_an_error_of_the_system_keeps_its_number(path):
    with pytest.raises(PermissionError, match="Permission denied"):
        _sandbox.read(path, bad_readers.Denied)


@pytest.mark.parametrize(("place", "byte"), [(225, 127), (225, 255), (256, 0), (256, 22)])
def test_a_byte_of_a_matlab_object_on_which_the_reader_of_scipy_ends(place, byte, tmp_path):
    """It follows lengths inside of an object beyond the end of the file; other versions of it may not."""
    raw = bytearray(level_5(opaque(b"tout"), vector(b"u", U[:4])))
    (tmp_path / "sound.mat").write_bytes(raw)
    assert read_table(tmp_path / "sound.mat").numbers("u").tolist() == U[:4].tolist()
    raw[place] = byte
    (tmp_path / "a.mat").write_bytes(raw)
    try:
        found = read_table(tmp_path / "a.mat").numbers("u").tolist()
    except InputError as error:
        found = re.findall("not a readable MAT file|is damaged: its reader ended on it", str(error))
    assert found
    assert found == U[:4].tolist() or isinstance(found[0], str)


PARENT = """
import os, signal, sys
from pathlib import Path
import bad_readers
from sysid.formats import _sandbox
_sandbox._server = _sandbox._Server()
print(_sandbox._server.process.pid, flush=True)
_sandbox.read(Path(sys.argv[1]), bad_readers.Loops)
"""


@LINUX
@pytest.mark.parametrize("how", [signal.SIGINT, signal.SIGTERM, signal.SIGKILL])
def test_no_process_outlives_the_one_that_reads(how, path):
    env = {**os.environ, "PYTHONPATH": os.pathsep.join(each for each in sys.path if each)}
    parent = subprocess.Popen(
        [sys.executable, "-c", PARENT, str(path)], stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, env=env
    )
    server = int(parent.stdout.readline())
    until(lambda: len(members(server)) == 2)  # the server, and the process that loops
    parent.send_signal(how)
    parent.communicate(timeout=30)
    until(lambda: not members(server))


def members(group: int) -> list[int]:
    """Living processes of a group."""
    found = []
    for stat in Path("/proc").glob("[0-9]*/stat"):
        try:
            name, _, rest = stat.read_text().rpartition(")")
        except OSError:
            continue
        state, _, its_group = rest.split()[:3]
        if int(its_group) == group and state != "Z":
            found.append(int(name.partition(" ")[0]))
    return found


def until(true, seconds: float = 30.0) -> None:
    end = time.monotonic() + seconds
    while not true():
        assert time.monotonic() < end
        time.sleep(0.05)


AFTER_FORK = """
import os, sys
from pathlib import Path
import bad_readers
from sysid.formats import _sandbox
path = Path(sys.argv[1])
first = _sandbox.read(path, bad_readers.Good)[1]
child = os.fork()
if child == 0:
    os._exit(0 if _sandbox.read(path, bad_readers.Good)[1] == first else 1)
print(os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]), _sandbox.read(path, bad_readers.Good)[1])
"""


@LINUX
def test_a_forked_process_asks_one_of_its_own(path):
    env = {**os.environ, "PYTHONPATH": os.pathsep.join(each for each in sys.path if each)}
    done = subprocess.run(
        [sys.executable, "-W", "error", "-c", AFTER_FORK, str(path)],
        env=env,
        capture_output=True,
        text=True,
        timeout=60,
    )
    assert (done.stdout.split(), done.stderr) == (["0", "head"], "")
