"""Ctrl-C, SIGTERM, a closed terminal and the warnings of batch systems end a run, also where the first request is lost.

A KeyboardInterrupt that rises within a callback (of a compiled kernel, a destructor, a library that catches all) is
printed or dropped by Python, and the run would go on for hours. So the request is repeated twice a second until it is
handled. While the interrupt is being handled, which is when folders are removed, nothing is raised; nor while results
are moved into place, after which the request is made again.
"""

import os
import signal
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from types import FrameType, TracebackType
from typing import Any

AGAIN = 0.5  # [s] between two requests
# Ctrl-C, a closed terminal, and how batch systems announce an end. A default action would leave what was half made.
NAMES = ("SIGINT", "SIGTERM", "SIGHUP", "SIGUSR1", "SIGUSR2", "SIGXCPU")
NUMBERS = tuple(getattr(signal, name) for name in NAMES if hasattr(signal, name))
_held, _late = 0, False


@contextmanager
def hold_requests() -> Iterator[None]:
    """What happens within it happens whole: a request to stop waits for its end."""
    global _held, _late
    _held += 1
    try:
        yield
    finally:
        _held -= 1
    if _late and not _held:
        _late = False
        if not caused_by(sys.exception(), KeyboardInterrupt):
            raise KeyboardInterrupt


@contextmanager
def exit_on_signal(sentence: str) -> Iterator[None]:
    """The signals of `NUMBERS` end the process with `sentence` and code 130, for as long as it has done nothing.

    Nothing is raised: an import that is interrupted may drop the interrupt, or report an error of its own.
    """

    def end(number: int, frame: FrameType | None) -> None:
        with suppress(OSError):
            os.write(2, f"{sentence}\n".encode())
        os._exit(130)

    former = _set(end)
    try:
        yield
    finally:
        for number, handler in former.items():
            signal.signal(number, handler)


def _set(handler: Any) -> dict[int, Any]:
    """Sets the handler of all signals; returns the former ones. One that is ignored stays ignored."""
    former: dict[int, Any] = {}
    with suppress(ValueError):  # not in the main thread
        for number in NUMBERS:
            if signal.getsignal(number) is not signal.SIG_IGN:
                former[number] = signal.signal(number, handler)
    return former


def stay_ignored() -> None:
    """Ctrl-C that is ignored, as in the background of a script, stays so: polars takes it when it is first imported."""
    if threading.current_thread() is threading.main_thread() and signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
        import polars  # noqa: F401

        signal.signal(signal.SIGINT, signal.SIG_IGN)


class Stopping:
    """A context within which the signals of `NUMBERS` raise KeyboardInterrupt until it is handled.

    Former handlers return at its end.

    Outside the main thread, where Python sets no handlers, it does nothing. A signal that is ignored stays ignored.
    `asked` says whether a signal has come, `why` what is known of its cause. At the end of a whole `program` all are
    ignored from then on: the work is done and said, and Python would answer a request with a traceback while it ends.
    """

    def __init__(self, program: bool = False) -> None:
        self._program = program
        self._former: dict[int, Any] = {}
        self._process = os.getpid()
        self._over = False
        self._unraised = sys.unraisablehook
        self.asked = False
        self.why = ""

    def __enter__(self) -> "Stopping":
        self._former = _set(self._stop)
        if self._former and hasattr(signal, "SIGALRM"):
            self._former[signal.SIGALRM] = signal.signal(signal.SIGALRM, self._stop)
            self._unraised, sys.unraisablehook = sys.unraisablehook, self._print_unraisable
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        self.finish()
        sys.unraisablehook = self._unraised
        for number, handler in self._former.items():
            signal.signal(number, signal.SIG_IGN if self._program and number in NUMBERS else handler)

    def finish(self) -> None:
        """Nothing is raised from here on; to be called where the interrupt is handled."""
        global _late
        self._over, _late = True, False
        self._repeat(0.0)

    def _stop(self, number: int, frame: FrameType | None) -> None:
        """The handler of all signals: interrupts the run, now or once what must be whole is done."""
        if self._over:
            return
        self.asked = self.asked or number in NUMBERS
        if number == getattr(signal, "SIGXCPU", None):
            self.why = " at the limit of processor time, see ulimit -t"
        self._repeat(AGAIN)
        if _held:
            global _late
            _late = True
        elif not caused_by(sys.exception(), KeyboardInterrupt):
            raise KeyboardInterrupt

    def _print_unraisable(self, arguments: "sys.UnraisableHookArgs") -> None:
        """Prints what Python cannot raise, but for a request that is lost in a callback: it is repeated."""
        if not issubclass(arguments.exc_type, KeyboardInterrupt):
            self._unraised(arguments)

    def _repeat(self, seconds: float) -> None:
        has_timer = hasattr(signal, "SIGALRM") and signal.SIGALRM in self._former
        if has_timer and os.getpid() == self._process:  # a forked child ends with its parent
            signal.signal(signal.SIGALRM, self._stop)  # a time limit of a part of the run may have taken it
            signal.setitimer(signal.ITIMER_REAL, seconds)


def caused_by(error: BaseException | None, kind: type[BaseException]) -> bool:
    """Whether an error of this kind is being handled, or what was raised because of one."""
    while error is not None:
        if isinstance(error, kind):
            return True
        error = error.__context__
    return False
