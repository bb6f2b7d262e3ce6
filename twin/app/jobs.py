"""Jobs: work in processes of its own, with progress, that end at once when they are cancelled and leave nothing behind.

A job is `python -m twin.app.tasks` in a process group of its own: it gets its request as one line on standard input
and answers in lines of JSON. It ends when its standard input closes, so no job outlives the app, even a killed one.
"""

import json
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from sysid.base.errors import InputError
from sysid.base.locks import new_scratch_folder
from sysid.base.parallel import available_cores

WAITING, RUNNING, DONE, FAILED, CANCELLED = "waiting", "running", "done", "failed", "cancelled"
ONE_THREAD = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMEXPR_NUM_THREADS")
LESS = "choose a shorter range, or resample"
Hear = Callable[["Job", dict[str, Any]], None]


@dataclass(eq=False)
class Job:
    """One piece of work: what it is, how far it is, and why it failed.

    `share` is from 0 to 1. `out` is the folder for what it makes; `subject` is for those who asked.
    """

    title: str
    request: dict[str, Any]
    out: Path
    hear: Hear
    subject: str = ""
    state: str = WAITING
    progress: str = "waiting for a free core"
    share: float = 0.0
    error: str = ""
    start_time: float = field(default_factory=time.monotonic)
    end_time: float | None = None
    process: "subprocess.Popen[str] | None" = field(default=None, repr=False)

    @property
    def over(self) -> bool:
        """Whether nothing more will come of it."""
        return self.state in (DONE, FAILED, CANCELLED)

    @property
    def seconds(self) -> float:
        """Time since it was asked for, until it ended [s]."""
        return (time.monotonic() if self.end_time is None else self.end_time) - self.start_time


class Jobs:
    """The jobs of an app, at most `limit` at a time; the others wait in order."""

    def __init__(self, limit: int | None = None) -> None:
        self.all: list[Job] = []
        self.version = 0
        self._limit = limit or available_cores()
        self._lock = threading.RLock()
        self._scratch = new_scratch_folder()
        self._closed = False

    def submit(self, title: str, request: dict[str, Any], hear: Hear, subject: str = "") -> Job:
        """Begin, or queue, the work of `request` (see `twin.app.tasks`).

            `hear` receives its answers in a thread of their own: {"ready": ...} when its files are whole, and
        {"failed": reason} if it could not.
        """
        try:
            out = Path(tempfile.mkdtemp(dir=self._scratch))
        except OSError as error:
            raise InputError(
                f"the job cannot begin ({error.strerror or error}); free disk space, and try again"
            ) from None
        job = Job(title, {**request, "out": str(out)}, out, hear, subject)
        with self._lock:
            self.all.append(job)
            self._begin_waiting()
        return job

    def cancel(self, job: Job) -> None:
        """End a job now, with every process that it started."""
        with self._lock:
            if job.over:
                return
            self._end(job, CANCELLED, "cancelled")
            kill(job.process)
        if job.process is not None:
            job.process.wait()
        shutil.rmtree(job.out, ignore_errors=True)

    def forget(self, job: Job) -> None:
        """Take a job that is over off the list."""
        with self._lock:
            if job.over and job in self.all:
                self.all.remove(job)
                self.version += 1

    def close(self) -> None:
        """End all jobs and delete their scratch files."""
        with self._lock:
            self._closed = True
            jobs = list(self.all)
        for job in jobs:
            self.cancel(job)
        shutil.rmtree(self._scratch, ignore_errors=True)

    def _begin_waiting(self) -> None:
        running = sum(job.state == RUNNING for job in self.all)
        for job in list(self.all):
            if running >= self._limit or self._closed:
                break
            if job.state == WAITING:
                self._begin(job)
                running += job.state == RUNNING
        self.version += 1

    def _begin(self, job: Job) -> None:
        """Start the process of a job, or end it as failed."""
        job.state, job.progress, job.start_time = RUNNING, "starting", time.monotonic()
        try:
            job.process = worker(job.out)
            threading.Thread(target=self._follow, args=(job, job.process), daemon=True).start()
        except (OSError, RuntimeError) as error:  # no file, process or thread can be had
            kill(job.process)
            job.error = f"the job cannot begin ({getattr(error, 'strerror', '') or error}); end others, and try again"
            self._tell_owner(job, {"failed": job.error})
            self._end(job, FAILED, "done")
            shutil.rmtree(job.out, ignore_errors=True)

    def _follow(self, job: Job, process: "subprocess.Popen[str]") -> None:
        """Hand on what a process says until it ends."""
        assert process.stdin is not None
        assert process.stdout is not None
        with suppress(OSError):  # a process that has ended already says so by its exit code
            process.stdin.write(json.dumps(job.request) + "\n")
            process.stdin.flush()
        for line in process.stdout:
            with self._lock:
                if job.over:
                    break
                self._read_answer(job, line)
        code = process.wait()
        for pipe in (process.stdin, process.stdout):
            with suppress(OSError):
                pipe.close()
        with self._lock:
            if not job.over:
                job.error = job.error or ("" if code == 0 else last_words(job.out, code))
                if job.error:
                    self._tell_owner(job, {"failed": job.error})  # first: who sees FAILED may ask at once why
                self._end(job, FAILED if job.error else DONE, "done")
            self._begin_waiting()
        shutil.rmtree(job.out, ignore_errors=True)

    def _read_answer(self, job: Job, line: str) -> None:
        """Take one line of a job's process: an error, progress, or an answer for its owner."""
        try:
            answer = json.loads(line)
        except ValueError:
            return
        if "error" in answer:
            job.error = str(answer["error"])
        elif "said" in answer:
            job.progress, job.share = str(answer["said"]), float(answer.get("share", job.share))
        else:
            self._tell_owner(job, answer)
        self.version += 1

    def _tell_owner(self, job: Job, answer: dict[str, Any]) -> None:
        try:
            job.hear(job, answer)
        except Exception as error:  # whatever it is, the person who waits for this job reads it
            job.error = str(error)

    def _end(self, job: Job, state: str, message: str) -> None:
        job.state, job.progress, job.end_time = state, message, time.monotonic()
        if state == DONE:
            job.share = 1.0
        self.version += 1


def worker(out: Path, module: str = "twin.app.tasks") -> "subprocess.Popen[str]":
    """The process that does a job, in a group of its own; it writes its last words into `out`."""
    root = str(Path(__file__).parents[2])  # for a checkout that is not installed
    path = os.pathsep.join(filter(None, (root, os.environ.get("PYTHONPATH"))))
    with (out / "stderr.txt").open("wb") as errors:
        return subprocess.Popen(
            [sys.executable, "-m", module],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=errors,
            text=True,
            encoding="utf-8",
            env={**os.environ, **dict.fromkeys(ONE_THREAD, "1"), "PYTHONPATH": path, "MPLBACKEND": "agg"},
            start_new_session=os.name == "posix",  # so that Ctrl-C does not reach it, and its children end with it
        )


def kill(process: "subprocess.Popen[str] | None") -> None:
    if process is None or process.poll() is not None:
        return
    with suppress(ProcessLookupError):
        if os.name == "posix":
            os.killpg(process.pid, signal.SIGKILL)
        else:
            process.kill()


def last_words(out: Path, code: int) -> str:
    try:
        lines = (out / "stderr.txt").read_text(encoding="utf-8", errors="replace").strip().splitlines()
    except OSError:
        lines = []
    if code < 0:
        return f"the system ended the process of this job (signal {-code}), as it does where memory runs out; {LESS}"
    reason = lines[-1][:200] if lines else f"code {code}"
    return f"an error of qpal itself ended this job: {reason}; the other models and the record are as they were"
