"""Calls of the public names of `sysid` and `twin` with odd values.

Each argument in turn gets every odd value of `ODD`; the others are valid. A call runs in a child process with limits of
time and memory. Bad are: an exception that is not the project's own ("untyped"), a number that is not finite where the
valid call has finite ones ("nan"), a call that does not return ("hang"), and a process that dies ("died").
"""

import os
import tempfile
import warnings
from typing import Any

from fuzz.outcomes import attacked
from fuzz.public import SEARCHED, calls
from fuzz.supply import Supply
from fuzz.tally import Tally, part


def attack(chosen: Any) -> Tally:
    """The calls of the names that have the part."""
    tally = Tally()
    with tempfile.TemporaryDirectory() as folder:
        os.chdir(folder)
        warnings.simplefilter("ignore")
        for name, valid, attempts in calls(Supply()):
            if chosen.part not in name:
                continue
            tries = list(part(attempts, chosen.scale, chosen.seed + sum(map(ord, name))))
            (how, said), *ends = attacked([valid, *(call for _, _, call in tries)])
            if how != "valid":
                tally.case(
                    f"no valid call known: {how}", [] if said.startswith("LookupError") else [(how, f"{name}: {said}")]
                )
            for (parameter, value, _), (end, words) in zip(tries, ends, strict=how == "valid"):
                # What is not finite is fine from calls that a search makes with any values.
                fine = end in ("fine", "sentence") or (end == "nan" and name.startswith(SEARCHED))
                tally.case(end, [] if fine else [(end, f"{name}, {parameter} = {value}: {words}")])
        os.chdir("/")
    return tally
