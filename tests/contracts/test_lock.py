"""One process at a time, also where two users write to one folder. A second open file is a second process to a lock."""

import os
import shutil
import stat
import tempfile
from contextlib import contextmanager
from pathlib import Path

import pytest

from sysid.base.errors import InputError
from sysid.base.locks import file_lock
from sysid.bench.table import Table
from sysid.selection.journal import writing

pytest.importorskip("fcntl", reason="this system has no such locks")
OTHER = 65534
needs_root = pytest.mark.skipif(os.geteuid() != 0, reason="only root can be two users")


def taken(who):
    return f"{who} writes here"


@pytest.fixture
def shared():
    """A folder that every user may write to."""
    folder = Path(tempfile.mkdtemp(dir="/tmp"))
    folder.chmod(0o777)
    yield folder
    shutil.rmtree(folder)


@contextmanager
def another_user():
    os.setresuid(OTHER, OTHER, 0)
    try:
        yield
    finally:
        os.setresuid(0, 0, 0)


@pytest.fixture(params=[0o022, 0o077, 0o000], ids=oct)
def mask(request):
    """What the first user's shell lets new files be."""
    former = os.umask(request.param)
    yield request.param
    os.umask(former)


@needs_root
@pytest.mark.usefixtures("mask")
@pytest.mark.parametrize("mode", [0o777, 0o1777], ids=oct)
def test_another_user_is_refused_and_told_who_writes(mode, shared):
    shared.chmod(mode)
    refused = pytest.raises(InputError, match=rf"^process {os.getpid()} writes here$")
    for target in (shared, shared / "t.parquet"):
        with file_lock(target, taken), another_user(), refused, file_lock(target, taken):
            pytest.fail("two at once")
        with another_user(), file_lock(target, taken):  # the lock has gone with the first
            pass
        with another_user():
            (shared / "own").touch()


@needs_root
def test_a_benchmark_of_another_user_neither_adds_rows_nor_loses_any(shared):
    table = Table(shared / "t.parquet")
    with (
        table.writing(),
        another_user(),
        pytest.raises(InputError, match=r"another run writes to .*t\.parquet \(process \d+\)"),
        Table(table.path).writing(),
    ):
        pytest.fail("two at once")
    table._journal.append("{}")  # of a run that was killed; the other user may read it
    with (
        another_user(),
        pytest.raises(InputError, match=r"the journal .*t\.journal may not be written to.*--out"),
        Table(table.path).writing(),
    ):
        pytest.fail("its rows could not be kept")
    assert sorted(path.name for path in shared.iterdir()) == ["t.journal"]
    assert table.path.with_suffix(".journal").read_text() == "{}\n"


@needs_root
def test_a_journal_in_a_folder_of_another_user_is_refused(shared):
    """It could be written to, but no lock beside it can be made."""
    journal = shared / "j.jsonl"
    journal.touch()
    journal.chmod(0o666)
    shared.chmod(0o755)
    with (
        another_user(),
        pytest.raises(InputError, match=r"j\.jsonl .* no lock .*copy it to a folder"),
        writing(journal, None, {}),
    ):
        pytest.fail("two could write")


def test_a_lock_of_an_older_version_holds_without_writing_to_it(tmp_path):
    target = tmp_path / "t.parquet"
    with file_lock(target, taken):
        lock = tmp_path / ".t.parquet.lock"
        assert stat.S_IMODE(lock.stat().st_mode) == 0o666
        lock.chmod(0o444)
        with pytest.raises(InputError, match=rf"^process {os.getpid()} "), file_lock(target, taken):
            pytest.fail("two at once")
    assert not list(tmp_path.iterdir())


def test_a_lock_that_tells_nothing_refuses(tmp_path):
    target, other = tmp_path / "t.parquet", tmp_path / "other"
    other.write_text("kept")
    (tmp_path / ".t.parquet.lock").symlink_to(other)
    with (
        pytest.raises(InputError, match=r"\.t\.parquet\.lock cannot be opened \(it is a link\).*remove it"),
        file_lock(target, taken),
    ):
        pytest.fail("nobody knows")
    assert other.read_text() == "kept"


@needs_root
def test_a_lock_that_may_not_be_opened_refuses(shared):
    (shared / ".lock").touch()
    (shared / ".lock").chmod(0o600)
    with (
        another_user(),
        pytest.raises(InputError, match=r"\.lock cannot be opened \(permission denied\).*remove it"),
        file_lock(shared, taken),
    ):
        pytest.fail("nobody knows")


def test_a_folder_that_cannot_be_written_to_tells_so_itself(tmp_path):
    with file_lock(tmp_path / "missing" / "t.parquet", taken):
        pass
