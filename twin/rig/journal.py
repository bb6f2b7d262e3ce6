"""The samples of a run on the disk while it plays, from which a run that was killed still gets its log."""

import json
import os
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import IO, Any

import numpy as np

from sysid.base.errors import InputError
from sysid.base.files import read_limited
from sysid.base.locks import file_lock, sweep
from twin.log import Log
from twin.rig import wire
from twin.rig.calibration import Calibration, from_dict
from twin.rig.link import Link
from twin.rig.run import Early, Recording, log_of_run

END = ".journal"
MOST = 2**27  # [byte] of a journal: more than an hour of samples every ms
SYNC = 1.0  # [s]: a machine that loses its power has lost no more than this and what its disk holds back


@contextmanager
def journal(
    log: Path, link: Link, calibration: Calibration, levels: np.ndarray, Ts: float, source: str = ""
) -> Iterator[Callable[[wire.Sample], None]]:
    """A function that writes down each sample of a run of levels (N,) [duty], beside its `log`; gone at the end of the
    block, in which the log is written, unless that fails.

    The function raises `Early` where the disk is full. Raises InputError where the journal cannot be made.
    """
    path = log.with_name(log.name + END)
    head = {
        "firmware": link.identity.release,
        "port": link.port,
        "calibration": calibration.model_dump(),
        "levels": [int(level) for level in levels],
        "Ts": Ts,
        "source": source,
    }
    with file_lock(path, lambda holder: f"{holder} plays a run of {log}; give another name"):
        try:
            file = path.open("xb", buffering=0)
        except OSError as error:
            raise InputError(f"cannot write {path}: {error.strerror}; nothing was moved") from None
        writer = _Writer(file, head)
        try:
            yield writer
        except BaseException:
            if not writer.count:
                path.unlink()
            raise
        finally:
            writer.close()
        path.unlink()


class _Writer:
    """Appends a line for each sample of a run; another thread waits for the disk, so that the run does not."""

    def __init__(self, file: IO[bytes], head: dict[str, Any]) -> None:
        self._file, self._over, self.count = file, threading.Event(), 0
        self._file.write(json.dumps(head).encode() + b"\n")
        self._thread = threading.Thread(target=self._sync, name="journal", daemon=True)
        self._thread.start()

    def __call__(self, sample: wire.Sample) -> None:
        if len(sample.joints) != 1:  # at rest, all joints are read
            return
        counts, duty = sample.joints[0]
        line = f"{sample.number},{counts},{duty},{sample.limits},{sample.supply}\n".encode()
        try:
            if self._file.write(line) < len(line):
                raise OSError(0, "the disk is full")
        except OSError as error:
            raise Early(f"its samples could no longer be written ({error.strerror})") from None
        self.count += 1

    def _sync(self) -> None:
        while not self._over.wait(SYNC):
            with suppress(OSError):  # the next line meets it too
                os.fsync(self._file.fileno())

    def close(self) -> None:
        self._over.set()
        self._thread.join()
        self._file.close()


def recover(folder: Path) -> list[Path]:
    """The logs of runs in `folder` that were killed, made from their journals, which then go.

    Raises InputError for a journal that cannot be read, and where a log of that name is there already. A run that still
    plays is left alone.
    """
    made = []
    sweep(folder)  # the room that they held
    for path in sorted(folder.glob(f"*{END}")):
        log = path.with_name(path.name.removesuffix(END))
        with suppress(_InUse), file_lock(path, _in_use):
            if log.exists():
                raise InputError(f"{path} has the samples of a killed run, and {log} is there already; move one")
            if found := _read(path):
                found.save(log)
                made.append(log)
            path.unlink()
    return made


class _InUse(Exception):  # noqa: N818 - no error
    """The run of a journal still plays."""


def _in_use(holder: str) -> str:
    raise _InUse


def _read(path: Path) -> Log | None:
    """The log of a journal; None if no sample was written. What is not a whole line is left out."""
    lines = read_limited(path, MOST).split(b"\n")[:-1]
    if len(lines) < 2:
        return None
    try:
        head = json.loads(lines[0])
        calibration = from_dict(head["calibration"], str(path))
        rows = np.array([[int(cell) for cell in line.split(b",")] for line in lines[1:]])
        n, N = int(rows[:, 0].max()) + 1, len(head["levels"])
        duty = np.array(head["levels"], dtype=float)
        counts, limits, supply = np.full(N, np.nan), np.zeros(N, dtype=int), np.full(N, np.nan)
        for column, k in ((counts, 1), (duty, 2), (limits, 3), (supply, 4)):
            column[rows[:, 0]] = rows[:, k]
        reason = "its host was killed; a journal had these samples"
        lost = n - len(np.unique(rows[:, 0]))
        recording = Recording(counts[:n], duty[:n], float(head["Ts"]), limits[:n], supply[:n], 0, lost, reason)
        return log_of_run(recording, calibration, head["firmware"], head["port"], head["source"])
    except (ValueError, KeyError, TypeError, IndexError, OverflowError, RecursionError) as error:
        raise InputError(f"{path} is no journal of a run ({error}); move it away") from None
