"""A worker process ends when the process that started it is gone, also where that one was killed."""

import os
import signal
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager

from sysid.base.leftovers import began_at

EVERY = 0.5  # [s]
_watched: set[int] = set()


def end_with(parent: int) -> None:
    """End this process soon after `parent`, the number of the process that started it, is gone, and not by Ctrl-C.

    A thread looks, because the signal that Linux can send comes when the thread ends that started the worker, and a
    pool of workers outlives such a thread.
    """
    if os.name != "posix" or os.getpid() == parent or parent in _watched:
        return
    _watched.add(parent)
    if threading.current_thread() is threading.main_thread():
        signal.signal(signal.SIGINT, signal.SIG_IGN)  # of one that joblib replaces too
    threading.Thread(target=_watch, args=(parent,), name="parent", daemon=True).start()


def _watch(parent: int) -> None:
    direct = os.getppid() == parent  # else it is gone already, or started this one through another process
    while os.getppid() == parent if direct else _runs(parent):
        time.sleep(EVERY)
    os._exit(1)


def _runs(process: int) -> bool:
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return False
    except OSError:  # somebody else's
        pass
    return began_at(process) != -1


@contextmanager
def interrupts_wait() -> Iterator[None]:
    """Processes that start within it never get Ctrl-C, which a terminal sends to them too: their parent ends them.

    An interrupt of this process waits until the end.
    """
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    _trackers()
    former = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, former)


def _trackers() -> None:
    """Starts the two processes that keep account of what workers share, before the workers that would start them.

    Up to Python 3.12 its own one lets interrupts through again as it starts. A closed terminal would end both, and what
    they no longer know is told by tracebacks: they ignore it.
    """
    from multiprocessing import resource_tracker

    from joblib.externals.loky.backend import resource_tracker as of_joblib

    main = threading.current_thread() is threading.main_thread()
    former = signal.signal(signal.SIGHUP, signal.SIG_IGN) if main else None
    try:
        resource_tracker.ensure_running()
        of_joblib.ensure_running()
    finally:
        if main:
            signal.signal(signal.SIGHUP, former)
