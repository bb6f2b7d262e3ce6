"""Work on several cores: the executor of independent jobs, workers that end with their parent, one BLAS thread.

Jobs run on local cores by joblib, or on a Dask cluster by its scheduler's address. A worker process ends when the
process that started it is gone, also where that one was killed.
"""

import copyreg
import importlib
import os
import signal
import sys
import threading
import time
import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from functools import cache
from types import ModuleType
from typing import TYPE_CHECKING, Any, TypeVar

from threadpoolctl import ThreadpoolController

from sysid.base.errors import InputError
from sysid.base.locks import start_ticks

if TYPE_CHECKING:
    from distributed import Client

J = TypeVar("J")
R = TypeVar("R")

RETRIES = 3  # of a job whose Dask worker was lost
PATIENCE = 60.0  # [s] for a Dask cluster without workers
GREETING = 10.0  # [s] for an answer of its scheduler
FACADES = ("sysid", "twin")
WATCH_INTERVAL = 0.5  # [s]
_watched: set[int] = set()
_depth_lock = threading.RLock()
_depth = 0
_limits: list = []


def results(
    function: Callable[[J], R], jobs: Sequence[J], workers: int | None = None, scheduler: str | None = None
) -> Iterator[tuple[int, R]]:
    """(index of the job, function(job)) in the order in which they end.

    `workers` are local processes, as many as there are cores if None; one runs the jobs here. `scheduler` is the
    address of a Dask scheduler, for example tcp://10.0.0.1:8786, whose workers have qpal installed; a job whose worker
    is lost runs again on another. An exception of a job ends the iteration. Raises InputError if there is no Dask, no
    scheduler at the address, no worker of it for a minute, or no positive number of workers.
    """
    if workers is not None and workers < 1:
        raise InputError(f"workers is {workers}; give a number of 1 or more")
    pickle_facades_by_name()
    if scheduler is not None:
        return _on_cluster(function, jobs, scheduler)
    count = min(workers or available_cores(), max(len(jobs), 1))
    return _on_one_core(function, jobs) if count == 1 else _on_cores(function, jobs, count)


def in_order(
    function: Callable[[J], R], jobs: Sequence[J], workers: int | None = None, scheduler: str | None = None
) -> list[R]:
    """All results in the order of the jobs."""
    outcomes = dict(results(function, jobs, workers, scheduler))
    return [outcomes[k] for k in range(len(jobs))]


def _on_one_core(function: Callable[[J], R], jobs: Sequence[J]) -> Iterator[tuple[int, R]]:
    for k, job in enumerate(jobs):
        yield k, function(job)


def _on_cores(function: Callable[[J], R], jobs: Sequence[J], count: int) -> Iterator[tuple[int, R]]:
    from joblib import Parallel, delayed

    # joblib replaces a worker that has grown, and warns of it in its own thread. Where warnings are errors, this thread
    # would end there and the results would never come.
    warnings.filterwarnings("ignore", "A worker stopped while some jobs were given", UserWarning)
    tasks = (delayed(_numbered_result)(function, k, job) for k, job in enumerate(jobs))
    with hold_interrupts():
        outcomes = Parallel(
            n_jobs=count, return_as="generator_unordered", initializer=end_with, initargs=(os.getpid(),)
        )(tasks)
    yield from outcomes


def _numbered_result(function: Callable[[Any], R], k: int, job: Any) -> tuple[int, R]:
    return k, function(job)


def _on_cluster(function: Callable[[J], R], jobs: Sequence[J], address: str) -> Iterator[tuple[int, R]]:
    try:
        from distributed import Client, as_completed
    except ImportError:
        raise InputError('a scheduler needs Dask, which is not installed; run: pip install "qpal[cluster]"') from None
    try:
        client = Client(address, timeout=GREETING)
    except (OSError, ValueError) as error:
        raise InputError(f"there is no Dask scheduler at {address} ({error}); start one with: dask scheduler") from None
    with client:
        _await_worker(client, address)
        futures = {client.submit(function, job, pure=False, retries=RETRIES): k for k, job in enumerate(jobs)}
        done = as_completed(futures)
        checked = time.monotonic()
        while done.count():
            for future in done.next_batch(block=False):
                yield futures[future], _result(future, address)
                future.release()
            if time.monotonic() - checked > PATIENCE:  # a job without workers waits forever
                _await_worker(client, address)
                checked = time.monotonic()
            time.sleep(0.0 if done.has_ready() else 0.02)


def _await_worker(client: "Client", address: str) -> None:
    """Returns as soon as the cluster has a worker; raises InputError if none comes within PATIENCE seconds."""
    try:
        client.wait_for_workers(1, timeout=PATIENCE)
    except TimeoutError:
        raise InputError(
            f"the Dask scheduler at {address} has had no worker for {PATIENCE:g} s; start one with: "
            f"dask worker {address}, and run again"
        ) from None


def _result(future: Any, address: str) -> Any:
    """The result of a job; its own exceptions pass, those of a lost cluster become a sentence."""
    from distributed.client import FutureCancelledError
    from distributed.comm.core import CommClosedError
    from distributed.scheduler import KilledWorker

    try:
        return future.result()
    except (FutureCancelledError, KilledWorker, CommClosedError) as error:
        raise InputError(
            f"the cluster at {address} lost a job ({type(error).__name__}); start its scheduler and workers and run "
            "again"
        ) from None


def pickle_facades_by_name() -> None:
    """Lets a facade be pickled as the name that it is imported by, whatever its class.

    lazy_loader from 0.6 on gives it a class of its own, which cloudpickle does not know. A function of a script whose
    globals hold the facade could then not be sent to a worker.
    """
    for module in (sys.modules[name] for name in FACADES if name in sys.modules):
        if type(module) is not ModuleType:
            copyreg.pickle(type(module), _import_by_name)


def _import_by_name(module: ModuleType) -> tuple[Callable[[str], ModuleType], tuple[str]]:
    return importlib.import_module, (module.__name__,)


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
    threading.Thread(target=_watch_parent, args=(parent,), name="parent", daemon=True).start()


def _watch_parent(parent: int) -> None:
    direct = os.getppid() == parent  # else it is gone already, or started this one through another process
    while os.getppid() == parent if direct else _is_running(parent):
        time.sleep(WATCH_INTERVAL)
    os._exit(1)


def _is_running(process: int) -> bool:
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return False
    except OSError:  # somebody else's
        pass
    return start_ticks(process) != -1


@contextmanager
def hold_interrupts() -> Iterator[None]:
    """Processes that start within it never get Ctrl-C, which a terminal sends to them too: their parent ends them.

    An interrupt of this process waits until the end.
    """
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    _start_trackers()
    former = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, former)


def _start_trackers() -> None:
    """Starts the two processes that keep account of what workers share, before the workers that would start them.

    Up to Python 3.12 its own one lets interrupts through again as it starts. A closed terminal would end both, and what
    they no longer know is told by tracebacks: they ignore it.
    """
    from multiprocessing import resource_tracker

    from joblib.externals.loky.backend import resource_tracker as joblib_tracker

    main = threading.current_thread() is threading.main_thread()
    former = signal.signal(signal.SIGHUP, signal.SIG_IGN) if main else None
    try:
        resource_tracker.ensure_running()
        joblib_tracker.ensure_running()
    finally:
        if main:
            signal.signal(signal.SIGHUP, former)


@cache
def _controller() -> ThreadpoolController:
    import scipy.linalg  # noqa: F401 - brings a BLAS of its own; one that is loaded later would not be found

    return ThreadpoolController()


@contextmanager
def one_blas_thread() -> Iterator[None]:
    """Within this context every BLAS call uses one thread; may be nested, and entered from several threads."""
    global _depth
    with _depth_lock:
        if _depth == 0:
            _limits.append(_controller().limit(limits=1, user_api="blas"))
        _depth += 1
    try:
        yield
    finally:
        with _depth_lock:
            _depth -= 1
            if _depth == 0:
                _limits.pop().restore_original_limits()


def available_cores() -> int:
    """Cores this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
