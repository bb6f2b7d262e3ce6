"""A rig without hardware: the twin's leg behind the firmware's rules, on a pseudo-terminal that `Link` opens as a port.

The leg's parameters and its wiring are drawn by a seed and hidden; `truth` tells them at the end.
"""

import os
import select
import threading
import time
from collections import deque

import mujoco
import numpy as np

from sysid.base.errors import InputError
from twin.bench.standin import draw_parameters
from twin.experiment import SETTLE, Experiment
from twin.hardware.potentiometer import potentiometer
from twin.parameters import JOINTS, Parameters
from twin.plant import slots
from twin.plant.stepping import TIMESTEP, boards
from twin.rig import frames, wire
from twin.rig.board import Board
from twin.rig.closing import Closing
from twin.studies.beyond import twin_truth

REST = 2.0  # [s] in which the leg comes to rest once the drive is off
PATIENCE = 1.0  # [s] without a frame or a level that a rig faster than its time allows its host
AT_ONCE = 20  # ms of a run between two looks at the line
IDLE_FASTER = 20.0  # times the rate of samples at rest, where speed is as fast as it goes
BITS_WITHOUT_ADC = 15
DIVIDER = 2.5  # volts of a full reading of the supply, in nominal supplies
# What the rig does in its own way: the line loses samples, and the firmware's clock does not jitter.
ELSEWHERE = ("jitter", "dropouts")
TROUBLES = ("unplugged", "stuck", "reversed", "no supply")


class LegPlant:
    """One joint of the leg on its channel of the board, stepped by MuJoCo; the other channels rest at mid range.

    `motor_sign` and `sensor_sign` are the wiring. `trouble` is one of `TROUBLES` or empty.
    """

    def __init__(self, experiment: Experiment, motor_sign: int, sensor_sign: int) -> None:
        self.experiment, self.motor_sign, self.sensor_sign = experiment, motor_sign, sensor_sign
        self.channel, self.trouble = JOINTS.index(experiment.joint), ""
        p = experiment.p
        self.pot = potentiometer(p, experiment.without)
        bits = self.pot.bits or BITS_WITHOUT_ADC
        self.full, self.count = 2**bits - 1, self.pot.span / 2**bits
        self.supply_volts = p["supply_voltage"]
        run = experiment.prepare(u=np.zeros((experiment.N, 1)))
        self._model, self._data = run.model, mujoco.MjData(run.model)
        self._data.qpos[:], self._data.userdata[:] = run.qpos, run.user_data
        self._joint = self._data.userdata[slots.HEAD : slots.HEAD + slots.WIDTH]
        self._delay = round(run.delay / TIMESTEP)
        self._noise, self._idle_noise = experiment.generator("noise"), np.random.default_rng([experiment.seed, 41])
        self._stuck, self.logs = 0.0, False
        self.switch_off()
        self.rest(SETTLE)

    def _angle(self) -> float:
        """What the potentiometer shows without noise [rad]."""
        from twin.plant.electronics import angle_read

        return float(angle_read(self._joint, self._data.qpos))

    def _counts(self, angle: float) -> float:
        place = angle / self.count + 0.5 * (self.full + 1)
        return place if self.sensor_sign > 0 else self.full - place

    def angle_of(self, counts: float) -> float:
        """The angle [rad] that a reading stands for: the data sheet's scale in place of a protractor."""
        place = counts if self.sensor_sign > 0 else self.full - counts
        return (place - 0.5 * (self.full + 1)) * self.count

    def position(self, joint: int) -> float:
        """See `Plant`."""
        if joint != self.channel:
            return 0.5 * self.full
        if self.trouble in ("unplugged", "stuck"):
            return 0.0 if self.trouble == "unplugged" else self._stuck
        return self._counts(self._angle())

    def reading(self, joint: int) -> int:
        """See `Plant`."""
        noise = self._noise if self.logs else self._idle_noise
        shift = self.pot.noise * float(noise.standard_normal()) if joint == self.channel else 0.0
        place = self.position(joint) + self.sensor_sign * shift / self.count
        # The converter rounds the angle half to even, so that the twin's own log has the same codes.
        place = place if self.sensor_sign > 0 else self.full - place
        code = int(np.clip(np.round(place), 0, self.full))
        return code if self.sensor_sign > 0 else self.full - code

    def supply(self) -> int:
        """See `Plant`."""
        volts = 0.0 if self.trouble == "no supply" else float(self._data.userdata[slots.BUS])
        return int(volts / (DIVIDER * self.supply_volts) * self.full)

    def step(self, duties: list[float]) -> None:
        """See `Plant`."""
        sign = self.motor_sign * (-1 if self.trouble == "reversed" else 1)
        self._queue.append(sign * duties[self.channel] / wire.FULL * self.supply_volts)
        self._data.ctrl[0] = self._queue.popleft()
        with boards():
            mujoco.mj_step(self._model, self._data)

    def switch_off(self) -> None:
        """See `Plant`."""
        self._queue = deque([0.0] * self._delay)

    def rest(self, seconds: float) -> None:
        """The drive is off for so long."""
        for _ in range(round(seconds / TIMESTEP)):
            self.step([0.0] * wire.JOINTS)

    def break_down(self, trouble: str) -> None:
        """One of `TROUBLES` happens, or ends where the name is empty."""
        self._stuck = self.position(self.channel)
        self.trouble = trouble


class Emulator(Closing):
    """A rig on the pseudo-terminal `port`, served by a thread until `close`; a context manager.

    `joint` hangs on its channel with parameters drawn by `seed`, unless `parameters` are given; its motor and sensor
    are wired either way round, unless `signs` (motor, sensor) are given. `speed` is in seconds of the leg per second;
    None is as fast as the host keeps up, and then the rig waits for its host up to `PATIENCE` where the firmware would
    not. Of the frames each way the share `garbled` has a damaged byte and the share `lost` never arrives. A run depends
    on the seed and on what was played before, not on the clock of the machine.
    """

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
        if joint not in JOINTS:
            raise InputError(f"an emulated rig has one joint; choose one of {', '.join(JOINTS)}, not {joint!r}")
        p = draw_parameters(joint, seed) if parameters is None else parameters
        without = tuple(dict.fromkeys((*without, *ELSEWHERE)))
        rng = np.random.default_rng([seed, 40])
        drawn = rng.choice((-1, 1), 2)
        motor_sign, sensor_sign = (int(sign) for sign in (drawn if signs is None else signs))
        self.plant = LegPlant(Experiment(joint, "sweep", 10.0, 0.1, seed, without, p), motor_sign, sensor_sign)
        self.board = Board(self.plant, name)
        self.joint, self.seed, self.speed = joint, seed, speed
        self._garbled, self._lost, self._rng, self._runs = garbled, lost, rng, 0
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

    @property
    def supply(self) -> float:
        """[V]."""
        return self.plant.supply_volts

    @property
    def linearity(self) -> float:
        """Largest deviation of the potentiometer from a straight line, by its data sheet [rad]."""
        return self.plant.pot.nonlinearity

    def truth(self, Ts: float) -> dict[str, float]:
        """The hidden values, with names and units of `sysid.joint_values`."""
        return twin_truth(self.joint, Ts, self.plant.experiment.p)

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
