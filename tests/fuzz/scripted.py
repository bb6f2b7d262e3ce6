"""A target that ends in every way that there is, to see that the runner tells them apart."""

import os
import signal
import time
import warnings
from pathlib import Path

import numpy as np

from fuzz.runner import WrongError
from sysid.base.errors import InputError

ENDS = ("same", "sentence", "silent", "untyped", "warning", "wrong", "signal", "exit", "hang", "memory", "read")


class Scripted:
    """Case k ends as `ENDS` says."""

    name = "scripted"
    seconds = 0.2

    def ready(self) -> None:
        """Nothing."""

    def case(self, rng: np.random.Generator, folder: Path) -> str:
        """One end."""
        how = ENDS[rng.bit_generator.seed_seq.entropy[1]]  # type: ignore[attr-defined]
        (folder / "file").write_text(how)
        if how == "sentence":
            raise InputError("a number is missing; give one")
        if how == "silent":
            raise InputError(" ")
        if how == "untyped":
            raise KeyError("a")
        if how == "warning":
            warnings.warn("odd", RuntimeWarning, stacklevel=1)
        if how == "wrong":
            raise WrongError("wrong number: 1, not 2")
        if how == "signal":
            os.kill(os.getpid(), signal.SIGSEGV)
        if how == "exit":
            os._exit(3)
        if how == "memory":
            np.ones(1 << 36)
        begun = time.process_time()
        while how == "hang" and time.process_time() < begun + 3.0:
            pass
        return how
