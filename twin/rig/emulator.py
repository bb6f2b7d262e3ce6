"""A rig without hardware: the twin's leg behind the firmware's rules, on a pseudo-terminal that `Link` opens as a port.

The leg's parameters and its wiring are drawn by a seed and hidden; `truth` tells them at the end.
"""

import os
import select
import threading
import time

import numpy as np

from sysid.base.errors import InputError
from twin.parameters import Parameters
from twin.plant.stepping import TIMESTEP
from twin.rig import frames, wire
from twin.rig.board import Board
from twin.rig.leg import Emulated, drawn_leg

REST = 2.0  # [s] in which the leg comes to rest once the drive is off
PATIENCE = 1.0  # [s] without a frame or a level that a rig faster than its time allows its host
AT_ONCE = 20  # ms of a run between two looks at the line
IDLE_FASTER = 20.0  # times the rate of samples at rest, where speed is as fast as it goes


class Emulator(Emulated):
    """A rig on the pseudo-terminal `port`, served by a thread until `close`; a context manager.

    `joint` hangs on its channel with parameters drawn by `seed`, unless `parameters` are given; its motor and sensor
    are wired either way round, unless `signs` (motor, sensor) are given. `speed` is in seconds of the leg per second;
    None is as fast as the host keeps up, and then the rig waits for its host up to `PATIENCE` where the firmware would
    not. Of the frames each way the share `garbled` has a damaged byte and the share `lost` never arrives. A run depends
    on the seed and on what was played before, not on the clock of the machine.
    """

    kind = "twin"

    def __init__(
        self,
        joint: str = "thigh",
        seed: int = 0,
        parameters: Parameters | None = None,
        without: tuple[str, ...] = (),
        speed: float | None = None,
        garbled: float = 0.0,
        lost: float = 0.0,
        signs: tuple[int, int] | None = None,
        name: str = "qpal twin",
    ) -> None:
        if not hasattr(os, "openpty"):
            raise InputError("this system has no pseudo-terminals; the emulated rig needs Linux or macOS")
        self.plant = drawn_leg(joint, seed, parameters, without, signs)
        self.board = Board(self.plant, name)
        self.seed, self.full, self.speed = seed, self.plant.full, speed
        self._garbled, self._lost, self._runs = garbled, lost, 0
        self._rng = np.random.default_rng([seed, 40])
        self._rng.choice((-1, 1), 2)  # `drawn_leg` has taken these
        self._sequence, self._heard = 0, -np.inf
        self._receiver = frames.Receiver(wire.FROM_HOST)
        self._closing, self._pulled = threading.Event(), False
        self._master, self._slave = os.openpty()
        _make_raw(self._slave)
        os.set_blocking(self._master, False)
        self.port = os.ttyname(self._slave)
        self._thread = threading.Thread(target=self._serve, name="emulated rig", daemon=True)
        self._thread.start()

    def close(self) -> None:
        """The rig is gone."""
        self._closing.set()
        self._thread.join()
        self.pull()

    def pull(self) -> None:
        """Pull the cable: the port is gone for the host, the rig lives on."""
        if not self._pulled:
            self._pulled = True
            os.close(self._master)
            os.close(self._slave)

    # The thread.

    def _serve(self) -> None:
        began, sent_idle = time.monotonic(), 0.0
        idle = 1.0 / wire.IDLE_RATE / (self.speed or IDLE_FASTER)
        while not self._closing.is_set():
            running = self.board.state == wire.RUNNING
            self._listen(0.0 if running and not self._waits() else 0.002)
            now = time.monotonic()
            quiet = now - self._heard
            if self.board.state in (wire.ARMED, wire.RUNNING) and quiet > (wire.LINK if self.speed == 1 else PATIENCE):
                self.board.fail(wire.LINK_LOST)
            if self.board.state == wire.RUNNING:
                if not running:
                    began, self._ticks = now, 0
                    self._begin()
                self._advance(now - began, quiet)
            elif self.board.state != wire.ARMED and quiet < 0.5 and now - sent_idle > idle:
                sent_idle = now
                self.board.idle_sample()
            self._flush()
            if running and self.board.state != wire.RUNNING:
                self.plant.logs = False
                self.plant.rest(REST)

    def _begin(self) -> None:
        self._runs += 1
        self._fate, self.plant.logs = np.random.default_rng([self.seed, 42, self._runs]), True

    def _waits(self) -> bool:
        """Whether the leg waits for levels from its host, in a rig that is faster than its time."""
        return self.speed is None and self.board.hungry

    def _advance(self, elapsed: float, quiet: float) -> None:
        """Some milliseconds of the run, as many as its clock is behind."""
        due = AT_ONCE if self.speed is None else int(elapsed * self.speed / TIMESTEP) - self._ticks
        for _ in range(max(due, 0)):
            if self.board.state != wire.RUNNING or (self._waits() and quiet < PATIENCE):
                return
            self.board.tick()
            self._ticks += 1
        if due <= 0:
            time.sleep(TIMESTEP)

    def _listen(self, seconds: float) -> None:
        """Take what the host has sent."""
        if self._pulled:
            time.sleep(seconds or TIMESTEP)
            return
        try:
            if not select.select([self._master], [], [], seconds)[0]:
                return
            data = os.read(self._master, 4096)
        except (OSError, ValueError):  # the port was closed meanwhile
            return
        *lines, rest = data.split(b"\0")
        kept = [*(self._damage(line, self._rng) for line in lines), rest]
        for sequence, message in self._receiver.feed(b"\0".join(kept)):
            self._heard = time.monotonic()
            self.board.answer(sequence, message)
        self.board.bad = self._receiver.bad
        if self._receiver.row >= wire.STORM and self.board.state in (wire.ARMED, wire.RUNNING):
            self.board.fail(wire.NOISY)

    def _damage(self, line: bytes, rng: np.random.Generator) -> bytes:
        """A line without its zero as it arrives: as it was, garbled, or not at all."""
        fate = rng.random()
        if fate < self._lost or not line:
            return b""
        if fate >= self._lost + self._garbled:
            return line
        place = int(rng.integers(len(line)))
        return line[:place] + bytes([line[place] ^ int(rng.integers(1, 256))]) + line[place + 1 :]

    def _flush(self) -> None:
        """Send what the board has to say."""
        messages, self.board.outbox = self.board.outbox, []
        data = b""
        for message in messages:
            in_run = isinstance(message, wire.Sample) and message.state in (wire.RUNNING, wire.ENDED) and self._runs
            line = frames.frame(message, self._sequence)[:-1]
            self._sequence += 1
            data += self._damage(line, self._fate if in_run else self._rng) + b"\0"
        while data and not self._pulled and not self._closing.is_set():
            try:
                select.select([], [self._master], [], 0.1)
                data = data[os.write(self._master, data) :]
            except BlockingIOError:
                if time.monotonic() - self._heard > PATIENCE:
                    return  # nobody reads
                self._listen(0.0)
            except (OSError, ValueError):
                return


def _make_raw(terminal: int) -> None:
    """No echo, no translation of line ends."""
    import tty

    tty.setraw(terminal)
