"""Files that one process has for itself: locks, and temporary names that say whose they are.

The system releases a lock when its process ends, however that happens, so a killed process leaves none. The lock file
names the process that holds it, and every user who may use the folder may write to it, whatever the mask of the one who
made it. Where the system or the disk knows no such locks, there are none.

A temporary name holds a mark of the machine, the process, and when that process began, since the system gives a number
again: what a killed process left goes, and what is in use stays.
"""

import os
import re
import shutil
import socket
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from functools import cache
from hashlib import blake2b
from itertools import count
from pathlib import Path
from typing import IO

from sysid.base.errors import InputError

MARKED_NAME = re.compile(r"qpal-(?P<machine>[0-9a-f]{8})-(?P<process>\d+)-(?P<began>\d+)-\d+")
READY, CLAIMED = ".ready", ".new.part"  # ends of names that stand for a folder too: `twin.cli.results` ends those
WORD_BYTES = 200  # bytes that a name leaves to the words before the mark; a file system has 255
# What tells one machine from another: an id that lasts, a number of small boards' hardware, and one of this boot.
MACHINE, SERIAL = "/etc/machine-id", "/proc/device-tree/serial-number"
BOOT, PROCESSES = "/proc/sys/kernel/random/boot_id", "/proc/self/ns/pid"
OUTSIDE = "pid:[4026531836]"  # what the kernel calls the processes of a machine outside all containers
_name_numbers = count()
_swept: set[str] = set()


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


def take_lock(path: Path, refusal: Callable[[str], str]) -> Lock:
    """The lock at `path`. Raises InputError with the sentence `refusal(holder)` if a process has it, and for a file at
    `path` that cannot be opened, so that nobody knows; OSError if the file cannot be made.
    """
    while True:
        file = _open_lock_file(path)
        try:
            if _try_lock(file) and not _is_same_file(path, file):  # the one before removed it meanwhile
                file.close()
                continue
        except BlockingIOError:
            holder = _holder(file)
            file.close()
            raise InputError(refusal(holder)) from None
        break
    with suppress(OSError):  # a full disk: the lock holds without the number too
        file.truncate(0)
        file.write(f"{os.getpid()} {socket.gethostname()}\n".encode())
        file.flush()
    return Lock(path, file)


@contextmanager
def file_lock(target: str | os.PathLike[str], refusal: Callable[[str], str]) -> Iterator[None]:
    """A lock beside the file `target`, or inside the folder `target`, for the block.

    A place where no lock file can be made cannot be written to either: the block tells that itself. Only an existing
    file can, in a folder of somebody else; it is refused with InputError.
    """
    place = Path(os.path.realpath(target))
    path = place / ".lock" if place.is_dir() else place.with_name(f".{place.name}.lock")
    try:
        lock = take_lock(path, refusal)
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


def _open_lock_file(path: Path) -> IO[bytes]:
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
            raise _unreadable_lock(path, "permission denied") from None
        except OSError as error:
            why = "it is a link" if path.is_symlink() else error.strerror or str(error)
            raise _unreadable_lock(path, why) from None


def _unreadable_lock(path: Path, why: str) -> InputError:
    return InputError(
        f"the lock {path} cannot be opened ({why}), so whether another run writes there cannot be told; remove it if "
        "none does, or give another place"
    )


def _try_lock(file: IO[bytes]) -> bool:
    """Lock the file without waiting; False where there are no locks. Raises BlockingIOError if another has it."""
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


def _is_same_file(path: Path, file: IO[bytes]) -> bool:
    try:
        return os.path.samestat(os.stat(path), os.fstat(file.fileno()))
    except FileNotFoundError:
        return False


def _holder(file: IO[bytes]) -> str:
    """The process that a lock file names."""
    file.seek(0)
    words = file.read(300).decode("utf-8", "replace").split()
    if len(words) != 2 or not words[0].isdigit():
        return "another process"
    return f"process {words[0]}" if words[1] == socket.gethostname() else f"process {words[0]} on {words[1]}"


def mark() -> str:
    """A text for a temporary name that no other call gives, of this process or of another."""
    process = os.getpid()
    return f"qpal-{_machine()}-{process}-{start_ticks(process)}-{next(_name_numbers)}"


def temporary_name(path: Path, end: str = "") -> Path:
    """A temporary name in the folder of `path`, which begins with a dot and the words of `path`."""
    words = os.fsencode(path.name if end else path.stem)[:WORD_BYTES].decode("utf-8", "ignore")
    return path.with_name(f".{words}-{mark()}{end or path.suffix[-40:]}")


def is_in_use(name: str) -> bool | None:
    """Whether the process of a temporary name is there; None for a name without a mark.

    Of a process of another machine, or of a system that does not tell, it is said to be there.
    """
    match = MARKED_NAME.search(name)
    if match is None:
        return None
    if match["machine"] != _machine() or os.name != "posix":
        return True
    process, began = int(match["process"]), int(match["began"])
    try:
        os.kill(process, 0)
    except (ProcessLookupError, OverflowError):
        return False
    except OSError:  # somebody else's
        pass
    now = start_ticks(process)
    return began == now or 0 in (began, now)


def sweep(folder: Path) -> list[str]:
    """Removes what processes that are gone left in `folder`; returns the names."""
    removed = []
    with suppress(OSError):
        for name in os.listdir(folder):
            if not name.endswith((READY, CLAIMED)) and is_in_use(name) is False and _is_mine(folder / name):
                remove(folder / name)
                removed.append(name)
    return removed


def sweep_once(folder: Path) -> None:
    """`sweep`, the first time that this process writes to `folder`."""
    place = os.path.abspath(folder)
    if place not in _swept:
        _swept.add(place)
        sweep(folder)


@contextmanager
def scratch_folder() -> Iterator[Path]:
    """A folder among the temporary ones of the machine, removed at the end; first, what killed processes left goes."""
    folder = new_scratch_folder()
    try:
        yield folder
    finally:
        shutil.rmtree(folder, ignore_errors=True)


def new_scratch_folder() -> Path:
    """The folder of `scratch_folder`, for the caller to remove."""
    place = Path(tempfile.gettempdir())
    sweep_once(place)
    folder = place / mark()
    folder.mkdir(mode=0o700)
    return folder


def _is_mine(path: Path) -> bool:
    """Whether it belongs to this user; in a folder that all write to, a name alone says nothing."""
    return not hasattr(os, "getuid") or path.lstat().st_uid == os.getuid()


def remove(path: Path) -> None:
    """A file, a link, or a folder with all that is in it."""
    if path.is_dir() and not path.is_symlink():
        shutil.rmtree(path, ignore_errors=True)
    else:
        path.unlink(missing_ok=True)


@cache
def _machine() -> str:
    """The machine, and the container within it, which numbers its processes anew.

    Machines on one network disk may have the same name, and copies of a card the same id. The number of a container
    means something until the machine starts again; a machine itself has its id, so that what was left before it started
    again goes too.
    """
    try:
        within = os.readlink(PROCESSES)
    except OSError:
        within = ""
    name = os.uname().nodename if hasattr(os, "uname") else os.environ.get("COMPUTERNAME", "")
    machine_id = "" if within not in ("", OUTSIDE) else _system_text(MACHINE)
    identity = f"{machine_id} {_system_text(SERIAL)}" if machine_id else _system_text(BOOT)
    return blake2b(f"{name} {within} {identity}".encode("utf-8", "surrogateescape"), digest_size=4).hexdigest()


def _system_text(file: str) -> str:
    """What a file of the system says; nothing where there is none."""
    try:
        return Path(file).read_text("ascii", "replace").strip()
    except OSError:
        return ""


def start_ticks(process: int) -> int:
    """When a process began, in ticks since the machine did; 0 where the system does not tell, -1 if it has ended."""
    try:
        with open(f"/proc/{process}/stat", "rb") as file:
            fields = file.read().rpartition(b")")[2].split()
        return -1 if fields[0] in (b"Z", b"X") else int(fields[19])
    except (OSError, IndexError, ValueError):
        return 0
