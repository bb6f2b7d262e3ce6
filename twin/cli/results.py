"""The scratch folder of a run, beside the folder that it becomes: in one step, or not at all.

It lies there as `.NAME.<mark>.part`, see `sysid.base.locks`, and as `.NAME.<mark>.ready` while its files replace
those of an existing folder: a run that is killed just then is finished by the next one that writes in that place.
"""

import json
import os
import shutil
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from sysid.base import locks
from sysid.base.errors import InputError
from twin.cli.stopping import hold_requests

PART, CLAIMED, READY, OLD = ".part", locks.CLAIMED, locks.READY, ".old.part"
_written: list[str] = []


def begin() -> None:
    """A run begins, which has written nothing."""
    _written.clear()


def note_result(path: Path | str) -> None:
    """A result stands at `path`."""
    _written.append(str(path))


def is_written() -> bool:
    """Whether a result stands."""
    return bool(_written)


def outcome() -> str:
    """What a run that ends early has left, in words."""
    return f"its results are whole, in {' and '.join(_written)}" if _written else "nothing was written"


class Busy(InputError):  # noqa: N818 - reads as what it says
    """Another run is writing to the same folder."""


def reserve(folder: Path, claimed: bool) -> Path:
    """A new scratch folder for `folder`; what killed runs left in that place goes first, or becomes what it was to be.

    `claimed`: `folder` is made too, for this run alone. Raises Busy if another run is writing to the same folder,
    FileExistsError if the folder to claim is there, and OSError if nothing can be made in that place.
    """
    scratch = locks.temporary_name(folder, CLAIMED if claimed else PART)
    with _exclusive(folder.parent):
        tidy(folder.parent)
        for name in os.listdir(folder.parent):
            match = locks.MARKED_NAME.search(name)
            if match and name[: match.start()] == f".{folder.name}-" and name.endswith((PART, READY)):
                raise Busy(
                    f"another run (process {match['process']}) is writing to {folder}; wait for its end, or give "
                    "another --out"
                )
        scratch.mkdir()
        try:
            if claimed:
                folder.mkdir()
        except OSError:
            scratch.rmdir()
            raise
    return scratch


def tidy(place: Path) -> None:
    """Finish what killed runs were moving within `place`, and remove what else they left."""
    for name in os.listdir(place):
        match = locks.MARKED_NAME.search(name)
        if match is None or locks.is_in_use(name) is not False:
            continue
        folder = place / name[1 : match.start() - 1]
        if name.endswith(READY) and folder.is_dir():
            with suppress(OSError):
                _place_all(place / name, folder, None)
            shutil.rmtree(place / name, ignore_errors=True)
        elif name.endswith(CLAIMED):
            with suppress(OSError):  # its own folder, which it had made only to have the name
                folder.rmdir()
            locks.remove(place / name)
    locks.sweep(place)


def move(scratch: Path, folder: Path, claimed: bool) -> list[str]:
    """`scratch` becomes `folder`, whole: where that fails, `folder` is as it was. A request to stop waits for the end.

    Of an existing folder, files of the same name are replaced and the others stay. Returns the names of those that were
    replaced and that no former run of this program had made, as far as its summary tells. Raises OSError.
    """
    with hold_requests():
        foreign = [] if _is_result(folder) else _common_files(scratch, folder)
        if claimed:
            with suppress(OSError):  # Windows renames onto no folder, not even an empty one
                os.rename(scratch, folder)
        elif not folder.exists():
            os.rename(scratch, folder)
        if scratch.exists():
            _check(scratch, folder)
            ready, old = scratch.with_suffix(READY), scratch.with_suffix(OLD)
            old.mkdir()
            os.rename(scratch, ready)
            try:
                _place_all(ready, folder, old)
            except BaseException:
                os.rename(ready, scratch)
                raise
            finally:
                shutil.rmtree(old, ignore_errors=True)
            shutil.rmtree(ready, ignore_errors=True)
        note_result(folder)
    return foreign


def _is_result(folder: Path) -> bool:
    """Whether the folder has the summary of a run, which says by which version of the program it was made."""
    try:
        summary = json.loads((folder / "summary.json").read_bytes())
    except (OSError, ValueError, RecursionError):
        return False
    versions = summary.get("versions") if isinstance(summary, dict) else None
    return isinstance(versions, dict) and "qpal" in versions


def _common_files(scratch: Path, folder: Path) -> list[str]:
    """Files of `scratch` whose names `folder` has too."""
    files = (path.relative_to(scratch) for path in sorted(scratch.rglob("*")) if path.is_file())
    return [str(name) for name in files if (folder / name).is_file()]


def _check(scratch: Path, folder: Path) -> None:
    """Raises OSError, before anything has moved, where a file would have to replace a folder or a folder a file."""
    for source in scratch.rglob("*"):
        target = folder / source.relative_to(scratch)
        if source.is_dir() and target.exists() and not target.is_dir():
            raise NotADirectoryError(0, f"it has a file {source.relative_to(scratch)}, where a folder is to go")
        if not source.is_dir() and target.is_dir():
            raise IsADirectoryError(0, f"it has a folder {source.relative_to(scratch)}, where a file is to go")


def _place_all(source: Path, folder: Path, old: Path | None) -> None:
    """Every file of `source` into `folder`; those that it replaces are in `old`, from where a failure brings them back.

    Without `old` a failure leaves what has been placed.
    """
    new_folders: list[Path] = []
    placements: list[tuple[Path, Path, Path | None]] = []
    try:
        for file in sorted(path for path in source.rglob("*") if path.is_file()):
            target = folder / file.relative_to(source)
            for parent in reversed([p for p in target.parents if not p.exists()]):
                parent.mkdir()
                new_folders.append(parent)
            former = None
            if old is not None and target.exists():
                former = old / str(len(placements))
                _second(target, former)
            os.replace(file, target)
            placements.append((file, target, former))
    except BaseException:
        for file, target, former in reversed(placements if old is not None else []):
            os.replace(target, file)
            if former is not None:
                os.replace(former, target)
        for parent in reversed(new_folders):
            with suppress(OSError):
                parent.rmdir()
        raise


def _second(file: Path, name: Path) -> None:
    """The same file under a second name, or its copy on a file system without links."""
    try:
        os.link(file, name)
    except OSError:
        shutil.copy2(file, name)


def _lock(handle: int) -> None:
    """Lock an open folder, unless another program holds it for seconds."""
    import fcntl

    for _ in range(200):
        try:
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            time.sleep(0.02)
        except OSError:  # a file system without locks
            return
        else:
            return


@contextmanager
def _exclusive(place: Path) -> Iterator[None]:
    """No other process is within this at the same time, for the same folder, on a system that can lock a folder."""
    handle = os.open(place, os.O_RDONLY) if os.name == "posix" else None
    try:
        if handle is not None:
            _lock(handle)
        yield
    finally:
        if handle is not None:
            os.close(handle)
