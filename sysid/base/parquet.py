"""Parquet files as polars reads them, where a damaged one is an ordinary exception."""

import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from sysid.base import forked

if TYPE_CHECKING:
    import polars


class DamagedError(ValueError):
    """Its text is what polars said."""


def read(path: Path, columns: list[str] | None = None) -> "polars.DataFrame":
    """The table, or some columns of it. Raises DamagedError, and OSError where the file cannot be opened.

    polars has an exception class of its own for each way of being damaged; a panic of its core is no Exception.
    """
    import polars

    forked.check()
    try:
        with _panics_unprinted():
            return polars.read_parquet(
                path.absolute(), columns=columns, glob=False
            )  # a name may hold [ or *, or begin with ~
    except (OSError, MemoryError):
        raise
    except (Exception, polars.exceptions.PanicException) as error:
        said = str(error).strip().splitlines() or [""]
        raise DamagedError(f"{type(error).__name__}: {said[0][:200]}") from None


@contextmanager
def _panics_unprinted() -> Iterator[None]:
    """Keeps from the terminal what polars' core prints of its own when a damaged file makes it panic."""
    try:
        own = os.dup(2)
    except OSError:  # a process without a standard error
        yield
        return
    with tempfile.TemporaryFile() as said:
        os.dup2(said.fileno(), 2)
        try:
            yield
        finally:
            os.dup2(own, 2)
            os.close(own)
