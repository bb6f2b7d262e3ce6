"""Temporary names that say whose they are, so that what a killed process left goes and what is in use stays.

A name holds a mark of the machine, the process, and when that process began, since the system gives a number again.
"""

import os
import re
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from functools import cache
from hashlib import blake2b
from itertools import count
from pathlib import Path

NAME = re.compile(r"qpal-(?P<machine>[0-9a-f]{8})-(?P<process>\d+)-(?P<began>\d+)-\d+")
READY, CLAIMED = ".ready", ".new.part"  # ends of names that stand for a folder too: `twin.cli.moving` ends those
PLACE = 200  # bytes that a name leaves to the words before the mark; a file system has 255
# What tells one machine from another: an id that lasts, a number of small boards' hardware, and one of this boot.
MACHINE, SERIAL = "/etc/machine-id", "/proc/device-tree/serial-number"
BOOT, PROCESSES = "/proc/sys/kernel/random/boot_id", "/proc/self/ns/pid"
OUTSIDE = "pid:[4026531836]"  # what the kernel calls the processes of a machine outside all containers
_numbers = count()
_swept: set[str] = set()


def mark() -> str:
    """A text for a temporary name that no other call gives, of this process or of another."""
    process = os.getpid()
    return f"qpal-{_machine()}-{process}-{began_at(process)}-{next(_numbers)}"


def beside(path: Path, end: str = "") -> Path:
    """A temporary name in the folder of `path`, which begins with a dot and the words of `path`."""
    words = os.fsencode(path.name if end else path.stem)[:PLACE].decode("utf-8", "ignore")
    return path.with_name(f".{words}-{mark()}{end or path.suffix[-40:]}")


def in_use(name: str) -> bool | None:
    """Whether the process of a temporary name is there; None for a name without a mark.

    Of a process of another machine, or of a system that does not tell, it is said to be there.
    """
    found = NAME.search(name)
    if found is None:
        return None
    if found["machine"] != _machine() or os.name != "posix":
        return True
    process, began = int(found["process"]), int(found["began"])
    try:
        os.kill(process, 0)
    except (ProcessLookupError, OverflowError):
        return False
    except OSError:  # somebody else's
        pass
    now = began_at(process)
    return began == now or 0 in (began, now)


def sweep(folder: Path) -> list[str]:
    """Removes what processes that are gone left in `folder`; returns the names."""
    removed = []
    with suppress(OSError):
        for name in os.listdir(folder):
            if not name.endswith((READY, CLAIMED)) and in_use(name) is False and _own(folder / name):
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
def scratch() -> Iterator[Path]:
    """A folder among the temporary ones of the machine, removed at the end; first, what killed processes left goes."""
    folder = new_scratch()
    try:
        yield folder
    finally:
        shutil.rmtree(folder, ignore_errors=True)


def new_scratch() -> Path:
    """The folder of `scratch`, for the caller to remove."""
    place = Path(tempfile.gettempdir())
    sweep_once(place)
    folder = place / mark()
    folder.mkdir(mode=0o700)
    return folder


def _own(path: Path) -> bool:
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
    own = "" if within not in ("", OUTSIDE) else _said(MACHINE)
    known = f"{own} {_said(SERIAL)}" if own else _said(BOOT)
    return blake2b(f"{name} {within} {known}".encode("utf-8", "surrogateescape"), digest_size=4).hexdigest()


def _said(file: str) -> str:
    """What a file of the system says; nothing where there is none."""
    try:
        return Path(file).read_text("ascii", "replace").strip()
    except OSError:
        return ""


def began_at(process: int) -> int:
    """When a process began, in ticks since the machine did; 0 where the system does not tell, -1 if it has ended."""
    try:
        with open(f"/proc/{process}/stat", "rb") as file:
            said = file.read().rpartition(b")")[2].split()
        return -1 if said[0] in (b"Z", b"X") else int(said[19])
    except (OSError, IndexError, ValueError):
        return 0
