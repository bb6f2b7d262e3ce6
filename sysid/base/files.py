"""Files written whole or not at all, and files of lines that survive a kill."""

import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from sysid.base.errors import InputError


@contextmanager
def whole_file(path: str | os.PathLike) -> Iterator[Path]:
    """A temporary name beside `path` with the same suffix for the block to write to; at its end it becomes `path`.

    A reader never sees half a file, and a block that fails leaves no file. Raises the OSError if the folder or disk
    cannot be written to, so that the caller can name the cause.
    """
    target = Path(path)
    handle, name = tempfile.mkstemp(prefix=f".{target.stem}.", suffix=target.suffix, dir=target.parent)
    os.close(handle)
    temporary = Path(name)
    try:
        yield temporary
        with temporary.open("rb+") as file:
            os.fsync(file.fileno())
        # mkstemp gives 0600; a file from open() follows the user's umask.
        umask = os.umask(0)
        os.umask(umask)
        os.chmod(temporary, 0o666 & ~umask)
        os.replace(temporary, target)
    finally:
        temporary.unlink(missing_ok=True)


def write_text(path: str | os.PathLike, text: str) -> Path:
    """Write `text` whole or not at all. Raises InputError if the folder is missing or not writable."""
    target = Path(path)
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


class Lines:
    """A text file that grows line by line. Each line is appended in one write and flushed to the disk. A kill
    damages at most the last line, which is left out on reading and removed before the next line is appended.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._mended = False

    def read(self) -> list[str]:
        """The complete lines; none if there is no file."""
        if not self.path.exists():
            return []
        return self._whole().decode("utf-8").splitlines()

    def append(self, line: str) -> None:
        """Appends one line. Raises OSError if it cannot be written."""
        with self.path.open("ab") as file:
            if not self._mended:
                file.truncate(len(self._whole()))
                self._mended = True
            file.write(line.encode("utf-8") + b"\n")
            file.flush()
            os.fsync(file.fileno())

    def _whole(self) -> bytes:
        data = self.path.read_bytes()
        return data[: data.rfind(b"\n") + 1]
