"""Room on the disk for a log, before the rig moves: a record cannot be made again."""

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from sysid.base.errors import InputError
from sysid.base.locks import temporary_name

LINE = 120  # [bytes] a row of a log takes at the most


@contextmanager
def room_for(path: Path, size: int) -> Iterator[None]:
    """Room for a file of `size` bytes beside `path`, held while the rig moves. Raises InputError for none."""
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
