"""A run as it plays, in a terminal: the last seconds of angle and voltage as bars, and any key stops the drive."""

import os
import select
import shutil
import sys
import threading
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import contextmanager, nullcontext, suppress
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import numpy as np

    from twin.rig import wire
    from twin.rig.calibration import Calibration
    from twin.rig.link import Link

SPAN = 10.0  # [s] that are shown
LABEL = 18  # letters before the bars
BLOCKS = " ▁▂▃▄▅▆▇█"
PLAIN = " .:-=+*#%@"  # where the terminal's letters have no blocks


class Trace:
    """What came of a run of `N` samples, as lines of text; `lines` may be called from another thread."""

    def __init__(self, calibration: "Calibration", N: int, Ts: float) -> None:
        self._calibration, self._N, self._Ts = calibration, N, Ts
        self._last: deque[wire.Sample] = deque(maxlen=max(round(SPAN / Ts), 1))
        self._limits = self._lost = 0
        self._next = 0

    def __call__(self, sample: "wire.Sample") -> None:
        """Take a sample as it comes."""
        if len(sample.joints) != 1:
            return
        self._last.append(sample)
        self._limits += sample.limits != 0
        self._lost += max(sample.number - self._next, 0)
        self._next = sample.number + 1

    def lines(self) -> list[str]:
        """Two rows of the angle, one of the voltage, and how it goes; none before the first sample."""
        import numpy as np

        samples = list(self._last)
        if not samples:
            return []
        c = self._calibration
        angle = np.rad2deg(c.angle(np.array([s.joints[0][0] for s in samples])))
        volts = c.volts(np.array([s.joints[0][1] for s in samples]))
        width = max(min(shutil.get_terminal_size().columns - LABEL - 1, 100), 10)
        low, high = np.rad2deg([c.soft_low or 0.0, c.soft_high or 1.0])
        upper, lower = bars(angle, low, high, width, 2)
        (level,) = bars(volts, -c.largest, c.largest, width, 1)
        left = (self._N - self._next) * self._Ts
        return [
            f"{'angle':{LABEL}}{upper}",
            f"{f'{angle[-1]:+.1f} deg':>{LABEL - 2}}  {lower}",
            f"{f'input {volts[-1]:+.1f} V':{LABEL}}{level}",
            f"{left:.0f} s left; {self._limits} samples at a limit, {self._lost} lost; any key stops it",
        ]


def bars(values: "np.ndarray", low: float, high: float, width: int, rows: int) -> list[str]:
    """Values (n,) as `width` bars over `rows` rows of letters, from `low` (none) to `high` (full).

    Each bar is the mean of its part of the values; of fewer values than bars each has one, at the right.
    """
    import numpy as np

    letters = BLOCKS if _has_blocks() else PLAIN
    steps = len(letters) - 1
    parts = np.array_split(np.asarray(values, dtype=float), min(width, len(values)))
    heights = [float(np.clip((part.mean() - low) / (high - low), 0.0, 1.0)) * rows * steps for part in parts]
    return [
        "".join(letters[round(min(max(height - steps * row, 0.0), steps))] for height in heights).rjust(width)
        for row in reversed(range(rows))
    ]


def _has_blocks() -> bool:
    try:
        BLOCKS.encode(getattr(sys.__stderr__, "encoding", "ascii"))  # in place of sys.stderr a bar has a proxy
    except UnicodeEncodeError:
        return False
    return True


@contextmanager
def played(link: "Link", note: "Callable[[wire.Sample], None]", trace: Trace, quiet: bool) -> Iterator[None]:
    """A run within which `note` and `trace` get each sample, and any key stops the rig where a person watches.

    `quiet`: nobody is told of the keys.
    """

    def watch(sample: "wire.Sample") -> None:
        note(sample)
        trace(sample)

    former, link.watch = link.watch, watch
    try:
        with any_key_stops(link) if sys.stderr.isatty() and not quiet else nullcontext():
            yield
    finally:
        link.watch = former


@contextmanager
def any_key_stops(link: "Link") -> Iterator[None]:
    """Any key that is pressed within it stops the rig, as Ctrl-C does; the terminal is as it was afterwards.

    Where standard input is no terminal, or another program has it, nothing happens.
    """
    try:
        import termios
        import tty

        keyboard = sys.stdin.fileno()
        former = termios.tcgetattr(keyboard)
        if os.tcgetpgrp(keyboard) != os.getpgrp():  # in the background: to set the terminal would halt this process
            raise OSError
    except (ImportError, OSError, ValueError, termios.error):
        yield
        return
    over = threading.Event()

    def listen() -> None:
        while not over.is_set():
            if select.select([keyboard], [], [], 0.05)[0]:
                with suppress(OSError):
                    os.read(keyboard, 100)
                link.stop()
                return

    thread = threading.Thread(target=listen, name="keys", daemon=True)
    try:
        tty.setcbreak(keyboard, termios.TCSAFLUSH)  # keys that were pressed before do not count; Ctrl-C works as ever
        thread.start()
        yield
    finally:
        over.set()
        termios.tcsetattr(keyboard, termios.TCSAFLUSH, former)
        if thread.ident is not None:
            thread.join()
