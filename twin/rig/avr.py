"""The real firmware without a board: compiled, executed by simavr, its pins wired to a plant in Python.

Debian has what it needs: gcc-avr, avr-libc, libsimavr-dev, libelf-dev, gcc and make. Time is simulated, so a run is
the same however fast the computer is. `Port` runs it beside the wall clock, on a pseudo-terminal that a host opens.
"""

import hashlib
import math
import os
import shutil
import struct
import subprocess
import tempfile
import threading
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from pathlib import Path

from sysid.base.errors import InputError
from twin.rig.closing import Closing

HERE = Path(__file__).resolve().parent
FIRMWARE = HERE / "firmware"
CLOCK = 16_000_000  # [Hz]
STEP = 0.001  # [s] between two looks at the plant
LATE = 0.005  # [s] that the simulation may be late and then hurry
QUIET = 0.02  # [s] without a byte of a host that should be heard every 10 ms
PACKAGES = "gcc-avr, avr-libc, libsimavr-dev, libelf-dev, gcc and make"
_REQUEST, _ANSWER = struct.Struct("<I4fBxH"), struct.Struct("<QQ3f2B2H2xI")

# Mean duties (3,) of the last step, -1 to 1, and its length [s]; gives the next readings of the three
# potentiometers and of the supply (4,), as shares of a full reading.
Plant = Callable[[Sequence[float], float], Sequence[float]]


def missing() -> str:
    """What has to be installed before the firmware can be built, as a sentence; empty if nothing is."""
    absent = [name for name in ("avr-gcc", "gcc", "make") if shutil.which(name) is None]
    headers = [path for path in ("/usr/include/simavr/sim_avr.h", "/usr/include/libelf.h") if not Path(path).exists()]
    lacking = ", ".join([*absent, *headers])
    return f"the firmware needs {lacking} to be run here; install Debian's {PACKAGES}" if lacking else ""


def build() -> Path:
    """The folder with firmware.elf and simulated, built if these sources were not built before.

    Raises InputError where a compiler is missing or fails.
    """
    if why := missing():
        raise InputError(why)
    sources = sorted([*FIRMWARE.glob("*.[ch]"), FIRMWARE / "Makefile", HERE / "simulated.c"])
    digest = hashlib.sha256(b"\0".join(path.read_bytes() for path in sources)).hexdigest()[:16]
    place = Path(tempfile.gettempdir()) / f"qpal-rig-{os.getuid()}-{digest}"
    if place.is_dir():
        if place.stat().st_uid != os.getuid():
            raise InputError(f"{place} belongs to somebody else; remove it")
        return place
    folder = Path(tempfile.mkdtemp(prefix=f"{place.name}-", dir=place.parent))
    try:
        _run("make", "-C", str(FIRMWARE), f"BUILD={folder}")
        _run("gcc", "-O2", "-o", str(folder / "simulated"), str(HERE / "simulated.c"), "-lsimavr", "-lelf", "-lm")
        folder.rename(place)
    except OSError:  # another process was first
        if not place.is_dir():
            raise
    finally:
        shutil.rmtree(folder, ignore_errors=True)
    return place


def _run(*command: str) -> None:
    done = subprocess.run(command, capture_output=True, text=True)
    if done.returncode:
        lines = [line for line in done.stderr.splitlines() if "error" in line] or [done.stderr]
        raise InputError(f"{command[0]} fails ({lines[0].strip()}); it needs Debian's {PACKAGES}")


class Avr(Closing):
    """The firmware after a reset, in front of `plant`; a context manager.

    A conversion of the ADC reads its pin with a normal error of `noise` [of 1024]. `key` is the stop key, pressed or
    not. After each step `duties` are the means of that step, `enabled` the joints whose enable pin is high, `last_on`
    the last simulated time [s] at which any output was on (looked at every 62.5 us), and `conversions` the cycles at
    which conversions began, with their channels. `load` is the share of the time in which the processor did not sleep.
    """

    def __init__(self, plant: Plant, noise: float = 0.5, seed: int = 0) -> None:
        folder = build()
        command = [str(folder / "simulated"), str(folder / "firmware.elf"), str(seed), str(noise)]
        self._process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE)
        self._plant, self._queue = plant, bytearray()
        self.time, self.key = 0.0, False
        self.duties: tuple[float, ...] = (0.0, 0.0, 0.0)
        self.enabled, self.last_on, self.load = 0, 0.0, 0.0
        self.conversions: list[tuple[int, int]] = []

    def send(self, data: bytes) -> None:
        """Put bytes on the line to the board; they go out one after the other at the baud rate."""
        self._queue += data

    def step(self) -> bytes:
        """A millisecond of simulated time; the bytes that the board sent in it. Raises InputError if it crashed."""
        readings = self._plant(self.duties, STEP)
        data, self._queue = bytes(self._queue), bytearray()
        request = _REQUEST.pack(round(CLOCK * STEP), *readings, self.key, len(data)) + data
        stdin, stdout = self._process.stdin, self._process.stdout
        assert stdin is not None
        assert stdout is not None
        try:
            stdin.write(request)
            stdin.flush()
            cycle, on, *duties, enabled, stopped, conversions, n, busy = _ANSWER.unpack(stdout.read(_ANSWER.size))
        except (BrokenPipeError, struct.error):
            raise InputError("the simulated board ended; it is a fault of the firmware or of simavr") from None
        begun, sent = struct.unpack(f"<{conversions}Q", stdout.read(8 * conversions)), stdout.read(n)
        self.conversions = [(both >> 4, both & 15) for both in begun]
        self.load = busy / (cycle - self.time * CLOCK)
        self.time, self.last_on, self.duties, self.enabled = cycle / CLOCK, on / CLOCK, tuple(duties), enabled
        if stopped:
            raise InputError(f"the firmware stopped after {self.time:.3f} s of simulated time")
        return sent

    def close(self) -> None:
        """End the simulation."""
        for pipe in (self._process.stdin, self._process.stdout):
            if pipe is not None:
                pipe.close()
        self._process.wait()


class Port(Closing):
    """The firmware on the pseudo-terminal `port`, its time paced to the wall clock; a context manager.

    It never runs faster than the wall clock: what the computer was late by, `lag` [s] in all, is lost. While a host
    that was heard says nothing, time stands still for up to `patience` [s], since a busy computer may keep the host
    from saying every 10 ms that it lives; with 0 the firmware drives off after 40 ms as it does on a real board.
    """

    def __init__(self, avr: Avr, patience: float = 1.0) -> None:
        if not hasattr(os, "openpty"):
            raise InputError("this system has no pseudo-terminals; the simulated board needs Linux or macOS")
        import tty

        self.avr, self.patience, self.lag = avr, patience, 0.0
        self._ours, self._theirs = os.openpty()  # the second stays open: the first would fail while no host is there
        tty.setraw(self._theirs)
        os.set_blocking(self._ours, False)
        self.port = os.ttyname(self._theirs)
        self._end = threading.Event()
        self._thread = threading.Thread(target=self._serve, name="simulated board", daemon=True)
        self._thread.start()

    def _serve(self) -> None:
        due, heard = time.monotonic(), -math.inf
        while not self._end.is_set():
            due += STEP
            late = time.monotonic() - due
            if late < 0.0:
                time.sleep(-late)
            elif late > LATE:
                due += late
                self.lag += late
            with suppress(BlockingIOError):
                self.avr.send(os.read(self._ours, 4096))
                heard = time.monotonic()
            if QUIET < time.monotonic() - heard < self.patience:
                continue
            sent = self.avr.step()
            with suppress(BlockingIOError):  # nobody reads: the line has no memory
                os.write(self._ours, sent)

    def close(self) -> None:
        """End it, and the simulation too."""
        self._end.set()
        self._thread.join()
        os.close(self._ours)
        os.close(self._theirs)
        self.avr.close()
