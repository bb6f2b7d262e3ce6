"""What outlasts a stop of `qpal rig`: logs of experiments, and room on the disk for a log."""

import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from sysid.base.errors import InputError
from twin.cli.console import Interruption
from twin.cli.stopping import hold_requests

if TYPE_CHECKING:
    from twin.log import Log


@contextmanager
def kept_logs(folder: Path, scratch: Path) -> "Iterator[Callable[[int, Log], None]]":
    """A function that writes the log of an experiment at once, where it stays if the verb is stopped, even killed.

    The logs are in NAME-logs beside `folder`; they move into `scratch` when all is done. Raises InputError where such a
    folder has logs already.
    """
    place = folder.with_name(f"{folder.name}-logs")
    if place.exists():
        raise InputError(f"{place} has the logs of a run that was stopped; move it, or give another --out")

    def keep(number: int, log: "Log") -> None:
        with hold_requests():
            place.mkdir(parents=True, exist_ok=True)
            log.save(place / f"experiment-{number}.csv")

    try:
        yield keep
    except KeyboardInterrupt:
        if not place.exists():
            raise
        raise Interruption(f"the drive is off; the logs are in {place}") from None
    except InputError as error:
        raise error if not place.exists() else InputError(f"{error}; the logs are in {place}") from None
    with hold_requests():
        for path in sorted(place.glob("*")):
            path.rename(scratch / path.name)
        if place.exists():
            place.rmdir()


@contextmanager
def room_for(path: Path, size: int) -> Iterator[None]:
    """Room on the disk for a file of `size` bytes beside `path`, held while the rig moves."""
    from sysid.base.locks import temporary_name

    held = temporary_name(path)
    try:
        with held.open("wb") as file:
            if hasattr(os, "posix_fallocate"):
                os.posix_fallocate(file.fileno(), 0, size)
    except OSError as error:
        held.unlink(missing_ok=True)
        raise InputError(
            f"{path}: no room for the log of about {size / 1e6:.1f} MB ({error.strerror}); nothing was moved"
        ) from None
    try:
        yield
    finally:
        held.unlink(missing_ok=True)
