"""Many cases in one process each, which a crash, a hang or a lack of memory ends without ending the count.

A worker is a fork of the process that has loaded everything; it tells its cases through a pipe. Where it dies, the case
that it was at has failed, and a fresh fork goes on with the next one. The limit of a case is processor time, so that a
busy machine makes no hangs; a case that waits instead is ended after a longer time on the clock.
"""

import json
import os
import resource
import shutil
import signal
import tempfile
import traceback
import warnings
from collections.abc import Iterator
from pathlib import Path
from typing import Protocol

import numpy as np

from fuzz.tally import KEPT, Tally
from sysid.base.errors import InputError

SECONDS = 2.0  # of processor time for a case
WAITING = 30.0  # [s] on the clock
MEMORY = 8 << 30  # bytes of addresses: an allocation above it is a MemoryError
BEGAN = "began"
PASSED = ("same", "read", "refused")


class WrongError(AssertionError):
    """A case that failed: its text begins with the kind of failure."""


class Target(Protocol):
    """What is fuzzed. `seconds` is the limit of a case."""

    name: str
    seconds: float

    def ready(self) -> None:
        """Loads and compiles what every case needs, once before the forks; it starts no thread."""
        ...

    def case(self, rng: np.random.Generator, folder: Path) -> str:
        """Writes damaged files into `folder` and reads them; "same", "read" or "refused", else it raises."""
        ...


def run(target: Target, cases: range, seed: int, keep: Path | None = None) -> Tally:
    """Runs the cases of these numbers; each depends on its number and the seed alone."""
    tally = Tally()
    target.ready()
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch)
        while len(cases):
            for k, kind, said in _forked(target, cases, seed, folder):
                tally.case(kind, [] if kind in PASSED else [(kind, f"case {k}: {said}")])
                if kind not in PASSED and keep is not None and tally.kinds[kind] <= KEPT:
                    shutil.copytree(folder / "case", keep / f"{k}", dirs_exist_ok=True)
                cases = range(k + 1, cases.stop)
    return tally


def _forked(target: Target, cases: range, seed: int, folder: Path) -> Iterator[tuple[int, str, str]]:
    """What one worker tells until it ends: its death, if it did not end by itself, is told as a case of its own."""
    ours, theirs = os.pipe()
    pid = os.fork()
    if pid == 0:
        os.close(ours)
        try:
            _work(target, cases, seed, folder, theirs)
        finally:
            os._exit(0)
    os.close(theirs)
    at = None
    with os.fdopen(ours, encoding="utf-8") as lines:
        for line in lines:
            k, kind, said = json.loads(line)
            at = k if kind == BEGAN else None
            if at is None:
                yield k, kind, said
    _, status = os.waitpid(pid, 0)
    if at is not None:
        number = os.waitstatus_to_exitcode(status)
        name = signal.Signals(-number).name if number < 0 else f"exit {number}"
        yield at, "hang" if name in ("SIGPROF", "SIGALRM") else f"signal {name}", name


def _work(target: Target, cases: range, seed: int, folder: Path, out: int) -> None:
    """The cases, in a process of their own."""
    resource.setrlimit(resource.RLIMIT_AS, (MEMORY, resource.RLIM_INFINITY))
    nothing = os.open(os.devnull, os.O_RDWR)
    os.dup2(nothing, 1)
    os.dup2(nothing, 2)
    warnings.simplefilter("error")
    for k in cases:
        place = folder / "case"
        shutil.rmtree(place, ignore_errors=True)
        place.mkdir()
        _tell(out, k, BEGAN, "")
        signal.setitimer(signal.ITIMER_PROF, target.seconds)
        signal.setitimer(signal.ITIMER_REAL, max(WAITING, 4 * target.seconds))
        kind, said = one(target, k, seed, place)
        signal.setitimer(signal.ITIMER_PROF, 0.0)
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        _tell(out, k, kind, said)
        if kind not in PASSED:
            return  # its files stay until they are copied, and a fresh fork goes on


def _tell(out: int, k: int, kind: str, said: str) -> None:
    os.write(out, (json.dumps([k, kind, said[:600]]) + "\n").encode())


def one(target: Target, k: int, seed: int, place: Path) -> tuple[str, str]:
    """How case k ends in this process."""
    rng = np.random.default_rng([seed, k, *target.name.encode()])
    try:
        return target.case(rng, place), ""
    except WrongError as error:
        return str(error).partition(":")[0], str(error)
    except InputError as error:
        return sentence(str(error)), str(error)
    except Warning as error:
        return f"warning {type(error).__name__}", _last(error)
    except BaseException as error:
        return f"untyped {type(error).__name__}", _last(error)


def sentence(said: str) -> str:
    """Whether a refusal is one that a person can read."""
    if not said.strip() or len(said) > 3000 or "Traceback" in said:
        return "no sentence"
    return "refused"


def _last(error: BaseException) -> str:
    """The error, and the lines of the program that led to it."""
    frames = [frame for frame in traceback.extract_tb(error.__traceback__) if "/tests/" not in frame.filename]
    where = " < ".join(f"{Path(frame.filename).name}:{frame.lineno}" for frame in reversed(frames[-6:]))
    return f"{str(error)[:200]} at {where}"
