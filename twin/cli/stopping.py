"""Ctrl-C and SIGTERM end a run, also where the first request is lost.

A KeyboardInterrupt that rises within a callback (of a compiled kernel, a destructor, a library that catches all) is
printed or dropped by Python, and the run would go on for hours. So the request is repeated twice a second until it is
handled. While the interrupt is being handled, which is when folders are removed, nothing is raised.
"""

import os
import signal
import sys
from contextlib import suppress
from types import FrameType, TracebackType
from typing import Any

AGAIN = 0.5  # [s] between two requests


class Stopping:
    """A context within which SIGINT and SIGTERM raise KeyboardInterrupt until it is handled; former handlers return.

    Outside the main thread, where Python sets no handlers, it does nothing. A signal that is ignored stays ignored.
    """

    def __init__(self) -> None:
        self._former: dict[int, Any] = {}
        self._process = os.getpid()
        self._over = False

    def __enter__(self) -> "Stopping":
        with suppress(ValueError):  # not in the main thread
            for number in (signal.SIGINT, signal.SIGTERM):
                if signal.getsignal(number) is not signal.SIG_IGN:
                    self._former[number] = signal.signal(number, self._stop)
            if hasattr(signal, "SIGALRM"):
                self._former[signal.SIGALRM] = signal.signal(signal.SIGALRM, self._stop)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, where: TracebackType | None
    ) -> None:
        self.over()
        for number, handler in self._former.items():
            signal.signal(number, handler)

    def over(self) -> None:
        """Nothing is raised from here on; to be called where the interrupt is handled."""
        self._over = True
        self._repeat(0.0)

    def _stop(self, number: int, frame: FrameType | None) -> None:
        if self._over:
            return
        self._repeat(AGAIN)
        if not _handled(sys.exception()):
            raise KeyboardInterrupt

    def _repeat(self, seconds: float) -> None:
        timed = hasattr(signal, "SIGALRM") and signal.SIGALRM in self._former
        if timed and os.getpid() == self._process:  # a forked child ends with its parent
            signal.signal(signal.SIGALRM, self._stop)  # a time limit of a part of the run may have taken it
            signal.setitimer(signal.ITIMER_REAL, seconds)


def _handled(error: BaseException | None) -> bool:
    """Whether a KeyboardInterrupt, or what was raised because of one, is being handled: cleanup has begun."""
    while error is not None:
        if isinstance(error, KeyboardInterrupt):
            return True
        error = error.__context__
    return False
