"""The line to a rig: a serial port that is held alone, the greeting, answers, and ALIVE while the rig is armed."""

import threading
import time
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from sysid.base.errors import InputError
from twin.rig import frames, wire
from twin.rig.closing import Closing

GREETING = 4.0  # [s]: a board that the opened port resets starts within 2
AGAIN = 0.1  # [s] between two frames that are said again
ANSWER = 1.0  # [s] for an answer; the firmware gives it within a few ms
POLL = 0.01  # [s] that a read of the port waits


class Lost(InputError):  # noqa: N818 - reads as what it says
    """The port is gone: a pulled cable, a board without power."""


class Link(Closing):
    """A rig on `port`, open and greeted; a context manager that stops the rig and closes the port at its end.

    `identity` is what the firmware said of itself; `rig_seconds` is how long the rig was played or read. `watch` gets
    each sample as it comes, in the loop that receives. Raises InputError where the port cannot be opened, is held by
    another program, or answers something else; every call raises Lost once the port is gone.
    """

    def __init__(self, port: str, watch: Callable[[wire.Sample], None] = lambda sample: None) -> None:
        self.port, self.watch = port, watch
        self._stopping = threading.Event()
        self._serial = open_port(port)
        self._receiver = frames.Receiver(wire.FROM_FIRMWARE)
        self._inbox: deque[tuple[int, wire.Message]] = deque()
        self._sequence, self._lock = 0, threading.Lock()
        self._foreign = 0
        self.rig_seconds = 0.0  # in which the rig was played or read
        self.fault_clock: int | None = None  # of the last FAULT that was heard: each is sent three times
        try:
            self.identity = self._greet()
        except BaseException:
            self._serial.close()
            raise

    def close(self) -> None:
        """Drive off, and the port free for others."""
        with suppress(Lost):
            self.send(wire.Stop())
        with suppress(OSError):
            self._serial.close()

    def stop(self) -> None:
        """Drive off, from any thread: whoever plays or reads gets KeyboardInterrupt, as after Ctrl-C."""
        self._stopping.set()
        with suppress(Lost):
            self.send(wire.Stop())

    @property
    def bad(self) -> int:
        """Damaged frames that have come."""
        return self._receiver.bad

    @property
    def missing(self) -> int:
        """Frames that have not come, by their numbers; those that were damaged count too."""
        return self._receiver.missing

    def send(self, message: wire.Message) -> int:
        """Send a message once; returns its sequence number."""
        with self._lock:
            sequence = self._sequence
            self._sequence = (sequence + 1) % 256
            try:
                self._serial.write(frames.frame(message, sequence))
            except (OSError, TypeError) as error:
                raise self._lost(error) from None
        return sequence

    def receive(self) -> Iterator[wire.Message]:
        """What has come; waits up to `POLL` if nothing has."""
        if not self._inbox:
            self._read()
        while self._inbox:
            yield self._inbox.popleft()[1]

    def forget(self) -> list[wire.Message]:
        """Drop what has come and was not received, as it is of the time before a run, or after its end; returns it."""
        rest = [message for _, message in self._inbox]
        self._inbox.clear()
        return rest

    def ask(self, message: wire.Message, repeat: bool = True, seconds: float = ANSWER) -> int | None:
        """The reason in the answer to a message: 0 done, else a number of `wire.REFUSALS`; None if none came.

        With `repeat` it is sent again until it is answered, which only messages allow that can be received twice.
        """
        end, sequences = time.monotonic() + seconds, set[int]()
        while time.monotonic() < end:
            if repeat or not sequences:
                sequences.add(self.send(message))
            again = min(time.monotonic() + AGAIN, end)
            while time.monotonic() < again:
                self._read()
                for entry in list(self._inbox):
                    done = entry[1]
                    if isinstance(done, wire.Done):
                        self._inbox.remove(entry)
                        if done.answered == message.code and done.sequence in sequences:
                            return done.reason
        return None

    @contextmanager
    def alive(self) -> Iterator[None]:
        """Within it the rig hears every 10 ms that its host lives; at its end, however it comes, the drive goes off."""
        over = threading.Event()

        def run() -> None:
            with suppress(Lost):
                while not over.wait(wire.ALIVE_EVERY):
                    self.send(wire.Alive())

        thread = threading.Thread(target=run, name="alive", daemon=True)
        thread.start()
        try:
            yield
        finally:
            over.set()
            thread.join()
            with suppress(Lost):
                self.send(wire.Stop())

    def _read(self) -> None:
        """Put what has come into the inbox; waits up to `POLL` if nothing has."""
        if self._stopping.is_set():
            self._stopping.clear()
            raise KeyboardInterrupt
        try:
            data = self._serial.read(self._serial.in_waiting or 1)
        except (OSError, TypeError) as error:  # pyserial reads from None where another thread has closed the port
            raise self._lost(error) from None
        self._foreign += len(data)
        for entry in self._receiver.feed(data):
            self._inbox.append(entry)
            if isinstance(entry[1], wire.Sample):
                self.watch(entry[1])

    def _greet(self) -> wire.Identity:
        end = time.monotonic() + GREETING
        while time.monotonic() < end:
            self.send(wire.Hello())
            again = time.monotonic() + AGAIN
            while time.monotonic() < again:
                for message in self.receive():
                    if isinstance(message, wire.Identity):
                        return self._check(message)
        if self._receiver.bad == 0 and self._foreign == 0:
            raise InputError(
                f"{self.port}: nothing answers; check that the board has power and the rig's firmware (docs/rig.md)"
            )
        raise InputError(
            f"{self.port}: {self._foreign} bytes came, and none is a rig's answer; another device is on this port, or "
            "the board has another program: qpal rig find lists the ports"
        )

    def _check(self, identity: wire.Identity) -> wire.Identity:
        if identity.protocol != wire.VERSION:
            raise InputError(
                f"{self.port}: the firmware speaks version {identity.protocol} of the protocol and this host version "
                f"{wire.VERSION}; flash the firmware that comes with this version"
            )
        return identity

    def _lost(self, error: Exception) -> Lost:
        return Lost(f"{self.port}: the connection is lost ({getattr(error, 'strerror', None) or error})")


def serial_library() -> Any:
    """pyserial. Raises InputError if it is not installed."""
    try:
        import serial
        import serial.tools.list_ports
    except ImportError:
        raise InputError("a rig needs pyserial, which is not installed: pip install 'qpal[rig]'") from None
    return serial


def ports() -> list[tuple[str, str]]:
    """The serial ports of this machine and what they say they are."""
    found = serial_library().tools.list_ports.comports()
    return sorted((port.device, port.description or "") for port in found)


def check_port(port: str) -> None:
    """Raises InputError where a port is not there, or another program holds it."""
    open_port(port).close()


def open_port(port: str, baud: int = wire.BAUD) -> Any:
    """The open port, held alone. Raises InputError with the reason where it does not open."""
    serial = serial_library()
    try:
        return serial.Serial(port, baud, timeout=POLL, write_timeout=1.0, exclusive=True)
    except (OSError, ValueError) as error:
        if "exclusively" in str(error) or getattr(error, "errno", None) in (11, 16):
            raise InputError(
                f"{port}: another program holds this port, perhaps another qpal rig; end it first"
            ) from None
        if getattr(error, "errno", None) == 2:
            known = ", ".join(name for name, _ in ports()) or "there are none"
            raise InputError(f"{port}: there is no such port; ports of this machine: {known}") from None
        if getattr(error, "errno", None) == 13:
            raise InputError(
                f"{port}: permission denied; on Linux add your user to the group dialout and log in again"
            ) from None
        if Path(port).exists():
            raise InputError(f"{port} is no serial port; qpal rig find lists those of this machine") from None
        raise InputError(f"{port}: cannot be opened ({error})") from None
