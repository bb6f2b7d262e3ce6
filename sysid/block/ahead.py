"""Loops that a fit surely needs, compiled by a second process while this one reads the record and searches.

Most of a first fit is compilation, which takes one core. The second process writes to the cache on disk, from which
this one takes the loops (`sysid.base.compiled`); whatever becomes of it, this one compiles what is missing.
"""

import atexit
import gc
import importlib.util
import os
import pickle
import subprocess
import sys
from collections.abc import Sequence
from contextlib import suppress
from multiprocessing.spawn import get_executable
from threading import Thread

import numpy as np

from sysid.base.compiled import is_kept, leave_to_others, refuses, refusing_compilation
from sysid.base.parallel import available_cores, end_with
from sysid.block.block import Block

_SAMPLES = 8  # of a run that is there to be compiled
_begun: list[subprocess.Popen] = []


def compile_ahead(blocks: Sequence[Block]) -> None:
    """Starts a process that compiles the loops of these blocks in turn, where one of them is missing on the disk.

    It ends with this process, at the latest. Nothing starts where no second core is free, without locks or a place for
    a cache, or while an earlier one is at work, nor where nothing may be compiled.
    """
    if (
        not blocks
        or refuses()
        or available_cores() < 2
        or _is_busy()
        or not importlib.util.find_spec("fcntl")
        or any(p.poll() is None for p in _begun)
    ):
        return
    if not _is_missing(blocks):
        return
    folders = [folder for folder in sys.path if isinstance(folder, str)]  # the same modules as here
    code = f"import sys; sys.path[:] = {folders!r}; from sysid.block.ahead import main; main()"
    with suppress(Exception):  # blocks that are no data, a system without room for a process
        message = pickle.dumps(tuple(blocks))
        process = subprocess.Popen(
            [os.fsdecode(get_executable()), "-I", "-c", code, str(os.getpid())],
            stdin=subprocess.PIPE,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            env={**os.environ, "OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"},
        )
        _begun[:] = [process]
        atexit.register(_end, process, os.getpid())
        Thread(target=process.communicate, args=(message,), name="compiled ahead", daemon=True).start()


def main() -> None:
    """The second process: its parent is the first argument, the blocks come through its input."""
    end_with(int(sys.argv[1]))
    leave_to_others()
    gc.disable()  # a tenth of the time; it lives for seconds
    compile_blocks(pickle.load(sys.stdin.buffer))  # of the process that started this one


def compile_blocks(blocks: Sequence[Block]) -> None:
    """Compile the loops of these blocks in turn, in this process."""
    for block in blocks:
        _compile(block)


def _is_busy() -> bool:
    """Whether all cores of the machine have had work for the last minute."""
    with suppress(OSError, AttributeError):  # Windows, or a system that does not tell
        return os.getloadavg()[0] >= (os.cpu_count() or 1)
    return False


def _compile(block: Block) -> None:
    for columns in (1, 0):
        with suppress(Exception):  # what this one cannot run, the other one meets with words
            _run(block, columns)


def _is_missing(blocks: Sequence[Block]) -> bool:
    """Whether a loop of these blocks would have to be compiled, and can be kept."""
    from sysid.block.kernels import scale_columns

    if not is_kept(scale_columns):
        return False
    for block in blocks:
        for columns in (1, 0):
            with refusing_compilation() as refused, suppress(Exception):
                _run(block, columns)
            if refused:
                return True
    return False


def _run(block: Block, columns: int) -> None:
    """A block over a few samples, with the derivatives of its parameters and one more where `columns` is 1."""
    x = np.linspace(0.0, 1.0, _SAMPLES)
    theta = block.start(x)
    xs = [x.copy() for _ in range(block.channels[0])]
    Js = [np.zeros((_SAMPLES, columns * (1 + len(theta)))) for _ in xs]
    with np.errstate(all="ignore"):
        block.propagate_all(theta, xs, Js, columns)


def _end(process: subprocess.Popen, owner: int) -> None:
    """Ends the process, if this is the one that started it and not a fork."""
    if os.getpid() == owner and process.poll() is None:
        process.kill()
        process.wait()
