"""The border of the benchmark: whatever a method does or gives back, what passes is a checked `Outcome`.

A method of somebody else may raise anything, also no Exception, and give back anything, also objects whose attributes
raise. Here its name is read, it is called with copies, what it prints goes nowhere, and its answer is checked by the
contract (`sysid.bench.contract`). Behind the border, a status is a sentence and every number is one.
"""

import contextlib
import os
import time
from collections.abc import Mapping
from typing import Any

import numpy as np

from sysid.base.errors import InputError
from sysid.bench.contract import PASSED, checked_details, checked_run, kind_of, number, text_of
from sysid.bench.method import Method, Outcome, Stopped, Tests
from sysid.bench.task import Task


def name_of(method: Method) -> str:
    """The name of a method in the table; that of its type if it has none."""
    with contextlib.suppress(BaseException):
        if isinstance(method.name, str) and method.name:
            return text_of(method.name)
    return type(method).__name__


def answer(method: Method, task: Task, tests: Tests, seconds: float, seed: int) -> Outcome:
    """What a method gives on a task, or a sentence in `status`; only a person's Ctrl-C is raised."""
    begin = time.perf_counter()
    try:
        with _aside():
            given = method.solve(task, {name: (u.copy(), y.copy()) for name, (u, y) in tests.items()}, seconds, seed)
            return checked(given, {name: len(u) for name, (u, _) in tests.items()})
    except PASSED:
        raise
    except BaseException as error:
        return Outcome(failure(error), seconds=time.perf_counter() - begin)


def checked(given: Any, lengths: Mapping[str, int]) -> Outcome:
    """An outcome whose runs are (N,) by test of `lengths` and whose every other value is of its type.

    Raises ValueError for runs that are not, and whatever the attributes of `given` raise.
    """
    if not isinstance(given, Outcome):
        raise ValueError(f"solve gave {kind_of(given)}, no Outcome")
    if not isinstance(given.status, str) or not text_of(given.status):
        raise ValueError(f"its status is {kind_of(given.status)}; it must be ok or a sentence")
    status, details = text_of(given.status), checked_details(given.details)
    measured = [number(value) for value in (given.seconds, given.memory)]
    seconds, memory = (value if value >= 0.0 else float("nan") for value in measured)
    version = text_of(given.version) if isinstance(given.version, str) else ""
    if status != "ok":
        status = status if status.startswith(SAID) else f"crashed: {status}"
        return Outcome(status, {}, details, seconds, memory, version)
    if not isinstance(given.runs, Mapping):
        raise ValueError(f"its runs are {kind_of(given.runs)}; it must be a dictionary by test")
    missing = [name for name in lengths if name not in given.runs]
    if missing:
        raise ValueError(f"it has no run on the test {missing[0]}")
    runs = {name: checked_run(given.runs[name], N) for name, N in lengths.items()}
    return Outcome(status, runs, details, seconds, memory, version)


SAID = ("refused", "stopped", "crashed", "no data", "not installed")  # how a sentence of a status begins


def failure(error: BaseException) -> str:
    """The status of a method that raised."""
    if isinstance(error, Stopped):
        return f"stopped after {error.seconds:.0f} s"
    if isinstance(error, InputError):
        return text_of(f"refused: {error}")
    return text_of(f"crashed: {text_of(error)}")


@contextlib.contextmanager
def _aside() -> Any:
    """What a method prints, warns of and changes of the process stays with it."""
    import warnings

    with (
        open(os.devnull, "w", encoding="utf-8") as nowhere,
        contextlib.redirect_stdout(nowhere),
        contextlib.redirect_stderr(nowhere),
        contextlib.chdir(os.getcwd()),
        np.errstate(),
        warnings.catch_warnings(),
    ):
        warnings.simplefilter("ignore")
        yield
