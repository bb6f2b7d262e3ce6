"""The rig as the page sees it: the line that is open, what moves, what comes back, and what is asked meanwhile.

The line itself is a process of its own, `twin.app.rig_line`, so that nothing that the page does delays it. One app has
one rig, whatever the number of its windows, and a port is opened only when a person connects.
"""

import json
import shutil
import subprocess
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from sysid.base.errors import InputError
from sysid.base.locks import new_scratch_folder
from twin.app.jobs import kill, last_words, worker
from twin.app.rig_words import words_of_page
from twin.parameters import JOINTS
from twin.rig import calibration as calibrations
from twin.rig.calibration import Calibration
from twin.rig.link import ports

OFF, CONNECTING, READY, MOVING = "off", "connecting", "ready", "moving"
PLACES = {"wire": "the wire check", "zero": "the run to the ends", "input": "the look at an input", "run": "a run"}
GONE = 5.0  # [s] that the process has to write a log and end
MOST_SAID = 40  # sentences of a wire check


@dataclass(frozen=True)
class Port:
    """The rig that is connected; `supply` [V] is that of an emulated one, None for a board."""

    name: str
    firmware: str
    full: int
    emulated: str = ""
    supply: float | None = None


@dataclass(frozen=True)
class Question:
    """At which angle [deg] the joint stands now, at the `end` whose reading is `counts`."""

    end: str
    counts: float
    guess: float | None


@dataclass(frozen=True)
class Chosen:
    """The input u (N,) [V] for the next run, and which of the page's choices it is."""

    key: str
    name: str
    u: np.ndarray
    Ts: float

    @property
    def words(self) -> str:
        """What it is in a sentence."""
        length, largest = len(self.u) * self.Ts, float(np.abs(self.u).max())
        return f"{len(self.u):,} levels, one every {self.Ts:g} s: {length:.1f} s, at most {largest:.2f} V"


@dataclass(eq=False)
class Seen:
    """What came of the rig: `rows` are t [s], counts, duty, supply [counts] and bits of limits of the joint that moves,
    `readings` the counts of all joints at rest. `calibration` and `plan` are those of the movement."""

    rows: list[tuple[float, int, int, int, int]] = field(default_factory=list)
    readings: tuple[int, ...] = ()
    calibration: Calibration | None = None
    plan: Chosen | None = None


class Rig:
    """The rig of a session. `folder` is the session's; `keep` takes a log into it and gives the id of its record.

    `problems` has a sentence for each place of the page where something was refused or went wrong, `said` those of a
    wire check.
    `version` rises with every change but samples, which `seen` collects.
    """

    def __init__(self, folder: Path, keep: Callable[[Path, str, str], str]) -> None:
        self.folder, self._keep = folder, keep
        self.state, self.doing, self.version = OFF, "", 0
        self.port: Port | None = None
        self.calibration: Calibration | None = None
        self.question: Question | None = None
        self.chosen: Chosen | None = None
        self.problems: dict[str, str] = {}
        self.said: list[str] = []
        self.record, self.result = "", ""  # of the last run
        self.seen = Seen()
        self._process: subprocess.Popen[str] | None = None
        self._lock = threading.RLock()

    @property
    def file(self) -> Path:
        """Where the calibration of this rig is kept; that of an emulated one never replaces a real one's."""
        emulated = self.port.emulated if self.port else ""
        return self.folder / (f"rig-{emulated}.toml" if emulated else "rig.toml")

    def ports(self) -> dict[str, str]:
        """The serial ports of this machine, by name, with what they say they are."""
        return dict(ports())

    # What a person does.

    def connect(self, port: str | None, joint: str = "thigh", seed: int = 1, speed: float = 2.0) -> None:
        """Open a port, or put an emulated leg in its place; refused where one is open already."""
        with self._lock, self._at("connect"):
            if self.state != OFF:
                raise InputError(f"this app has a rig already, {self.port.name if self.port else 'or opens one'}")
            if port is None and (joint not in JOINTS or not 0.1 <= speed <= 100.0 or seed < 0):
                raise InputError(
                    f"an emulated leg is one of {', '.join(JOINTS)}, 0.1 to 100 times as fast, seed from 0"
                )
            if port is not None and not port.strip():
                raise InputError("no port is chosen")
            logs = self.folder / "rig"
            logs.mkdir(exist_ok=True)
            self._scratch = new_scratch_folder()
            self._process = worker(self._scratch, "twin.app.rig_line")
            emulated = "" if port is not None else f"{joint}-{int(seed)}"
            self.port = Port(port or f"emulated {joint}, seed {int(seed)}", "", 0, emulated)
            self._send(port=port, joint=joint, seed=int(seed), speed=float(speed), folder=str(logs))
            self._enter(CONNECTING, "connect")
            self._thread = threading.Thread(target=self._follow, args=(self._process,), daemon=True)
            self._thread.start()

    def disconnect(self) -> None:
        """Drive off, and the port free for others."""
        process = self._process
        if process is None:
            return
        with suppress(OSError):
            assert process.stdin is not None
            process.stdin.close()
        try:
            process.wait(GONE)
        except subprocess.TimeoutExpired:
            kill(process)
        self._thread.join()

    def use(self, path: str) -> None:
        """Take the calibration in a file of this machine into the session."""
        with self._lock, self._at("calibration"):
            self._ready()
            self.calibration = calibrations.read(Path(path.strip()).expanduser())
            calibrations.write(self.calibration, self.file)
            self.chosen = None

    def find_wiring(self, joint: str, channel: int | None, supply: float | None, largest: float | None) -> None:
        """Move the joint by small pulses to see how it is wired."""
        with self._lock, self._at("wire"):
            if None in (channel, supply, largest):
                raise InputError("a number is missing; give the joint's number, the supply and the largest input")
            assert channel is not None
            if channel != int(channel):
                raise InputError(f"the joint's number is {channel:g}; give 0, 1 or 2")
            self._order("wire", joint=joint, channel=int(channel), supply=supply, largest=largest)

    def find_ends(self) -> None:
        """Run slowly into both ends; their angles are asked meanwhile."""
        with self._lock, self._at("zero"):
            self._order("zero", calibration=self._known().model_dump())

    def choose(self, key: str, name: str, path: Path | None) -> None:
        """Take the input in a file for the next run; without a file, a first sweep."""
        with self._lock, self._at("input"):
            self.chosen = None
            calibration = self._known(zeroed=True).model_dump()
            self._order("input", key=key, name=name, path=None if path is None else str(path), calibration=calibration)

    def run(self) -> None:
        """Play the chosen input."""
        with self._lock, self._at("run"):
            if self.chosen is None:
                raise InputError("no input is chosen")
            self.record = self.result = ""
            self._order(
                "run",
                calibration=self._known(zeroed=True).model_dump(),
                file=time.strftime("run-%Y%m%d-%H%M%S.csv"),
            )
            self.seen.plan = self.chosen

    def answer(self, degrees: float | None) -> None:
        """The angle at which the joint stands."""
        with self._lock, self._at("question"):
            if self.question is None:
                return
            if degrees is None or not abs(degrees) <= 3600.0:
                raise InputError("give the angle in degrees")
            self.question = None
            self._send(do="answer", value=float(degrees))

    def stop(self, why: str = "") -> None:
        """Drive off, now; also where nothing seems to move."""
        self._send(do="stop", why=why)

    def beat(self) -> None:
        """The window that moves the rig is there, and can stop it."""
        if self.state == MOVING:
            self._send(do="beat")

    # How that is done.

    @property
    def driving(self) -> bool:
        """Whether the drive may be on, now or in a moment."""
        return self.state == MOVING and self.doing != "input"

    def _at(self, place: str) -> "_Place":
        return _Place(self, place)

    def _ready(self) -> None:
        """Raises InputError where nothing can be begun."""
        if self.state == MOVING:
            raise InputError(f"the rig is busy with {PLACES[self.doing]}; stop it, or wait for its end")
        if self.state != READY:
            raise InputError("no rig is connected")

    def _known(self, zeroed: bool = False) -> Calibration:
        if self.calibration is None:
            raise InputError("it is not known yet how the joint is wired; check the wiring first")
        if zeroed and not self.calibration.is_zeroed:
            raise InputError("the ends have no angles yet; find the ends first")
        return self.calibration

    def _order(self, do: str, **fields: Any) -> None:
        self._ready()
        self.problems.clear()
        if do in ("wire", "zero"):
            self.said = []
        if do != "input":
            self.seen = Seen(readings=self.seen.readings, calibration=self.calibration)
        self._enter(MOVING, do)
        self._send(do=do, **fields)

    def _enter(self, state: str, doing: str = "") -> None:
        self.state, self.doing = state, doing
        self.version += 1

    def _send(self, **order: Any) -> None:
        """Hand a line to the process; one that has ended says so by itself."""
        process = self._process
        if process is not None and process.stdin is not None:
            with suppress(OSError, ValueError):
                process.stdin.write(json.dumps(order) + "\n")
                process.stdin.flush()

    def _follow(self, process: "subprocess.Popen[str]") -> None:
        """Take what the process says until it ends."""
        assert process.stdin is not None
        assert process.stdout is not None
        for text in process.stdout:
            answer = json.loads(text)
            with self._lock:
                try:
                    self._hear(answer)
                except (InputError, OSError) as error:  # the session's disk
                    self.problems[self.doing or "connect"] = str(error)
                    self.version += 1
        code = process.wait()
        for pipe in (process.stdin, process.stdout):
            with suppress(OSError):
                pipe.close()
        with self._lock:
            if code:
                self.problems["connect"] = last_words(self._scratch, code)
            elif self.state != OFF and "connect" not in self.problems:
                self.problems["connect"] = "the connection has ended"
            self.port = self.question = self.chosen = self.calibration = self._process = None
            self._enter(OFF)
        shutil.rmtree(self._scratch, ignore_errors=True)

    def _hear(self, answer: dict[str, Any]) -> None:
        """Take one answer."""
        if "rows" in answer:
            self.seen.rows += [tuple(row) for row in answer["rows"]]
            self.seen.readings = tuple(answer["readings"]) or self.seen.readings
            return
        self.version += 1
        if "connected" in answer:
            assert self.port is not None
            name = self.port.name if self.port.emulated else answer["connected"]
            self.port = Port(name, answer["firmware"], answer["full"], self.port.emulated, answer["supply"])
            self._enter(READY)
            if self.file.exists():
                with self._at("calibration"):
                    self.calibration = calibrations.read(self.file)
        elif "failed" in answer:
            self.problems[answer["at"]] = words_of_page(answer["failed"])
        elif "said" in answer:
            self.said = [*self.said, words_of_page(answer["said"])][-MOST_SAID:]
        elif "question" in answer:
            self.question = Question(answer["question"], answer["counts"], answer["guess"])
        elif "calibration" in answer:
            self.calibration, self.chosen = Calibration.model_validate(answer["calibration"]), None
            calibrations.write(self.calibration, self.file)
        elif "given" in answer:
            self.chosen = Chosen(answer["key"], answer["given"], np.array(answer["u"]), answer["Ts"])
        elif "log" in answer:
            self._take_log(answer)
        elif "done" in answer:
            self.question = None
            self._enter(READY)

    def _take_log(self, answer: dict[str, Any]) -> None:
        """The log of a run becomes a record of the session."""
        early = f"the run ended early: {answer['reason']}; the drive is off" if answer["reason"] else ""
        if answer["log"] is not None:
            assert self.calibration is not None
            assert self.seen.plan is not None
            name = f"rig {self.calibration.joint}, {self.seen.plan.name}"
            self.record = self._keep(self.folder / "rig" / answer["log"], self.calibration.joint, name)
        notes = [note for note in answer["notes"] if not note.startswith("the run ended early")]
        self.result = "; ".join([f"{answer['n']:,} samples", *notes])
        if early:
            self.problems["run"] = early


class _Place:
    """A part of the page: the sentence of what goes wrong stands there, and ends the block."""

    def __init__(self, rig: Rig, place: str) -> None:
        self._rig, self._place = rig, place

    def __enter__(self) -> None:
        self._rig.problems.pop(self._place, None)
        self._rig.version += 1

    def __exit__(self, kind: Any, error: BaseException | None, trace: Any) -> bool:
        if isinstance(error, OSError):
            error = InputError(f"a file cannot be read or written ({error.strerror or error})")
        if isinstance(error, InputError):
            self._rig.problems[self._place] = words_of_page(str(error))
        return isinstance(error, InputError)
