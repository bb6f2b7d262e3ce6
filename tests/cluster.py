"""A Dask cluster of processes on this machine."""

import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path


@contextmanager
def cluster(folder: Path, count: int = 2) -> Iterator[tuple[str, list[subprocess.Popen]]]:
    """A scheduler and `count` workers, each a process of its own: (address, worker processes)."""
    quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL, "cwd": folder}
    where = folder / "scheduler.json"
    scheduler = [sys.executable, "-m", "distributed.cli.dask_scheduler", "--host", "127.0.0.1", "--port", "0"]
    worker = [sys.executable, "-m", "distributed.cli.dask_worker", "--scheduler-file", str(where)]
    begun = [subprocess.Popen([*scheduler, "--no-dashboard", "--scheduler-file", str(where)], **quiet)]
    begun += [
        subprocess.Popen([*worker, "--nthreads", "1", "--no-dashboard", "--no-nanny"], **quiet) for _ in range(count)
    ]
    try:
        yield _address(where), begun[1:]
    finally:
        for process in begun:
            process.kill()
            process.wait()


def _address(where: Path) -> str:
    """The scheduler's address, as soon as it has written it."""
    import json
    import time

    for _ in range(600):
        try:
            return json.loads(where.read_text())["address"]
        except (OSError, ValueError):
            time.sleep(0.1)
    raise TimeoutError("the scheduler did not begin")
