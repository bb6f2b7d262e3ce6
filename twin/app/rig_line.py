"""The process that holds the line to a rig for the app, apart from the page's own work: one port, one drive.

It gets orders as lines of JSON on standard input and answers in lines of JSON on standard output. While the rig moves
somebody has to send beats: where none comes for `SILENT`, and where standard input ends, the drive goes off and the log
up to there is written.
"""

import json
import os
import sys
import threading
import time
from collections.abc import Callable, Iterable
from contextlib import ExitStack, suppress
from dataclasses import replace
from math import degrees, radians
from pathlib import Path
from queue import Empty, SimpleQueue
from typing import Any, TextIO

import numpy as np

from sysid.base.errors import InputError
from twin.rig import calibration as calibrations
from twin.rig import wire, wiring
from twin.rig.calibration import Calibration
from twin.rig.journal import journal
from twin.rig.link import Link, Lost
from twin.rig.room import LINE, room_for
from twin.rig.run import Input, check_input, log_of, play, read_input

SILENT = 3.0  # [s] without a beat; the page sends five a second
TOLD = 0.2  # [s] between two answers with samples
ALIVE = 0.1  # [s] between two ALIVE at rest, each of which asks for samples of half a second
LAST = 10.0  # [s] for the log, once nobody listens any more
BY_HAND, CLOSED = "it was stopped by hand", "the page that moved it does not answer any more"

Tell = Callable[..., None]


def _nothing(sample: wire.Sample) -> None:
    """No run plays."""


class RigLine:
    """The orders of the app on an open link, one after the other; `folder` is for logs."""

    def __init__(self, link: Link, folder: Path, tell: Tell, emulator: Any = None) -> None:
        self._link, self._folder, self._tell, self._emulator = link, folder, tell, emulator
        self._orders, self._answers = SimpleQueue[dict[str, Any]](), SimpleQueue[float]()
        self._moving, self._closing = False, threading.Event()
        self._beat = self._told = self._asked = 0.0
        self._why, self._given = BY_HAND, Input(np.zeros(0), 1.0)
        self._rows: list[tuple[float, int, int, int, int]] = []
        self._start, self._last, self._Ts = 0.0, -1, wiring.TS
        self._note: Callable[[wire.Sample], None] = _nothing  # where a run keeps its samples
        self._board = wiring.board_on(link, None if emulator is None else emulator.seed)
        link.watch = self._see

    # In a thread of its own.

    def listen(self, lines: Iterable[str]) -> None:
        """Take orders until there are no more; then the drive goes off and this process ends."""
        threading.Thread(target=self._guard, daemon=True).start()
        for line in lines:
            order = json.loads(line)
            if order["do"] == "beat":
                self._beat = time.monotonic()
            elif order["do"] == "stop":
                self._stop(order["why"] or BY_HAND)
            elif order["do"] == "answer":
                self._answers.put(order["value"])
            else:
                self._beat = time.monotonic()
                self._orders.put(order)
        self._closing.set()
        self._stop("the app has ended")
        time.sleep(LAST)
        os._exit(1)

    def _guard(self) -> None:
        while not self._closing.wait(0.1):
            if self._moving and time.monotonic() - self._beat > SILENT:
                self._stop(CLOSED)

    def _stop(self, why: str) -> None:
        """Drive off; orders that wait are not done."""
        if self._moving:
            self._why = why
        self._link.stop()
        with suppress(Empty):
            while order := self._orders.get_nowait():
                self._tell(failed=why, at=order["do"])

    # In the main thread.

    def work(self) -> None:
        """Do orders, and read the sensors in between, until nobody listens or the port is gone."""
        while not self._closing.is_set():
            try:
                order = self._orders.get_nowait()
            except Empty:
                with suppress(KeyboardInterrupt):
                    self._rest()
                continue
            self._do(order)

    def _do(self, order: dict[str, Any]) -> None:
        """Do an order; what goes wrong is told as a sentence."""
        self._moving, self._why = order["do"] != "input", BY_HAND
        self._rows.clear()
        self._start, self._last, self._Ts = 0.0, -1, wiring.TS
        try:
            ORDERS[order["do"]](self, order)
        except Lost:
            raise
        except InputError as error:
            self._tell(failed=str(error), at=order["do"])
        except OSError as error:
            self._tell(failed=f"a file cannot be read or written ({error.strerror or error})", at=order["do"])
        except KeyboardInterrupt:
            self._tell(failed=f"{self._why}; the drive is off", at=order["do"])
        finally:
            self._moving = False
            self._flush()
        self._tell(done=order["do"])

    def _rest(self) -> None:
        """A look at the sensors with the drive off."""
        now = time.monotonic()
        if now - self._asked > ALIVE:
            self._asked = now
            self._link.send(wire.Alive())
        for _ in self._link.receive():
            pass

    def _see(self, sample: wire.Sample) -> None:
        """Keep a sample for the page: of all joints at rest, or of the one that moves."""
        self._note(sample)
        readings = [reading for reading, _ in sample.joints] if len(sample.joints) == wire.JOINTS else []
        if not readings:
            if sample.number <= self._last:  # another pulse
                self._start += (self._last + 1) * self._Ts
            self._last = sample.number
            t = self._start + sample.number * self._Ts
            self._rows.append((round(t, 6), *sample.joints[0], sample.supply, sample.limits))
        if time.monotonic() - self._told > TOLD:
            self._flush(readings)

    def _flush(self, readings: Iterable[int] = ()) -> None:
        """Tell what came since the last time."""
        self._told = time.monotonic()
        rows, self._rows = self._rows, []
        if rows or readings:
            self._tell(rows=rows, readings=list(readings))

    def _say(self, sentence: str) -> None:
        self._tell(said=sentence)

    def _wire(self, order: dict[str, Any]) -> None:
        """How the joint is wired, by pulses."""
        linearity = 0.0 if self._emulator is None else self._emulator.linearity
        values = {name: order[name] for name in ("joint", "channel", "supply", "largest")}
        start = calibrations.of_joint(self._link.port, **values, linearity=linearity, board=self._board)
        self._tell(calibration=wiring.find_wiring(self._link, start, self._say).model_dump())

    def _zero(self, order: dict[str, Any]) -> None:
        """Where its ends are, and their angles."""
        known = Calibration.model_validate(order["calibration"])
        ends = wiring.find_ends(self._link, known, self._say, self._angle)
        self._tell(calibration=wiring.zero(known, ends).model_dump())

    def _angle(self, end: str, counts: float) -> float:
        """The angle [rad] of an end, asked on the page; an emulated leg has a protractor."""
        guess = None if self._emulator is None else round(degrees(self._emulator.plant.angle_of(counts)), 3)
        with suppress(Empty):
            while True:
                self._answers.get_nowait()
        self._tell(question=end, counts=counts, guess=guess)
        while True:
            with suppress(Empty):
                return radians(self._answers.get_nowait())
            self._rest()

    def _input(self, order: dict[str, Any]) -> None:
        """Look at an input and keep it for the run; without a file it is the first sweep."""
        known = Calibration.model_validate(order["calibration"])
        if order["path"] is None:
            from twin.rig.auto import first_input

            given = first_input(known, 0)
        else:
            try:
                given = read_input(order["path"])
            except InputError as error:
                raise InputError(str(error).replace(order["path"], order["name"])) from None
        given = replace(given, source=order["name"])
        check_input(given, known)
        self._given = given
        self._tell(given=order["name"], key=order["key"], u=given.u.round(4).tolist(), Ts=given.Ts)

    def _run(self, order: dict[str, Any]) -> None:
        """Play the input and write the log."""
        known, given = Calibration.model_validate(order["calibration"]), self._given
        levels = check_input(given, known)
        wiring.check_rig(self._link, known, self._board, "the wire check of this page")
        self._Ts = given.Ts
        setup = known.setup(self._link.identity.full, known.patience(levels, given.Ts))
        path = self._folder / order["file"]
        with journal(path, self._link, known, levels, given.Ts, given.source) as note:
            self._note = note
            try:
                with room_for(path, LINE * len(levels)):
                    recording = play(self._link, setup, levels, given.Ts)
            finally:
                self._note = _nothing
            if recording.interrupted:
                recording = replace(recording, reason=self._why)
            log = log_of(recording, known, self._link, given.source)
            n = len(recording.counts)
            if n:
                log.save(path)
        self._tell(log=path.name if n else None, n=n, reason=recording.reason, notes=log.meta["notes"])


ORDERS: dict[str, Callable[[RigLine, dict[str, Any]], None]] = {
    "wire": RigLine._wire,
    "zero": RigLine._zero,
    "input": RigLine._input,
    "run": RigLine._run,
}


def main() -> int:
    """Open the port of the first line, then do the orders of the others."""
    answers, lock = os.fdopen(os.dup(1), "w", encoding="utf-8"), threading.Lock()
    os.dup2(2, 1)  # what a library prints is no answer

    def tell(**answer: Any) -> None:
        with lock, suppress(OSError):  # the app may have ended; the log is written all the same
            answers.write(json.dumps(answer) + "\n")
            answers.flush()

    return connect(json.loads(sys.stdin.readline()), sys.stdin, tell)


def connect(request: dict[str, Any], lines: TextIO, tell: Tell) -> int:
    """Hold the line that is asked for until it ends; what goes wrong is told as a sentence."""
    try:
        with ExitStack() as stack:
            emulator, port = None, request["port"]
            if port is None:
                from twin.rig.emulator import Emulator

                emulator = stack.enter_context(Emulator(request["joint"], request["seed"], speed=request["speed"]))
                port = emulator.port
            link = stack.enter_context(Link(port))
            who, supply = link.identity, None if emulator is None else emulator.supply
            line = RigLine(link, Path(request["folder"]), tell, emulator)
            threading.Thread(target=line.listen, args=(lines,), daemon=True).start()
            tell(connected=port, firmware=who.release, full=who.full, supply=supply)
            line.work()
    except InputError as error:
        tell(failed=str(error), at="connect")
    return 0


if __name__ == "__main__":
    sys.exit(main())
