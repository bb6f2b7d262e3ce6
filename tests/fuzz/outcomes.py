"""What a call comes to, in a child process with limits of time and memory."""

import dataclasses
import inspect
import json
import os
import resource
import select
import signal
import time
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pydantic

SECONDS = 10.0  # of one call; a valid one that takes longer than a third of it gets more
LONGEST = 60.0  # of the valid call
MEMORY = 3 << 30  # bytes beyond what the process has when it begins


def finite(value: Any, depth: int = 0) -> bool:
    """Whether every number in a result is finite, as far down as results go."""
    if isinstance(value, (float, complex, np.number)):
        return bool(np.isfinite(value))
    if isinstance(value, np.ndarray) and value.dtype.kind in "fc":
        return bool(np.all(np.isfinite(value)))
    if depth > 3:
        return True
    if isinstance(value, (list, tuple)):
        return all(finite(v, depth + 1) for v in value)
    if isinstance(value, dict):
        return all(finite(v, depth + 1) for v in value.values())
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        return all(finite(getattr(value, f.name), depth + 1) for f in dataclasses.fields(value))
    return True


def outcome(call: Callable[[], Any], was_finite: bool) -> tuple[str, str]:
    """'fine', 'sentence', 'untyped' or 'nan', and what was said."""
    try:
        found = call()
        if inspect.isgenerator(found):
            found = list(found)
    except (KeyboardInterrupt, SystemExit) as e:
        return "untyped", repr(e)
    except pydantic.ValidationError as e:  # the typed error of a `Channel` and its like
        return "sentence", str(e)
    except BaseException as e:
        if any(kind.__module__.split(".")[0] in ("sysid", "twin") for kind in type(e).__mro__):
            return "sentence", str(e)
        return "untyped", f"{type(e).__name__}: {e}"[:300]
    return ("nan" if was_finite and not finite(found) else "fine"), ""


def worker(jobs: list[Callable[[], Any]], first: int, pipe: int) -> None:
    """In the child: the valid call, then every other from `first` on; a line for each."""
    warnings.simplefilter("ignore")
    quiet = os.open(os.devnull, os.O_RDWR)
    for stream in (0, 1, 2):
        os.dup2(quiet, stream)
    used = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
    resource.setrlimit(resource.RLIMIT_AS, (used + MEMORY, used + MEMORY))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    with os.fdopen(pipe, "w") as out:
        try:
            reference = jobs[0]()
            was_finite, said = finite(reference), ["valid", ""]
        except BaseException as e:
            was_finite, said = False, ["invalid", f"{type(e).__name__}: {e}"[:300]]
        print(json.dumps([0, *said]), file=out, flush=True)
        if said[0] == "valid":
            for k in range(max(first, 1), len(jobs)):
                print(json.dumps([k, *outcome(jobs[k], was_finite)]), file=out, flush=True)
    os._exit(0)


def attacked(jobs: list[Callable[[], Any]]) -> list[tuple[str, str]]:
    """The outcome of each; a child that hangs or dies is followed by another."""
    found: list[tuple[str, str]] = []
    limit = LONGEST
    while len(found) < len(jobs):
        read, write = os.pipe()
        child = os.fork()
        if child == 0:
            os.close(read)
            worker(jobs, len(found), write)
        os.close(write)
        buffer, ended, begun = b"", "", time.monotonic()
        while not ended:
            ready, _, _ = select.select([read], [], [], max(0.0, begun + limit - time.monotonic()))
            piece = os.read(read, 1 << 16) if ready else b""
            if not piece:
                ended = "died" if ready else "hang"
            *lines, buffer = (buffer + piece).split(b"\n")
            for line in lines:
                k, how, said = json.loads(line)
                took, begun = time.monotonic() - begun, time.monotonic()
                limit = max(SECONDS, 3.0 * took) if k == 0 else limit
                if k == len(found):
                    found.append((how, said))
        os.close(read)
        os.kill(child, signal.SIGKILL)
        _, status = os.waitpid(child, 0)
        if found and found[0][0] == "invalid":
            return found
        if len(found) < len(jobs):
            found.append((ended, f"status {status}"))
    return found
