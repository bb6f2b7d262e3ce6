"""Files written whole or not at all, and files of lines that survive a kill."""

import codecs
import errno
import os
import stat
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import IO

from sysid.base.errors import InputError
from sysid.base.leftovers import beside, sweep_once

_SPECIAL = {
    stat.S_IFIFO: "a named pipe",
    stat.S_IFSOCK: "a socket",
    stat.S_IFCHR: "a device",
    stat.S_IFBLK: "a device",
}
_NAMES = {errno.ENAMETOOLONG: "is too long for a name of a file", errno.ELOOP: "is a link to itself"}


def ordinary(path: str | os.PathLike[str]) -> Path:
    """`path`, if it is a regular file, a folder or missing, so that opening it neither waits nor reads without end.

    Raises InputError for a pipe, a socket, a device or a link to one, for a name that no file can have, and for one
    that is not text, since no report could show it.
    """
    found = Path(path)
    name = ascii(str(path)) if len(str(path)) <= 100 else f"{str(path)[:100]!a}..."
    if not str(path).isprintable():
        try:
            str(path).encode()
        except UnicodeEncodeError:
            with suppress(UnicodeDecodeError):
                name = repr(os.fsencode(found).decode())
                raise InputError(f"this locale has no letters for the name {name}; set PYTHONUTF8=1") from None
            raise InputError(f"the name {name} is not UTF-8 text; rename the file") from None
        if "\0" in str(path):
            raise InputError(f"the name {name} holds a zero byte; give the name of a file")
    try:
        kind = _SPECIAL.get(stat.S_IFMT(found.stat().st_mode))
    except OSError as error:
        if error.errno in (errno.ENOENT, errno.ENOTDIR):
            return found
        why = _NAMES.get(error.errno or 0, f"cannot be read ({error.strerror})")
        raise InputError(f"{name} {why}; give the name of a file that you may read") from None
    if kind:
        raise InputError(f"{found} is {kind}, not a regular file; copy the data to a file and give that")
    return found


@contextmanager
def whole_file(path: str | os.PathLike) -> Iterator[Path]:
    """A temporary name beside `path` with the same suffix for the block to write to; at its end it becomes `path`.

    What killed processes left in that folder goes first (see `sysid.base.leftovers`). A reader never sees half a file,
    and a block that fails leaves no file. Raises the OSError if the folder or disk cannot be written to, so that the
    caller can name the cause.
    """
    target = Path(path)
    sweep_once(target.parent)
    temporary = beside(target)
    try:
        os.close(os.open(temporary, os.O_CREAT | os.O_EXCL | os.O_WRONLY, 0o666))
        yield temporary
        with temporary.open("rb+") as file:
            os.fsync(file.fileno())
        os.replace(temporary, target)
    finally:
        temporary.unlink(missing_ok=True)


def write_text(path: str | os.PathLike, text: str) -> Path:
    """Write `text` whole or not at all. Raises InputError if the folder is missing or not writable."""
    target = Path(path)
    try:
        os.fsencode(target)
    except UnicodeEncodeError:
        raise InputError(f"the name {str(path)!a} is not UTF-8 text; give another name") from None
    if not target.name:
        raise InputError(f"{str(path)!r} is no name of a file; give one, for example report.html")
    if not target.parent.is_dir():
        raise InputError(f"cannot write {target}: folder {target.parent} does not exist; choose a folder that exists")
    try:
        with whole_file(target) as temporary:
            temporary.write_text(text, encoding="utf-8", newline="\n")
    except OSError as e:
        raise InputError(
            f"cannot write {target}: {e.strerror}; choose a folder or a file that you may write to"
        ) from None
    return target


@contextmanager
def _alone(file: IO[bytes]) -> Iterator[None]:
    """No other process is within this for the same file, on a system that has such locks."""
    with suppress(OSError, ImportError):  # a file system without locks, or Windows
        import fcntl

        fcntl.flock(file, fcntl.LOCK_EX)  # until the file is closed
    yield


class Lines:
    """A text file that grows line by line. Each line is appended in one write and flushed to the disk. A kill
    damages at most the last line, which is left out on reading and removed before the next line is appended.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._mended = False

    def read(self) -> list[str]:
        """The complete lines; none if there is no file."""
        if not ordinary(self.path).exists():
            return []
        return [
            line.decode("utf-8", "replace") for line in self._whole().removeprefix(codecs.BOM_UTF8).split(b"\n")[:-1]
        ]

    def append(self, line: str) -> None:
        """Appends one line. Raises OSError if it cannot be written, and then leaves no file that was not there."""
        new = not ordinary(self.path).exists()
        try:
            with self.path.open("ab") as file, _alone(file):
                if not self._mended:
                    file.truncate(len(self._whole()))
                    self._mended = True
                file.write(line.encode("utf-8") + b"\n")
                file.flush()
                os.fsync(file.fileno())
        except OSError:
            with suppress(OSError):
                if new and not self._whole():
                    self.path.unlink()
            raise

    def _whole(self) -> bytes:
        data = self.path.read_bytes()
        return data[: data.rfind(b"\n") + 1]
