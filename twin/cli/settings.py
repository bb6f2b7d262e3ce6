"""What the machine's own settings may not do to a verb: limits, and variables that libraries die of."""

import logging
import os
import re
import sys
import threading
import warnings
from collections.abc import Iterator
from contextlib import contextmanager

LEAST = 2048  # [MiB] of address space; below it a library's own threads cannot start, and it aborts or waits for ever
THREADS = 8  # that a small machine's libraries start
EPOCH = "SOURCE_DATE_EPOCH"  # NumPy takes it for a number while it loads
# MuJoCo reads the first while it loads; what draws the robot is a process of its own, which gets its own value. The
# second is for who tests a library: no result may die of a warning, in a worker neither.
CHANGED = {"MUJOCO_GL": "disable", "PYTHONWARNINGS": "default"}
# The libraries end in an error or abort where these are anything else; a verb then runs without them.
COUNT, SWITCH = r"[1-9]\d{0,2}", r"[01]"
UNDERSTOOD = {
    EPOCH: r"\d{1,12}",
    "NUMBA_NUM_THREADS": COUNT,
    "POLARS_MAX_THREADS": COUNT,
    "LOKY_MAX_CPU_COUNT": COUNT,
    "LOKY_MAX_DEPTH": COUNT,
    "JOBLIB_MULTIPROCESSING": SWITCH,
    "JOBLIB_START_METHOD": "fork|forkserver|spawn",
    "NUMBA_CPU_FEATURES": r"([+-][\w.-]+(,[+-][\w.-]+)*)?",
    "NUMBA_OPT": "[0-3]|max",
}
_QUIET = (DeprecationWarning, PendingDeprecationWarning, ImportWarning, ResourceWarning)  # as Python itself has it


@contextmanager
def within_reason() -> Iterator[None]:
    """A verb runs within it; variables and filters of warnings are as before when it ends."""
    former = {name: os.environ[name] for name in CHANGED if name in os.environ}
    os.environ.update({name: CHANGED[name] for name in former})
    for name, pattern in UNDERSTOOD.items():
        if not re.fullmatch(pattern, os.environ.get(name, ""), re.ASCII) and name in os.environ:
            former[name] = os.environ.pop(name)
    # Where a disk is full it says so in its own words, and reads the fonts again the next time.
    logging.getLogger("matplotlib.font_manager").setLevel(logging.ERROR)
    try:
        with warnings.catch_warnings():
            if any(option.partition(":")[0].startswith("e") for option in sys.warnoptions):
                warnings.simplefilter("default")
                for category in _QUIET:
                    warnings.simplefilter("ignore", category)
            yield
    finally:
        os.environ.update(former)


def no_room() -> str:
    """A sentence where this process may not have the address space that the libraries reserve; else nothing."""
    try:
        import resource
    except ImportError:  # Windows has no such limit
        return ""
    soft, _ = resource.getrlimit(resource.RLIMIT_AS)
    if soft == resource.RLIM_INFINITY or soft >= LEAST << 20:
        return ""
    return (
        f"this process may have {soft >> 20} MiB of address space and needs {LEAST} MiB, most of which stays unused; "
        f"give it more with: ulimit -v {LEAST << 10}"
    )


def no_threads() -> str:
    """A sentence where this process may not start the threads that the libraries start; else nothing.

    OpenBLAS would say so in lines of its own and then interrupt the process, as if a person had.
    """
    over = threading.Event()
    started = []
    try:
        for _ in range(THREADS):
            started.append(threading.Thread(target=over.wait, daemon=True))
            started[-1].start()
    except RuntimeError:
        return (
            f"this process may start {len(started) - 1} threads and needs {THREADS}; end other programs of this user, "
            "or raise the limit of processes, see ulimit -u"
        )
    finally:
        over.set()
        for thread in started:
            if thread.ident is not None:
                thread.join()
    return ""
