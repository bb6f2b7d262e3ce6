"""Files written whole or not at all, files of lines that survive a kill, and the values that stand in them.

A row of JSON may carry a check sum over its content and over what it belongs to: one that was changed by hand, damaged
on a disk or copied from another file does not hold. This finds accidents: who wants to deceive can compute it too.
"""

import codecs
import errno
import hashlib
import json
import os
import platform
import re
import stat
import tomllib
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from importlib import metadata
from pathlib import Path
from typing import IO, Any

import numpy as np

from sysid.base.errors import InputError, printable
from sysid.base.locks import sweep_once, temporary_name

_SPECIAL_FILES = {
    stat.S_IFIFO: "a named pipe",
    stat.S_IFSOCK: "a socket",
    stat.S_IFCHR: "a device",
    stat.S_IFBLK: "a device",
}
_NAME_ERRORS = {errno.ENAMETOOLONG: "is too long for a name of a file", errno.ELOOP: "is a link to itself"}
CHECK = "check"
DEEPEST = 50  # parts of a dotted name in TOML; those of this program have three
_PART = r"""(?:[\w-]+|"[^"\n]*"|'[^'\n]*')[ \t]*"""
_DEEP = re.compile(rf"(?<![\w-])(?:{_PART}\.[ \t]*){{{DEEPEST}}}")
DAMAGED, UNSEALED = "damaged", "unsealed"
VERSIONED_PACKAGES = ("qpal", "mujoco", "numpy", "scipy", "numba", "control")


def check_regular_file(path: str | os.PathLike[str]) -> Path:
    """`path`, if it is a regular file, a folder or missing, so that opening it neither waits nor reads without end.

    Raises InputError for a pipe, a socket, a device or a link to one, for a name that no file can have, and for one
    that is not text, since no report could show it.
    """
    file = Path(path)
    name = ascii(str(path)) if len(str(path)) <= 100 else f"{str(path)[:100]!a}..."
    if not str(path).isprintable():
        try:
            str(path).encode()
        except UnicodeEncodeError:
            with suppress(UnicodeDecodeError):
                name = repr(os.fsencode(file).decode())
                raise InputError(f"this locale has no letters for the name {name}; set PYTHONUTF8=1") from None
            raise InputError(f"the name {name} is not UTF-8 text; rename the file") from None
        if "\0" in str(path):
            raise InputError(f"the name {name} holds a zero byte; give the name of a file")
    try:
        kind = _SPECIAL_FILES.get(stat.S_IFMT(file.stat().st_mode))
    except OSError as error:
        if error.errno in (errno.ENOENT, errno.ENOTDIR):
            return file
        why = _NAME_ERRORS.get(error.errno or 0, f"cannot be read ({error.strerror})")
        raise InputError(f"{name} {why}; give the name of a file that you may read") from None
    if kind:
        raise InputError(f"{file} is {kind}, not a regular file; copy the data to a file and give that")
    return file


def read_limited(path: str | os.PathLike[str], most: int) -> bytes:
    """The content of a regular file of at most `most` bytes, which is all that is held in memory.

    Raises InputError as `check_regular_file` does and for a larger file, OSError for one that cannot be read.
    """
    with check_regular_file(path).open("rb") as file:
        content = file.read(most + 1) if os.fstat(file.fileno()).st_size <= most else None
    if content is None or len(content) > most:
        raise InputError(f"{Path(path).name} is larger than {most / 2**20:g} MiB; qpal writes no such file")
    return content


def toml_values(text: str) -> dict[str, Any]:
    """The values of a TOML text. Raises tomllib's ValueError, and RecursionError for names of `DEEPEST` parts or more.

    The time that tomllib takes grows with the square of their number.
    """
    if _DEEP.search(text):
        raise RecursionError(f"a name has more than {DEEPEST} parts")
    return tomllib.loads(text)


@contextmanager
def atomic_file(path: str | os.PathLike) -> Iterator[Path]:
    """A temporary name beside `path` with the same suffix for the block to write to; at its end it becomes `path`.

    What killed processes left in that folder goes first (see `sysid.base.locks`). A reader never sees half a file,
    and a block that fails leaves no file. Raises the OSError if the folder or disk cannot be written to, so that the
    caller can name the cause.
    """
    target = Path(path)
    sweep_once(target.parent)
    temporary = temporary_name(target)
    try:
        os.close(os.open(temporary, os.O_CREAT | os.O_EXCL | os.O_WRONLY, 0o666))
        yield temporary
        with temporary.open("rb+") as file:
            os.fsync(file.fileno())
        os.replace(temporary, target)
    finally:
        temporary.unlink(missing_ok=True)


def write_text(path: str | os.PathLike, text: str) -> Path:
    """`write_bytes` of a text as `printable` has it, in UTF-8."""
    return write_bytes(path, printable(text).encode("utf-8"))


def write_bytes(path: str | os.PathLike, content: bytes) -> Path:
    """Write `content` whole or not at all; raises InputError where the place is not writable."""
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
        with atomic_file(target) as temporary:
            temporary.write_bytes(content)
    except OSError as e:
        raise InputError(
            f"cannot write {target}: {e.strerror}; choose a folder or a file that you may write to"
        ) from None
    return target


@contextmanager
def _exclusive_lock(file: IO[bytes]) -> Iterator[None]:
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
        self._repaired = False

    def read(self) -> list[str]:
        """The complete lines; none if there is no file, or none any more: another process may end while it is read."""
        check_regular_file(self.path)
        with suppress(FileNotFoundError):
            lines = self._complete_lines().removeprefix(codecs.BOM_UTF8).split(b"\n")[:-1]
            return [line.decode("utf-8", "replace") for line in lines]
        return []

    def append(self, line: str) -> None:
        """Appends one line. Raises OSError if it cannot be written, and then leaves no file that was not there."""
        new = not check_regular_file(self.path).exists()
        try:
            with self.path.open("ab") as file, _exclusive_lock(file):
                if not self._repaired:
                    file.truncate(len(self._complete_lines()))
                    self._repaired = True
                file.write(line.encode("utf-8") + b"\n")
                file.flush()
                os.fsync(file.fileno())
        except OSError:
            with suppress(OSError):
                if new and not self._complete_lines():
                    self.path.unlink()
            raise

    def _complete_lines(self) -> bytes:
        data = self.path.read_bytes()
        return data[: data.rfind(b"\n") + 1]


def seal(content: Mapping[str, Any], belongs: str) -> dict[str, Any]:
    """`content` with its check sum; `belongs` names what the row is part of."""
    return {**content, CHECK: check_sum(content, belongs)}


def check_sum(content: Mapping[str, Any], belongs: str) -> str:
    """The check sum of JSON values, whatever the order of their names."""
    return hashlib.sha256(json.dumps([belongs, content], sort_keys=True).encode()).hexdigest()[:32]


def unseal(line: str, belongs: str) -> tuple[dict[str, Any], str]:
    """The content of a line, and "" if it holds, UNSEALED without a check sum, DAMAGED if it is not what was written.

    A damaged line has no content.
    """
    try:
        row = json.loads(line)
    except (ValueError, RecursionError):
        return {}, DAMAGED
    if not isinstance(row, dict):
        return {}, DAMAGED
    checksum = row.pop(CHECK, None)
    if checksum is None:
        return row, UNSEALED
    return (row, "") if checksum == check_sum(row, belongs) else ({}, DAMAGED)


def json_value(value: Any) -> Any:
    """The same without NumPy types and without numbers that JSON does not know: these become None.

    Arrays and tuples become lists, a complex number becomes [re, im].
    """
    if isinstance(value, dict):
        return {k: json_value(v) for k, v in value.items()}
    if isinstance(value, (list, tuple)):
        return [json_value(v) for v in value]
    if isinstance(value, np.ndarray):
        return json_value(value.tolist())
    if isinstance(value, (bool, np.bool_)):
        return bool(value)
    if isinstance(value, (float, np.floating)):
        return float(value) if np.isfinite(value) else None
    if isinstance(value, (complex, np.complexfloating)):
        return [json_value(float(value.real)), json_value(float(value.imag))]
    return int(value) if isinstance(value, np.integer) else value


def json_text(value: Any, **layout: Any) -> str:
    """JSON with letters as they are, and with what `printable` escapes written as \\u001b: it reads back the same."""
    text = json.dumps(value, ensure_ascii=False, allow_nan=False, **layout)
    return text if text.isprintable() else _OTHER.sub(_escaped_in_json, text)


_OTHER = re.compile(r"[^\n -~]")


def _escaped_in_json(match: re.Match[str]) -> str:
    return match[0] if printable(match[0]) == match[0] else json.dumps(match[0])[1:-1]


def versions() -> dict[str, str]:
    """Version of Python and of every package that can affect a number."""
    numbers = {"python": platform.python_version()}
    for package in VERSIONED_PACKAGES:
        try:
            numbers[package] = metadata.version(package)
        except metadata.PackageNotFoundError:
            numbers[package] = "not installed"
    return numbers
