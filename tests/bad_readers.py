"""Readers that end their process, wait, or take all memory; in a module of their own that another process loads."""

import os
import signal
import time
from pathlib import Path

import numpy as np

from sysid.base.errors import InputError
from sysid.data.table import Table


class Good:
    """One column u: 0, 1, 2."""

    def read(self, path: Path) -> Table:
        return Table(
            path, ("u",), (np.arange(3.0),), (range(1, 4),), notes=("as read",), units={"u": "V"}, meta={"k": 1}
        )

    def header(self, path: Path) -> str:
        return "head"

    @staticmethod
    def libraries(path: Path) -> tuple[str, ...]:
        return ()


class Crashes(Good):
    """Ends on the signal that the file names."""

    def read(self, path: Path) -> Table:
        os.kill(os.getpid(), getattr(signal, path.read_text()))
        raise AssertionError


class Loops(Good):
    def read(self, path: Path) -> Table:
        while True:
            pass


class Waits(Good):
    def read(self, path: Path) -> Table:
        time.sleep(600)
        raise AssertionError


class Takes(Good):
    """As a file that claims to be large: a block of 256 MB, and another, and another."""

    def read(self, path: Path) -> Table:
        held = [np.ones(1 << 25) for _ in range(64)]
        raise AssertionError(len(held))


class PanicError(BaseException):
    pass


class Panics(Good):
    def read(self, path: Path) -> Table:
        raise PanicError


class Leaves(Good):
    """Ends without a word."""

    def read(self, path: Path) -> Table:
        os._exit(3)


class Refuses(Good):
    def read(self, path: Path) -> Table:
        raise InputError(f"{path} is refused")


class Babbles(Good):
    """Refuses with what stands in the file, as a name in it."""

    def read(self, path: Path) -> Table:
        raise InputError(f"{path} has {path.read_text()}; save it again")


class Denied(Good):
    def read(self, path: Path) -> Table:
        raise PermissionError(13, "Permission denied")
