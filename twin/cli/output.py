"""Where a verb writes: a folder that appears whole or not at all."""

import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from datetime import datetime
from pathlib import Path

from sysid.errors import InputError


def default_folder(verb: str) -> Path:
    """runs/<stamp>-<verb>, with a number behind it when two runs start within a second."""
    base = Path("runs") / f"{datetime.now():%Y%m%d-%H%M%S}-{verb}"
    folder, n = base, 1
    while folder.exists():
        n += 1
        folder = base.with_name(f"{base.name}-{n}")
    return folder


@contextmanager
def output_folder(folder: Path) -> Iterator[Path]:
    """A scratch folder beside `folder`, whose content becomes `folder`'s when the block ends well.

    A block that fails or is interrupted leaves nothing, not even a parent that was made for it. A folder that is there
    already keeps its other files; those of the same name are replaced, each in one step. Raises InputError, at once and
    not after the work, where the place cannot be written to.
    """
    made: list[Path] = []
    scratch = folder.with_name(f".{folder.name}-{os.getpid()}.part")
    try:
        try:
            made = _make_parents(folder)
            if folder.exists() and not folder.is_dir():
                raise NotADirectoryError(0, "it is a file")
            scratch.mkdir()
        except OSError as error:
            raise _not_writable(folder, error) from None
        yield scratch
        try:
            _move_into_place(scratch, folder)
        except OSError as error:
            raise _not_writable(folder, error) from None
    except BaseException:
        shutil.rmtree(scratch, ignore_errors=True)
        for parent in reversed(made):
            if parent.is_dir() and not any(parent.iterdir()):
                parent.rmdir()
        raise


def check_writable_file(path: Path) -> None:
    """Raises InputError where a file cannot be made at `path`, before any work is spent on its content."""
    try:
        if path.is_dir():
            raise IsADirectoryError(0, "it is a folder")
        if not path.parent.is_dir():
            raise FileNotFoundError(0, f"there is no folder {path.parent}")
        if not os.access(path.parent, os.W_OK):
            raise PermissionError(0, "permission denied")
    except OSError as error:
        raise _not_writable(path, error) from None


def _make_parents(folder: Path) -> list[Path]:
    missing = []
    parent = folder.parent
    while not parent.exists():
        missing.append(parent)
        parent = parent.parent
    missing.reverse()
    for parent in missing:
        parent.mkdir(exist_ok=True)
    return missing


def _move_into_place(scratch: Path, folder: Path) -> None:
    if not folder.exists():
        os.rename(scratch, folder)
        return
    for source in sorted(path for path in scratch.rglob("*") if path.is_file()):
        target = folder / source.relative_to(scratch)
        target.parent.mkdir(parents=True, exist_ok=True)
        os.replace(source, target)
    shutil.rmtree(scratch)


def _not_writable(path: Path, error: OSError) -> InputError:
    return InputError(f"cannot write to {path} ({error.strerror or error}); give a place that you can write to")
