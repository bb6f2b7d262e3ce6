"""A bus of servos without hardware: packets on a line in emulated time, or on a pseudo-terminal in real time."""

import os
import select
import threading
import time
from collections import deque
from collections.abc import Sequence

import numpy as np

from sysid.base.errors import InputError
from twin.plant.stepping import TIMESTEP, boards
from twin.rig.bus import packets
from twin.rig.bus.device import Device, drawn
from twin.rig.bus.line import BITS, Bus
from twin.rig.bus.registers import Family
from twin.rig.closing import Closing

BAUD = 1_000_000
CATCH_UP = 0.02  # [s] of the servos between two looks at the line, where the machine was busy
POLL = 1e-3  # [s] that a read without data takes
ADAPTER = (2e-4, 1e-4)  # [s] of a USB adapter on the way of an answer: least, and mean of the rest
SLEEP = 5e-5  # [s] by which a host wakes up late, on the mean
PAUSE = 3e-3  # [s] within a packet, after which a servo waits for the next one
LATE = 8e-3  # [s] of a disturbance


class Emulator(Closing):
    """Servos of a family with hidden values drawn by `seed`, numbered 1, 2 ... unless `devices` are given.

    Without `speed` they live in the emulated time of `clock`, which passes as the host waits and bytes travel, so that
    a run depends on nothing but the seed. With one they are served by a thread on the pseudo-terminal `port`, so many
    seconds of theirs a second. Of the packets each way the share `garbled` has a damaged byte and the share `lost`
    never arrives; of the answers the share `late` comes 8 ms late.
    """

    def __init__(
        self,
        family: Family,
        seed: int = 0,
        devices: Sequence[Device] | None = None,
        speed: float | None = None,
        garbled: float = 0.0,
        lost: float = 0.0,
        late: float = 0.0,
    ) -> None:
        self.family, self.speed = family, speed
        self.devices = list(devices) if devices else [Device(family, 1, drawn(family.name, seed), seed)]
        self._garbled, self._lost, self._late = garbled, lost, late
        self._rng = np.random.default_rng([seed, 52])
        self._buffer, self._arriving = bytearray(), deque[tuple[float, bytes]]()
        self._time, self._stepped, self._heard, self._pulled = 0.0, 0.0, 0.0, False
        self.port = f"emulated {family.name}"
        if speed is not None:
            self._open_terminal()

    # The clock of a run.

    def now(self) -> float:
        """The emulated time [s]."""
        return self._time if self.speed is None else (time.perf_counter() - self._began) * self.speed

    def wait_until(self, moment: float) -> None:
        """See `Clock`."""
        if self.speed is None:
            self._time = max(self._time, moment) + SLEEP * self._rng.exponential()
            self._advance(self._time)
        else:
            while (left := moment - self.now()) > 0.0:
                time.sleep(left / self.speed)

    def bus(self, baud: int = BAUD) -> Bus:
        """The host's line to it."""
        if self.speed is None:
            return Bus(self.family, self.port, baud, _Line(self, baud), self)
        return Bus(self.family, self.port, baud, clock=self)

    @property
    def device(self) -> Device:
        """The first servo."""
        return self.devices[0]

    def truth(self) -> dict[str, float]:
        """The hidden values of the first servo, in rad, s and shares of the largest drive."""
        p, device, full = self.device.hidden.pendulum, self.device, self.device.model.largest
        time_constant = (p.rotor_inertia + p.mass * p.length**2) * p.no_load_speed / p.stall_torque
        return {
            "speed_full_drive": p.no_load_speed * full,
            "time_constant": time_constant,
            "lag_and_delay": time_constant,  # it has no delay beside that of the bus
            "coulomb": p.coulomb / p.stall_torque / full,
            "load_friction": p.load_friction,
            "pull": p.mass * p.parameters()["gravity"] * p.length / p.stall_torque / full,
            "kp": device.get("p") * (device.model.per_gain or 0.0) / full,
            "kd": device.get("d") * device.hidden.derivative / full,
        }

    def sentences(self) -> list[str]:
        """The hidden values in words."""
        t = self.truth()
        return [
            f"Hidden in the emulated servo: {np.rad2deg(t['speed_full_drive']):.4g} deg/s at full drive, time constant "
            f"{1e3 * t['time_constant']:.3g} ms, friction {t['coulomb']:.3g} and {t['load_friction']:.2g} of the load, "
            f"pull of the weight {t['pull']:.3g} of its largest drive, kp {t['kp']:.4g} 1/rad, kd {t['kd']:.3g} s/rad"
        ]

    def pull(self) -> None:
        """Pull the cable: nothing arrives any more, the servos live on."""
        self._pulled = True

    def close(self) -> None:
        """The bus is gone."""
        if self.speed is not None and not self._closing.is_set():
            self._closing.set()
            self._thread.join()
            os.close(self._master)
            os.close(self._slave)

    # The bus.

    def _advance(self, moment: float) -> None:
        """The servos live until `moment` [s]."""
        n = int((moment - self._stepped) / TIMESTEP + 1e-9)
        if n > 0:
            with boards():
                for _ in range(n):
                    for device in self.devices:
                        device.tick()
            self._stepped += n * TIMESTEP

    def _damage(self, data: bytes) -> bytes:
        """A packet as it arrives: as it was, garbled, or not at all."""
        fate = self._rng.random()
        if fate < self._lost or not data or self._pulled:
            return b""
        if fate >= self._lost + self._garbled:
            return data
        place = int(self._rng.integers(len(data)))
        return data[:place] + bytes([data[place] ^ int(self._rng.integers(1, 256))]) + data[place + 1 :]

    def _answers(self, data: bytes) -> bytes:
        """What the servos say to what the host has sent; what was not whole before a pause is forgotten."""
        if self.now() - self._heard > PAUSE:
            self._buffer.clear()
        self._heard = self.now()
        self._buffer += self._damage(data)
        said = b""
        for instruction in packets.taken(self.family.name, self._buffer):
            answers: dict[int, list[bytes]] = {}
            for device in self.devices:
                if answer := device.answer(instruction):
                    answers.setdefault(device.number, []).append(answer)
            order = sorted(answers)
            if instruction.code == packets.SYNC_READ:
                asked = packets.addressed(self.family.name, instruction.parameters)[2]
                order = [number for number in asked if number in answers]
            together = self.family.name == "feetech" and instruction.code == packets.PING
            for number in [order[0]] if together and order else order:
                group = [a for n in order for a in answers[n]] if together else answers[number]
                said += self._damage(_collided(group))
        return said

    def _host_sends(self, data: bytes, baud: int) -> None:
        self._time += len(data) * BITS / baud
        self._advance(self._time)
        if baud != BAUD:
            return
        if answer := self._answers(data):
            delay = ADAPTER[0] + ADAPTER[1] * self._rng.exponential() + LATE * (self._rng.random() < self._late)
            self._arriving.append((self._time + len(answer) * BITS / baud + delay, answer))

    def _host_reads(self, size: int) -> bytes:
        if not self._arriving or self._arriving[0][0] > self._time + POLL:
            self._time += POLL
            self._advance(self._time)
            return b""
        moment, data = self._arriving.popleft()
        self._time = max(self._time, moment)
        if len(data) > size:
            self._arriving.appendleft((moment, data[size:]))
        return data[:size]

    # The pseudo-terminal.

    def _open_terminal(self) -> None:
        if not hasattr(os, "openpty"):
            raise InputError("this system has no pseudo-terminals; the emulated bus needs Linux or macOS")
        import tty

        self._master, self._slave = os.openpty()
        tty.setraw(self._slave)
        os.set_blocking(self._master, False)
        self.port = os.ttyname(self._slave)
        self._advance(TIMESTEP)  # compiled code is loaded before anybody waits
        self._stepped, self._closing = 0.0, threading.Event()
        self._began = time.perf_counter()
        self._thread = threading.Thread(target=self._serve, name="emulated bus", daemon=True)
        self._thread.start()

    def _serve(self) -> None:
        while not self._closing.is_set():
            came = bool(select.select([self._master], [], [], TIMESTEP)[0])
            self._advance(min(self.now(), self._stepped + CATCH_UP))
            try:
                if came and (answer := self._answers(os.read(self._master, 4096))):
                    os.write(self._master, answer)
            except OSError:  # nobody reads
                continue


class _Line:
    """What a host opens as a port, in emulated time."""

    def __init__(self, emulator: Emulator, baud: int) -> None:
        self._emulator, self._baud = emulator, baud

    def write(self, data: Sequence[int]) -> int:
        self._emulator._host_sends(bytes(data), self._baud)
        return len(data)

    def read(self, size: int) -> bytes:
        return self._emulator._host_reads(size)

    def reset_input_buffer(self) -> None:
        self._emulator._arriving.clear()

    def close(self) -> None:
        pass


def _collided(answers: list[bytes]) -> bytes:
    """What several servos say at once: a line that each of them pulls down, a byte apart."""
    said = answers[0]
    for k, other in enumerate(answers[1:], 1):
        shifted = b"\xff" * k + other
        said = bytes(a & b for a, b in zip(said.ljust(len(shifted), b"\xff"), shifted, strict=False))
    return said
