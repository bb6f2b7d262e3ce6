"""A method in one file that knows nothing of this library, run in a process and an environment of its own."""

import contextlib
import json
import os
import signal
import subprocess
import time
import zipfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from sysid.base.errors import InputError
from sysid.base.locks import scratch_folder
from sysid.bench.environments import Environment
from sysid.bench.method import LIMIT, Outcome, Tests
from sysid.bench.task import Task

START = 120.0  # seconds that a process may take to import its libraries, before its clock starts
THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMEXPR_NUM_THREADS", "NUMBA_NUM_THREADS")
# JAX has a pool of its own that no variable above reaches.
XLA = "--xla_cpu_multi_thread_eigen=false intra_op_parallelism_threads=1"


@dataclass(frozen=True)
class Outside:
    """The method file at `path`; `requirements` are what pip installs for it, `package` says whose version counts.

    `sysid.bench.scaffold.load` reads all of this from the file.
    """

    name: str
    about: str
    path: str
    requirements: tuple[str, ...] = ()
    package: str = ""
    options: tuple[str, ...] = ()

    @property
    def environment(self) -> Environment:
        """Where it runs; the worker there needs numpy."""
        needed = (*self.requirements, "numpy") if self.requirements else ()
        ours = Path(self.path).parent == Path(__file__).with_name("peers")
        return Environment(self.name, needed, self.options, "" if ours else self.path)

    def solve(self, task: Task, tests: Tests, seconds: float, seed: int) -> Outcome:
        """See `Method`. Its clock starts after its imports; at `LIMIT` times the budget it is killed."""
        try:
            python = self.environment.python()
            with scratch_folder() as folder:
                _write(folder / "data.npz", task, tests, seconds, seed)
                status, took = self._run(python, folder, seconds)
                return Outcome(status, seconds=took) if status else _read(folder, tests)
        except InputError as error:
            return Outcome(str(error))
        except Exception as error:  # whatever a file of somebody else does, there is a row
            return Outcome(f"crashed: {type(error).__name__}: {error}"[:300])

    def _run(self, python: Path, folder: Path, seconds: float) -> tuple[str, float]:
        """Run the worker to its end; a sentence if it did not reach one, and the seconds that it then took."""
        worker = Path(__file__).with_name("worker.py")
        command = [
            str(python),
            "-P",
            str(worker),
            str(Path(self.path).resolve()),
            str(folder),
            self.package,
            str(os.getpid()),
        ]
        with (folder / "said").open("wb") as said:
            process = subprocess.Popen(
                command,
                stdin=subprocess.DEVNULL,
                stdout=said,
                stderr=said,
                cwd=folder,
                env=_surroundings(bool(self.requirements)),
                start_new_session=True,  # so that its own children can be killed with it
            )
            try:
                stopped, took = _wait(process, folder / "began", seconds)
            finally:
                _kill(process)
        if stopped or (folder / "done.json").is_file():
            return stopped, took
        code, last = process.returncode, (folder / "said").read_text(encoding="utf-8", errors="replace").split("\n")
        ended = f"killed by signal {-code}" if code < 0 else f"exit status {code}"
        return f"crashed: {ended}: {next((line for line in reversed(last) if line.strip()), 'no output')}"[:300], took


def _wait(process: subprocess.Popen, began: Path, seconds: float) -> tuple[str, float]:
    """Wait for the end: why it did not come, empty if it did, and seconds since the clock started."""
    start, clock = time.perf_counter(), 0.0
    while process.poll() is None:
        now = time.perf_counter()
        clock = clock or (now if began.exists() else 0.0)
        if clock and now - clock > LIMIT * seconds:
            return f"stopped after {LIMIT * seconds:.0f} s", now - clock
        if not clock and now - start > START:
            return f"stopped: its imports took more than {START:.0f} s", float("nan")
        time.sleep(0.02)
    return "", time.perf_counter() - clock if clock else float("nan")


def _kill(process: subprocess.Popen) -> None:
    """End the process and all that it started."""
    with contextlib.suppress(ProcessLookupError):
        os.killpg(process.pid, signal.SIGKILL)
    process.wait()


def _surroundings(own: bool) -> dict[str, str]:
    """The environment variables of the child: one thread, and nothing that leads an own environment astray."""
    found = dict(os.environ) | dict.fromkeys(THREADS, "1") | {"XLA_FLAGS": XLA, "JAX_PLATFORMS": "cpu"}
    found |= {"PYTHONDONTWRITEBYTECODE": "1", "CUDA_VISIBLE_DEVICES": "", "MPLBACKEND": "Agg"}
    for name in ("PYTHONPATH", "PYTHONHOME") if own else ():
        found.pop(name, None)
    return found


def _write(path: Path, task: Task, tests: Tests, seconds: float, seed: int) -> None:
    """What the worker reads."""
    data = task.data(seconds, seed)
    arrays: dict[str, Any] = {"experiments": len(data.u), "Ts": data.Ts, "seconds": seconds, "seed": data.seed}
    arrays["orders"] = np.array(data.orders or (), dtype=int)
    for k, each in enumerate(zip(data.u, data.y, data.missing, strict=True)):
        arrays |= {f"{name}{k}": values for name, values in zip(("u", "y", "missing"), each, strict=True)}
    arrays["tests"] = len(tests)
    for k, (u, first) in enumerate(tests.values()):
        arrays |= {f"test{k}": u, f"first{k}": first}
    np.savez(path, **arrays)


def _read(folder: Path, tests: Tests) -> Outcome:
    """The outcome from the files of the worker."""
    done = json.loads((folder / "done.json").read_text(encoding="utf-8"))
    if done["status"] != "ok":
        return Outcome(done["status"][:300])
    try:
        with np.load(folder / "runs.npz") as arrays:
            runs = {name: arrays[f"run{k}"] for k, name in enumerate(tests)}
    except (OSError, KeyError, ValueError, zipfile.BadZipFile) as error:
        return Outcome(f"crashed: its runs cannot be read ({error})"[:300])
    return Outcome("ok", runs, done["details"], done["seconds"], done["memory"], done["version"])
