"""A method in one file that knows nothing of this library, run in a process and an environment of its own.

An environment is a virtual one in the user's cache, made by `python -m venv` and pip.
"""

import contextlib
import fcntl
import json
import os
import shutil
import signal
import subprocess
import sys
import time
import zipfile
from collections.abc import Iterator
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np

from sysid.base.errors import InputError
from sysid.base.files import check_regular_file, json_value, read_limited, write_text
from sysid.base.locks import scratch_folder
from sysid.bench.method import LIMIT, Outcome, Tests
from sysid.bench.task import Task

STAMP, FAILED = "qpal-installed.json", "qpal-failed.txt"
START = 120.0  # seconds that a process may take to import its libraries, before its clock starts; chosen by hand
TAIL = 2**16  # [byte] of what a process printed, in which its last line is looked for
LARGEST = 2**30  # [byte] of a file that a process gives back: a hundred million samples
THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMEXPR_NUM_THREADS", "NUMBA_NUM_THREADS")
# JAX has a pool of its own that no variable above reaches.
XLA = "--xla_cpu_multi_thread_eigen=false intra_op_parallelism_threads=1"


def peer_folder() -> Path:
    """Where the method files of other libraries are: inside an installed package, or in a checkout."""
    room = Path(__file__).parent
    for folder in (room / "peers", room.parents[1] / "scripts" / "peers"):
        if folder.is_dir():
            return folder
    raise InputError(f"there is no folder {room / 'peers'} with methods of other libraries; reinstall qpal")


def cache_folder() -> Path:
    """Where the environments are: `$XDG_CACHE_HOME/qpal/peers`, by default under ~/.cache."""
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "qpal" / "peers"


@dataclass(frozen=True)
class Environment:
    """The environment called `name`, with what pip is to install there and further options of pip.

    Without requirements it is the interpreter that runs now. `method` is what `qpal bench install` calls it, if that is
    not its name.
    """

    name: str
    requirements: tuple[str, ...]
    options: tuple[str, ...] = ()
    method: str = ""

    @property
    def path(self) -> Path:
        """Its folder."""
        return cache_folder() / self.name

    def python(self) -> Path:
        """Its interpreter. Raises InputError if it is not installed, or was made for other requirements."""
        if not self.requirements:
            return Path(sys.executable)
        if not self._is_current():
            failure_file = self.path / FAILED
            reason = f" ({failure_file.read_text(encoding='utf-8').strip()})" if failure_file.is_file() else ""
            raise InputError(f"not installed{reason}: run qpal bench install {self.method or self.name}")
        return self._interpreter()

    def install(self) -> Path:
        """Make it anew if it is not there or was made for other requirements; returns its interpreter.

        Raises InputError with the last line of pip. `python` says the same until an installation succeeds.
        """
        if not self.requirements:
            return Path(sys.executable)
        with self._lock():
            if not self._is_current():
                shutil.rmtree(self.path, ignore_errors=True)
                with_pip = find_spec("pip") is None  # else the pip that runs here serves there, which saves seconds
                self._call([sys.executable, "-m", "venv", str(self.path), *([] if with_pip else ["--without-pip"])])
                python = str(self._interpreter())
                pip = [python, "-m", "pip"] if with_pip else [sys.executable, "-m", "pip", "--python", python]
                quiet = ["--no-input", "--disable-pip-version-check"]
                self._call([*pip, "install", *quiet, *self.options, *self.requirements])
                write_text(self.path / STAMP, json.dumps(self._contents()))
        return self._interpreter()

    def _interpreter(self) -> Path:
        return self.path / ("Scripts/python.exe" if os.name == "nt" else "bin/python")

    def _contents(self) -> list[str]:
        return [*self.requirements, *self.options, "python {}.{}".format(*sys.version_info)]

    def _is_current(self) -> bool:
        try:
            return json.loads((self.path / STAMP).read_text(encoding="utf-8")) == self._contents()
        except (OSError, ValueError):
            return False

    def _call(self, command: list[str]) -> None:
        """Run pip or venv; raises InputError with the line that says why it failed, which stays in the folder."""
        process = subprocess.run(command, capture_output=True, text=True, stdin=subprocess.DEVNULL)
        if process.returncode:
            lines = [line for line in (process.stderr or process.stdout).splitlines() if line.strip()]
            reasons = [line for line in lines if line.startswith("ERROR:")] or lines or ["no word of the reason"]
            sentence = f"installation failed: {reasons[-1][:200]}"
            self.path.mkdir(parents=True, exist_ok=True)
            write_text(self.path / FAILED, sentence)
            raise InputError(f"{self.name}: {sentence}")

    @contextlib.contextmanager
    def _lock(self) -> Iterator[None]:
        """One process installs at a time; another one waits, and then finds the work done."""
        cache_folder().mkdir(parents=True, exist_ok=True)
        with (cache_folder() / f".{self.name}.lock").open("w") as file:
            fcntl.flock(file, fcntl.LOCK_EX)
            yield


@dataclass(frozen=True)
class FileMethod:
    """The method file at `path`; `requirements` are what pip installs for it, `package` says whose version counts.

    `sysid.bench.method_file.load` reads all of this from the file.
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
        requirements = (*self.requirements, "numpy") if self.requirements else ()
        is_peer = Path(self.path).parent == peer_folder().resolve()
        return Environment(self.name, requirements, self.options, "" if is_peer else self.path)

    def solve(self, task: Task, tests: Tests, seconds: float, seed: int) -> Outcome:
        """See `Method`. Its clock starts after its imports; at `LIMIT` times the budget it is killed."""
        try:
            python = self.environment.python()
        except InputError as error:
            return Outcome(str(error))
        with scratch_folder() as folder:
            _write(folder / "data.npz", task, tests, seconds, seed)
            status, duration = self._run(python, folder, seconds)
            try:
                return Outcome(status, seconds=duration) if status else _read(folder, tests)
            except InputError as error:
                return Outcome(f"crashed: its answer cannot be read ({error})")

    def _run(self, python: Path, folder: Path, seconds: float) -> tuple[str, float]:
        """Run the worker to its end; a sentence if it did not reach one, and the seconds that it then took."""
        worker = Path(__file__).with_name("worker.py")
        arguments = map(str, (worker, Path(self.path).resolve(), folder, self.package, os.getpid()))
        with (folder / "output").open("wb") as output:
            process = subprocess.Popen(
                [str(python), "-P", *arguments],
                stdin=subprocess.DEVNULL,
                stdout=output,
                stderr=output,
                cwd=folder,
                env=_variables(bool(self.requirements)),
                start_new_session=True,  # so that its own children can be killed with it
            )
            try:
                failure, duration = _wait(process, folder / "began", seconds)
            finally:
                with contextlib.suppress(ProcessLookupError):
                    os.killpg(process.pid, signal.SIGKILL)
                process.wait()
        if failure or (folder / "done.json").is_file():
            return failure, duration
        code, lines = process.returncode, _tail(folder / "output").split("\n")
        end = f"killed by signal {-code}" if code < 0 else f"exit status {code}"
        last = next((line for line in reversed(lines) if line.strip()), "no output")
        return f"crashed: {end}: {last}"[:300], duration


def _wait(process: subprocess.Popen, clock_file: Path, seconds: float) -> tuple[str, float]:
    """Wait for the end: why it did not come, empty if it did, and seconds since the clock started."""
    start, clock = time.perf_counter(), 0.0
    while process.poll() is None:
        moment = time.perf_counter()
        clock = clock or (moment if clock_file.exists() else 0.0)
        if clock and moment - clock > LIMIT * seconds:
            return f"stopped after {LIMIT * seconds:.0f} s", moment - clock
        if not clock and moment - start > START:
            return f"stopped: its imports took more than {START:.0f} s", float("nan")
        time.sleep(0.02)
    return "", time.perf_counter() - clock if clock else float("nan")


def _variables(has_environment: bool) -> dict[str, str]:
    """The environment variables of the child: one thread, and nothing that leads an own environment astray."""
    variables = dict(os.environ) | dict.fromkeys(THREADS, "1") | {"XLA_FLAGS": XLA, "JAX_PLATFORMS": "cpu"}
    variables |= {"PYTHONDONTWRITEBYTECODE": "1", "CUDA_VISIBLE_DEVICES": "", "MPLBACKEND": "Agg"}
    for name in ("PYTHONPATH", "PYTHONHOME") if has_environment else ():
        variables.pop(name, None)
    return variables


def _write(path: Path, task: Task, tests: Tests, seconds: float, seed: int) -> None:
    """Write what the worker reads."""
    data = task.data(seconds, seed)
    arrays: dict[str, Any] = {"experiments": len(data.u), "Ts": data.Ts, "seconds": seconds, "seed": data.seed}
    arrays["orders"] = np.array(data.orders or (), dtype=int)
    arrays["model"] = json.dumps(json_value(data.model))
    for k, experiment in enumerate(zip(data.u, data.y, data.missing, strict=True)):
        arrays |= {f"{name}{k}": values for name, values in zip(("u", "y", "missing"), experiment, strict=True)}
    arrays["tests"] = len(tests)
    for k, (u, first) in enumerate(tests.values()):
        arrays |= {f"test{k}": u, f"first{k}": first}
    np.savez(path, **arrays)


def _tail(path: Path) -> str:
    """The end of what a process printed."""
    with path.open("rb") as file:
        file.seek(max(file.seek(0, os.SEEK_END) - TAIL, 0))
        return file.read().decode("utf-8", "replace")


def _read(folder: Path, tests: Tests) -> Outcome:
    """The outcome from the files of the worker, which the method can write too; `sysid.bench.border` checks it."""
    result = json.loads(read_limited(folder / "done.json", LARGEST))
    if result["status"] != "ok":
        return Outcome(result["status"])
    with zipfile.ZipFile(check_regular_file(folder / "runs.npz")) as packed:
        if sum(member.file_size for member in packed.infolist()) > LARGEST:
            raise ValueError(f"its runs are larger than {LARGEST // 2**20} MiB")
    with np.load(folder / "runs.npz") as arrays:
        runs = {name: arrays[f"run{k}"] for k, name in enumerate(tests)}
    return Outcome("ok", runs, result["details"], result["seconds"], result["memory"], result["version"])
