"""A lock on a file or a folder that one process at a time may write to.

The system releases the lock when its process ends, however that happens, so a killed process leaves none. The lock
file names the process that holds it, and every user who may use the folder may write to it, whatever the mask of the
one who made it. Where the system or the disk knows no such locks, there are none.
"""

import os
import socket
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import IO

from sysid.base.errors import InputError


class Lock:
    """A lock that is held until `close`."""

    def __init__(self, path: Path, file: IO[bytes]) -> None:
        self._path, self._file = path, file

    def close(self, remove: bool = True) -> None:
        """Another process may have it; the lock file goes, unless `remove` is false."""
        if self._file.closed:
            return
        if remove:  # before the lock is released: afterwards the file may be another's
            with suppress(OSError):
                self._path.unlink()
        self._file.close()


def take(path: Path, taken: Callable[[str], str]) -> Lock:
    """The lock at `path`. Raises InputError with the sentence `taken(holder)` if a process has it, and for a file at
    `path` that cannot be opened, so that nobody knows; OSError if the file cannot be made.
    """
    while True:
        file = _opened(path)
        try:
            if _locked(file) and not _is(path, file):  # the one before removed it meanwhile
                file.close()
                continue
        except BlockingIOError:
            who = _holder(file)
            file.close()
            raise InputError(taken(who)) from None
        break
    with suppress(OSError):  # a full disk: the lock holds without the number too
        file.truncate(0)
        file.write(f"{os.getpid()} {socket.gethostname()}\n".encode())
        file.flush()
    return Lock(path, file)


@contextmanager
def held(target: str | os.PathLike[str], taken: Callable[[str], str]) -> Iterator[None]:
    """A lock beside the file `target`, or inside the folder `target`, for the block.

    A place where no lock file can be made cannot be written to either: the block tells that itself. Only an existing
    file can, in a folder of somebody else; it is refused with InputError.
    """
    place = Path(os.path.realpath(target))
    path = place / ".lock" if place.is_dir() else place.with_name(f".{place.name}.lock")
    try:
        lock = take(path, taken)
    except OSError as error:
        if isinstance(error, PermissionError) and place.is_file() and os.access(place, os.W_OK):
            raise InputError(
                f"{target} can be written to, but no lock beside it can be made ({error.strerror}), so that two runs "
                "could write at once; copy it to a folder that you can write to and give that"
            ) from None
        yield
        return
    try:
        yield
    finally:
        lock.close()


def _opened(path: Path) -> IO[bytes]:
    """The lock file, made if it is missing. A link is not followed: what it leads to would be emptied.

    In a folder that all write to, Linux opens no file of another user by a call that may make one.
    """
    flags = getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_CLOEXEC", 0) | getattr(os, "O_BINARY", 0)
    while True:
        with suppress(FileExistsError):
            number = os.open(path, os.O_RDWR | os.O_CREAT | os.O_EXCL | flags, 0o666)
            with suppress(OSError, AttributeError):  # a disk without modes, or Windows
                os.fchmod(number, 0o666)
            return os.fdopen(number, "r+b")
        try:
            return os.fdopen(os.open(path, os.O_RDWR | flags), "r+b")
        except FileNotFoundError:  # its process has just ended
            continue
        except PermissionError:  # of an older version: a lock holds without writing too
            with suppress(OSError):
                return os.fdopen(os.open(path, os.O_RDONLY | flags), "rb")
            raise _unknown(path, "permission denied") from None
        except OSError as error:
            why = "it is a link" if path.is_symlink() else error.strerror or str(error)
            raise _unknown(path, why) from None


def _unknown(path: Path, why: str) -> InputError:
    return InputError(
        f"the lock {path} cannot be opened ({why}), so whether another run writes there cannot be told; remove it if "
        "none does, or give another place"
    )


def _locked(file: IO[bytes]) -> bool:
    """Whether the file is locked now; False where there are no locks. Raises BlockingIOError if another has it."""
    try:
        import fcntl
    except ImportError:  # Windows
        return False
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        raise
    except OSError:  # a disk without locks
        return False
    return True


def _is(path: Path, file: IO[bytes]) -> bool:
    try:
        return os.path.samestat(os.stat(path), os.fstat(file.fileno()))
    except FileNotFoundError:
        return False


def _holder(file: IO[bytes]) -> str:
    """The process that a lock file names."""
    file.seek(0)
    found = file.read(300).decode("utf-8", "replace").split()
    if len(found) != 2 or not found[0].isdigit():
        return "another process"
    return f"process {found[0]}" if found[1] == socket.gethostname() else f"process {found[0]} on {found[1]}"
