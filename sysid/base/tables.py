"""Tables by polars: where it may work, and Parquet files of which a damaged one is an ordinary exception.

A fork has the memory of its parent and one thread of it. polars then hands its work to threads that are not there, and
waits for ever. Linux forks the processes of `multiprocessing` up to Python 3.13.
"""

import os
import re
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING

from sysid.base.errors import InputError

if TYPE_CHECKING:
    import polars

_THREAD_NAME = re.compile(rb"polars-\d")  # they begin with polars' first work, not with its import
_polars_has_begun = False  # by this library, in this process or in one that it was forked from
_threads_are_lost = False


def check_fork() -> None:
    """To be called before polars works. Raises InputError where it would wait for threads that are lost."""
    global _polars_has_begun
    if _threads_are_lost:
        raise InputError(
            "a table cannot be read or written here: this process was forked after its parent had used polars, whose "
            "threads a fork loses; start processes with multiprocessing.get_context('spawn') (of ProcessPoolExecutor "
            "the argument mp_context)"
        )
    _polars_has_begun = True


def note_fork() -> None:
    """To be called before a fork where polars is loaded; `sysid` itself does."""
    global _polars_has_begun
    _polars_has_begun = _polars_has_begun or _has_polars_threads()


def _mark_child() -> None:
    global _threads_are_lost
    _threads_are_lost = _polars_has_begun


def _has_polars_threads() -> bool:
    """Whether polars has threads in this process; where the system does not tell, it is said to have them."""
    try:
        tasks = os.listdir("/proc/self/task")
    except OSError:
        return True
    for task in tasks:
        with suppress(OSError), open(f"/proc/self/task/{task}/comm", "rb") as name:  # another one may just have ended
            if _THREAD_NAME.match(name.read()):
                return True
    return False


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_mark_child)


class DamagedError(ValueError):
    """Its text is what polars said."""


def read_parquet(path: Path, columns: list[str] | None = None) -> "polars.DataFrame":
    """The table, or some columns of it. Raises DamagedError, and OSError where the file cannot be opened.

    polars has an exception class of its own for each way of being damaged; a panic of its core is no Exception.
    """
    import polars

    check_fork()
    try:
        with _suppress_panic_text():
            return polars.read_parquet(
                path.absolute(), columns=columns, glob=False
            )  # a name may hold [ or *, or begin with ~
    except (OSError, MemoryError):
        raise
    except (Exception, polars.exceptions.PanicException) as error:
        lines = str(error).strip().splitlines() or [""]
        raise DamagedError(f"{type(error).__name__}: {lines[0][:200]}") from None


@contextmanager
def _suppress_panic_text() -> Iterator[None]:
    """Keeps from the terminal what polars' core prints of its own when a damaged file makes it panic."""
    try:
        stderr = os.dup(2)
    except OSError:  # a process without a standard error
        yield
        return
    with tempfile.TemporaryFile() as sink:
        os.dup2(sink.fileno(), 2)
        try:
            yield
        finally:
            os.dup2(stderr, 2)
            os.close(stderr)
