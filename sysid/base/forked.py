"""Where polars may not be used: in a process that was forked after polars' threads began.

A fork has the memory of its parent and one thread of it. polars then hands its work to threads that are not there, and
waits for ever. Linux forks the processes of `multiprocessing` up to Python 3.13.
"""

import os
import re
from contextlib import suppress

from sysid.base.errors import InputError

_THREAD = re.compile(rb"polars-\d")  # they begin with polars' first work, not with its import
_begun = False  # by this library, in this process or in one that it was forked from
_lost = False


def check() -> None:
    """To be called before polars works. Raises InputError where it would wait for threads that are lost."""
    global _begun
    if _lost:
        raise InputError(
            "a table cannot be read or written here: this process was forked after its parent had used polars, whose "
            "threads a fork loses; start processes with multiprocessing.get_context('spawn') (of ProcessPoolExecutor "
            "the argument mp_context)"
        )
    _begun = True


def note() -> None:
    """To be called before a fork where polars is loaded; `sysid` itself does."""
    global _begun
    _begun = _begun or _has_threads()


def _in_child() -> None:
    global _lost
    _lost = _begun


def _has_threads() -> bool:
    """Whether polars has threads in this process; where the system does not tell, it is said to have them."""
    try:
        tasks = os.listdir("/proc/self/task")
    except OSError:
        return True
    for task in tasks:
        with suppress(OSError), open(f"/proc/self/task/{task}/comm", "rb") as name:  # another one may just have ended
            if _THREAD.match(name.read()):
                return True
    return False


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_in_child)
