"""Environments: one virtual environment a peer, in the user's cache, made by `python -m venv` and pip."""

import fcntl
import json
import os
import shutil
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path

from sysid.base.errors import InputError
from sysid.base.files import write_text

STAMP, FAILED = "qpal-installed.json", "qpal-failed.txt"


def folder() -> Path:
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
        return folder() / self.name

    def python(self) -> Path:
        """Its interpreter. Raises InputError if it is not installed, or was made for other requirements."""
        if not self.requirements:
            return Path(sys.executable)
        if self._stamp() != self._wanted():
            failed = self.path / FAILED
            why = f" ({failed.read_text(encoding='utf-8').strip()})" if failed.is_file() else ""
            raise InputError(f"not installed{why}: run qpal bench install {self.method or self.name}")
        return self._interpreter()

    def install(self) -> Path:
        """Make it anew if it is not there or was made for other requirements; returns its interpreter.

        Raises InputError with the last line of pip. `python` says the same until an installation succeeds.
        """
        if not self.requirements:
            return Path(sys.executable)
        with self._alone():
            if self._stamp() != self._wanted():
                shutil.rmtree(self.path, ignore_errors=True)
                with_pip = find_spec("pip") is None  # else the pip that is here serves there, which saves seconds
                self._call([sys.executable, "-m", "venv", str(self.path), *([] if with_pip else ["--without-pip"])])
                there = str(self._interpreter())
                pip = [there, "-m", "pip"] if with_pip else [sys.executable, "-m", "pip", "--python", there]
                quiet = ["--no-input", "--disable-pip-version-check"]
                self._call([*pip, "install", *quiet, *self.options, *self.requirements])
                write_text(self.path / STAMP, json.dumps(self._wanted()))
        return self._interpreter()

    def _interpreter(self) -> Path:
        return self.path / ("Scripts/python.exe" if os.name == "nt" else "bin/python")

    def _wanted(self) -> list[str]:
        return [*self.requirements, *self.options, "python {}.{}".format(*sys.version_info)]

    def _stamp(self) -> list[str] | None:
        try:
            return json.loads((self.path / STAMP).read_text(encoding="utf-8"))
        except (OSError, ValueError):
            return None

    def _call(self, command: list[str]) -> None:
        done = subprocess.run(command, capture_output=True, text=True, stdin=subprocess.DEVNULL)
        if done.returncode:
            lines = [line for line in (done.stderr or done.stdout).splitlines() if line.strip()]
            told = [line for line in lines if line.startswith("ERROR:")] or lines or ["no word of the reason"]
            sentence = f"installation failed: {told[-1][:200]}"
            self.path.mkdir(parents=True, exist_ok=True)
            write_text(self.path / FAILED, sentence)
            raise InputError(f"{self.name}: {sentence}")

    @contextmanager
    def _alone(self) -> Iterator[None]:
        """One process installs at a time; another one waits, and then finds the work done."""
        folder().mkdir(parents=True, exist_ok=True)
        with (folder() / f".{self.name}.lock").open("w") as file:
            fcntl.flock(file, fcntl.LOCK_EX)
            yield
