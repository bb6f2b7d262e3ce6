"""The one executor: independent jobs on local cores by joblib, or on a Dask cluster by its scheduler's address."""

import os
import warnings
from collections.abc import Callable, Iterator, Sequence
from time import monotonic, sleep
from typing import TYPE_CHECKING, Any, TypeVar

from sysid.base.errors import InputError
from sysid.base.modules import facades_by_name
from sysid.base.parents import end_with, interrupts_wait
from sysid.base.threads import available

if TYPE_CHECKING:
    from distributed import Client

J = TypeVar("J")
R = TypeVar("R")

RETRIES = 3  # of a job whose Dask worker was lost
PATIENCE = 60.0  # [s] for a Dask cluster without workers


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
    facades_by_name()
    if scheduler is not None:
        return _on_cluster(function, jobs, scheduler)
    count = min(workers or available(), max(len(jobs), 1))
    return _here(function, jobs) if count == 1 else _on_cores(function, jobs, count)


def in_order(
    function: Callable[[J], R], jobs: Sequence[J], workers: int | None = None, scheduler: str | None = None
) -> list[R]:
    """All results in the order of the jobs."""
    found = dict(results(function, jobs, workers, scheduler))
    return [found[k] for k in range(len(jobs))]


def _here(function: Callable[[J], R], jobs: Sequence[J]) -> Iterator[tuple[int, R]]:
    for k, job in enumerate(jobs):
        yield k, function(job)


def _on_cores(function: Callable[[J], R], jobs: Sequence[J], count: int) -> Iterator[tuple[int, R]]:
    from joblib import Parallel, delayed

    # joblib replaces a worker that has grown, and warns of it in its own thread. Where warnings are errors, this thread
    # would end there and the results would never come.
    warnings.filterwarnings("ignore", "A worker stopped while some jobs were given", UserWarning)
    tasks = (delayed(_numbered)(function, k, job) for k, job in enumerate(jobs))
    with interrupts_wait():
        found = Parallel(n_jobs=count, return_as="generator_unordered", initializer=end_with, initargs=(os.getpid(),))(
            tasks
        )
    yield from found


def _numbered(function: Callable[[Any], R], k: int, job: Any) -> tuple[int, R]:
    return k, function(job)


def _on_cluster(function: Callable[[J], R], jobs: Sequence[J], address: str) -> Iterator[tuple[int, R]]:
    try:
        from distributed import Client, as_completed
    except ImportError:
        raise InputError('a scheduler needs Dask, which is not installed; run: pip install "qpal[cluster]"') from None
    try:
        client = Client(address, timeout="10s")
    except (OSError, ValueError) as error:
        raise InputError(f"there is no Dask scheduler at {address} ({error}); start one with: dask scheduler") from None
    with client:
        _await_worker(client, address)
        futures = {client.submit(function, job, pure=False, retries=RETRIES): k for k, job in enumerate(jobs)}
        done = as_completed(futures)
        checked = monotonic()
        while done.count():
            for future in done.next_batch(block=False):
                yield futures[future], _result(future, address)
                future.release()
            if monotonic() - checked > PATIENCE:  # a job without workers waits forever
                _await_worker(client, address)
                checked = monotonic()
            sleep(0.0 if done.has_ready() else 0.02)


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
