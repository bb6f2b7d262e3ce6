"""What runs a method on a task: within this process, or in an environment of its own (`sysid.bench.isolation`)."""

import signal
import threading
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from importlib.metadata import PackageNotFoundError, version
from typing import Any, Protocol

import numpy as np

from sysid.base.parallel import one_blas_thread
from sysid.bench.contract import Data, Model, details_of, peak, start_peak
from sysid.bench.task import Task

Tests = Mapping[str, tuple[np.ndarray, np.ndarray]]  # inputs (N,) and first outputs (n,) by test
LIMIT = 3.0  # times the budget: then a method that does not end by itself is stopped


@dataclass(frozen=True)
class Outcome:
    """What a method did: "ok" or a sentence, free runs (N,) by test, optional facts, seconds, memory [MiB]."""

    status: str
    runs: Mapping[str, np.ndarray] = field(default_factory=dict)
    details: Mapping[str, Any] = field(default_factory=dict)
    seconds: float = float("nan")
    memory: float = float("nan")
    version: str = ""


class Method(Protocol):
    """A row of the leaderboard; it is called by `sysid.bench.border`, where what it raises becomes a `status`."""

    @property
    def name(self) -> str:
        """Its name in the table."""
        ...

    @property
    def about(self) -> str:
        """What it is, in a few words."""
        ...

    def solve(self, task: Task, tests: Tests, seconds: float, seed: int) -> Outcome:
        """Fit the task's record and run freely over each test, (u (N,), first outputs (n,))."""
        ...


@dataclass(frozen=True)
class FunctionMethod:
    """A method of this process: `fit(data)` of the contract, or `fit(data, task)` if it may see the truth."""

    name: str
    about: str
    fit: Callable[..., Model]
    sees_truth: bool = False
    package: str = "qpal"

    def solve(self, task: Task, tests: Tests, seconds: float, seed: int) -> Outcome:
        """See `Method`. Raises `Stopped` at `LIMIT` times the budget."""
        data = task.data(seconds, seed)
        with one_blas_thread(), _time_limit(LIMIT * seconds):
            start_peak()
            began = time.perf_counter()
            model = self._call_fit(data, task)
            took, top = time.perf_counter() - began, peak()
            runs = {name: model.simulate(u, first) for name, (u, first) in tests.items()}
        return Outcome("ok", runs, details_of(model), took, top, _version(self.package))

    def _call_fit(self, data: Data, task: Task) -> Model:
        return self.fit(data, task) if self.sees_truth else self.fit(data)


def _version(package: str) -> str:
    try:
        return version(package)
    except PackageNotFoundError:
        return ""


class Stopped(BaseException):
    """A method had `seconds` and did not end. No Exception, so that a method that takes those for a bad start ends."""

    def __init__(self, seconds: float) -> None:
        self.seconds = seconds


@contextmanager
def _time_limit(seconds: float) -> Iterator[None]:
    """Raises Stopped in the block after `seconds`; without a limit off the main thread, where no signal comes."""
    if threading.current_thread() is not threading.main_thread() or not hasattr(signal, "setitimer"):
        yield
        return

    def stop(*_: object) -> None:
        raise Stopped(seconds)

    previous = signal.signal(signal.SIGALRM, stop)
    signal.setitimer(signal.ITIMER_REAL, seconds)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, previous)
