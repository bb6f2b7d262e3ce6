"""Output folder of a verb; it appears complete or not at all."""

import errno
import os
import shutil
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from datetime import datetime
from itertools import count
from pathlib import Path

from sysid.base.errors import InputError
from twin.cli import results
from twin.cli.environment import say
from twin.cli.stopping import hold_requests

RUNS = Path("runs")
MANY = 5  # names in a sentence
LITTLE = 1 << 20  # [byte] that are free on a disk on which a file had no space


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
    with _scratch(_first(verb), lambda: _claim(verb), True) as folders:
        yield folders


def new_folder(verb: str) -> Path:
    """A new folder runs/<stamp>-<verb>, for what grows while a verb runs."""
    for folder in _names(verb):
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


def _names(verb: str) -> Iterator[Path]:
    """Names runs/<stamp>-<verb>, then with numbers."""
    base = _first(verb)
    return (base if n == 1 else base.with_name(f"{base.name}-{n}") for n in count(1))


def _first(verb: str) -> Path:
    return RUNS / f"{datetime.now():%Y%m%d-%H%M%S}-{verb}"


def _claim(verb: str) -> tuple[Path, Path]:
    """A folder runs/<stamp>-<verb> that this call has made, and its scratch folder."""
    for folder in _names(verb):
        try:
            return folder, results.reserve(folder, claimed=True)
        except (FileExistsError, results.Busy):
            continue
    raise AssertionError


@contextmanager
def output_folder(folder: Path) -> Iterator[Path]:
    """A scratch folder beside `folder`; its content moves to `folder` when the block succeeds.

    A block that fails or is interrupted leaves nothing, not even a parent folder made for it. An existing folder keeps
    its other files; files of the same name are replaced, all of them or none, and a sentence names those that no run
    had made. Raises InputError before the work if the place cannot be written to, or if another run is writing to it.
    """
    # . and .. have no name of their own; a link may lead to another disk.
    if folder.name in ("", "..") or (folder.is_symlink() and folder.is_dir()):
        folder = folder.resolve()
    with _scratch(folder, lambda: _reserve(folder), False) as (_, scratch):
        yield scratch


def _reserve(folder: Path) -> tuple[Path, Path]:
    """The folder and its scratch folder; raises OSError or InputError where it cannot be written to."""
    if folder.exists() and not folder.is_dir():
        raise NotADirectoryError(0, "it is a file")
    if folder.exists() and not os.access(folder, os.W_OK | os.X_OK):
        raise _access_error(folder)
    if folder.is_symlink() and not folder.exists():
        raise FileNotFoundError(0, f"it is a link to {os.readlink(folder)}, which does not exist")
    if folder.exists() and (obstacle := _sibling_obstacle(folder)):
        raise InputError(
            f"cannot write to {folder}: results are made beside it first, and {folder.parent.resolve()} {obstacle}; "
            f"give a new folder in it, for example {folder / 'results'}"
        )
    return folder, results.reserve(folder, claimed=False)


@contextmanager
def _scratch(folder: Path, reserve: Callable[[], tuple[Path, Path]], claimed: bool) -> Iterator[tuple[Path, Path]]:
    """The folder and the scratch folder that `reserve` gives; parents of `folder` are made first."""
    new_parents: list[Path] = []
    scratch: Path | None = None
    try:
        try:
            with hold_requests():
                _make_parents(folder, new_parents)
                folder, scratch = reserve()
        except OSError as error:
            raise _not_writable(folder, error) from None
        try:
            yield folder, scratch
        except OSError as error:
            if sentence := _full(folder, error):
                raise InputError(sentence) from None
            raise
        try:
            foreign = results.move(scratch, folder, claimed)
        except OSError as error:
            stands = f"; {results.outcome()}" if results.is_written() else ""  # a file beside the folder
            raise InputError(f"{_not_writable(folder, error)}{stands}") from None
        if foreign:
            rest = f" and {len(foreign) - MANY} more" if len(foreign) > MANY else ""
            say(f"qpal: files of the same name were replaced in {folder}: {', '.join(foreign[:MANY])}{rest}")
    except BaseException:
        with hold_requests():
            if scratch is not None:
                shutil.rmtree(scratch, ignore_errors=True)
            _remove_empty(*([folder] if claimed and scratch is not None else []), *reversed(new_parents))
        raise


def _sibling_obstacle(folder: Path) -> str:
    """Why no scratch folder beside an existing folder could become its content; empty if it can."""
    if folder.parent == folder:
        return "is the root, which has nothing beside it"
    if not os.access(folder.parent, os.W_OK | os.X_OK):
        return "cannot be written to"
    if folder.stat().st_dev != folder.parent.stat().st_dev:  # it is where a disk is mounted
        return "is on another disk"
    return ""


def check_writable_file(path: Path) -> None:
    """Raises InputError before the work if no file can be made at `path`."""
    try:
        if path.is_dir():
            raise IsADirectoryError(0, "it is a folder")
        if path.exists() and not path.is_file():
            raise PermissionError(0, "it is a pipe, a socket or a device, which a file would replace")
        if not path.parent.is_dir():
            raise FileNotFoundError(0, f"there is no folder {path.parent}")
        if not os.access(path.parent, os.W_OK):
            raise _access_error(path.parent)
    except OSError as error:
        raise _not_writable(path, error) from None


def _access_error(place: Path) -> OSError:
    """Why nothing can be written in a place that the system says is closed to it."""
    with suppress(OSError, AttributeError):  # Windows
        if os.statvfs(place).f_flag & os.ST_RDONLY:
            return OSError(0, "read-only file system")
    return PermissionError(0, "permission denied")


def _full(folder: Path, error: OSError) -> str:
    """A sentence where a disk or a limit was full while `folder` was made, since such an error names no file; or none.

    Standard output may be full too, which is told elsewhere.
    """
    if error.errno == errno.EFBIG:
        return (
            f"cannot write to {folder} ({error.strerror}): a limit of this shell or of the disk ends a file, see "
            f"ulimit -f; {results.outcome()}"
        )
    if error.errno not in (errno.ENOSPC, errno.EDQUOT):
        return ""
    for place in (folder.absolute().parent, Path(tempfile.gettempdir())):
        with suppress(OSError):
            if error.errno == errno.EDQUOT or shutil.disk_usage(place).free < LITTLE:
                return f"cannot write to {folder} ({error.strerror} in {place}); {results.outcome()}; free some space"
    return ""


def _make_parents(folder: Path, new_parents: list[Path]) -> None:
    """Make the parents of `folder` that are missing; `new_parents` takes each of them."""
    missing = []
    parent = folder.parent
    while not parent.exists():
        if parent.name == "..":
            raise FileNotFoundError(0, f"there is no folder {parent.parent}, through which it leads")
        missing.append(parent)
        parent = parent.parent
    for parent in reversed(missing):
        parent.mkdir(exist_ok=True)
        new_parents.append(parent)


def _remove_empty(*folders: Path) -> None:
    for folder in folders:
        with suppress(OSError):  # another run's are in it
            folder.rmdir()


def _not_writable(path: Path, error: OSError) -> InputError:
    return InputError(f"cannot write to {path} ({error.strerror or error}); give a place that you can write to")
