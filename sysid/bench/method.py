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

from sysid.base.errors import InputError
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
    """A row of the leaderboard: `solve` never raises, it says in `status` what went wrong."""

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
        """See `Method`. Stopped at `LIMIT` times the budget."""
        data, details, began = task.data(seconds, seed), dict[str, Any](), time.perf_counter()
        took, top = float("nan"), float("nan")
        try:
            with one_blas_thread(), _time_limit(LIMIT * seconds):
                start_peak()
                model = self._call_fit(data, task)
                took, top = time.perf_counter() - began, peak()
                details = details_of(model)
                runs = {name: check_run(model.simulate(u, first), len(u)) for name, (u, first) in tests.items()}
        except TimeoutError:
            return Outcome(f"stopped after {LIMIT * seconds:.0f} s", seconds=time.perf_counter() - began)
        except InputError as error:
            return Outcome(f"refused: {error}", details=details, seconds=time.perf_counter() - began)
        except Exception as error:  # a method of somebody else may raise anything, and its row must say so
            return Outcome(f"crashed: {type(error).__name__}: {error}"[:300], seconds=time.perf_counter() - began)
        return Outcome("ok", runs, details, took, top, _version(self.package))

    def _call_fit(self, data: Data, task: Task) -> Model:
        return self.fit(data, task) if self.sees_truth else self.fit(data)


def check_run(run: Any, N: int) -> np.ndarray:
    """The run as (N,) of floats. Raises ValueError for another length."""
    out = np.asarray(run, dtype=float).ravel()
    if len(out) != N:
        raise ValueError(f"simulate gave {len(out)} samples for {N}")
    return out


def _version(package: str) -> str:
    try:
        return version(package)
    except PackageNotFoundError:
        return ""


@contextmanager
def _time_limit(seconds: float) -> Iterator[None]:
    """Raises TimeoutError in the block after `seconds`; without a limit off the main thread, where no signal comes."""
    if threading.current_thread() is not threading.main_thread() or not hasattr(signal, "setitimer"):
        yield
        return

    def stop(*_: object) -> None:
        raise TimeoutError

    previous = signal.signal(signal.SIGALRM, stop)
    signal.setitimer(signal.ITIMER_REAL, seconds)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, previous)
