"""Output folder of a verb; it appears complete or not at all."""

import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from datetime import datetime
from itertools import count
from pathlib import Path

from sysid.base.errors import InputError

RUNS = Path("runs")


@contextmanager
def run_folder(out: str | None, verb: str) -> Iterator[tuple[Path, Path]]:
    """Where a run writes, and the scratch folder that becomes it: `out`, or a new runs/<stamp>-<verb>.

    The new folder is made at once, so that no other run uses it. A run that starts in the same second gets a name with
    a number. A run that fails removes its folder.
    """
    if out is not None:
        with output_folder(Path(out)) as scratch:
            yield Path(out), scratch
        return
    first = not RUNS.exists()
    folder = _claim(verb)
    try:
        with output_folder(folder, claimed=True) as scratch:
            yield folder, scratch
    except BaseException:
        _remove_empty(folder, *([RUNS] if first else []))
        raise


def new_folder(verb: str) -> Path:
    """A new folder runs/<stamp>-<verb>, for what grows while a verb runs."""
    return _claim(verb)


def _claim(verb: str) -> Path:
    """A folder runs/<stamp>-<verb> that this call has made."""
    base = RUNS / f"{datetime.now():%Y%m%d-%H%M%S}-{verb}"
    for n in count(1):
        folder = base if n == 1 else base.with_name(f"{base.name}-{n}")
        try:
            folder.mkdir(parents=True)
        except FileExistsError:
            if RUNS.is_dir():
                continue
            raise _not_writable(folder, NotADirectoryError(0, f"{RUNS} is a file")) from None
        except OSError as error:
            raise _not_writable(folder, error) from None
        return folder
    raise AssertionError


@contextmanager
def output_folder(folder: Path, claimed: bool = False) -> Iterator[Path]:
    """A scratch folder beside `folder`; its content moves to `folder` when the block succeeds.

    A block that fails or is interrupted leaves nothing, not even a parent folder made for it. An existing folder keeps
    its other files; files of the same name are replaced, each in one step. A `claimed` folder was made only for this
    block and is replaced as a whole. Raises InputError before the work if the place cannot be written to.
    """
    made: list[Path] = []
    if folder.name in ("", ".."):  # . and .. have no name of their own
        folder = folder.resolve()
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
            _move_into_place(scratch, folder, claimed)
        except OSError as error:
            raise _not_writable(folder, error) from None
    except BaseException:
        shutil.rmtree(scratch, ignore_errors=True)
        _remove_empty(*reversed(made))
        raise


def check_writable_file(path: Path) -> None:
    """Raises InputError before the work if no file can be made at `path`."""
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


def _remove_empty(*folders: Path) -> None:
    for folder in folders:
        with suppress(OSError):  # another run's are in it
            folder.rmdir()


def _move_into_place(scratch: Path, folder: Path, claimed: bool) -> None:
    if claimed:
        with suppress(OSError):  # Windows renames onto no folder, not even an empty one
            os.rename(scratch, folder)
            return
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
