"""An emulated servo: its registers, its position loop at 1 kHz, and the twin's servo with a pendulum behind it."""

import math
from dataclasses import dataclass

import mujoco
import numpy as np

from twin.pendulum import Pendulum, at_rest, board
from twin.plant.stepping import TIMESTEP
from twin.rig.bus import packets
from twin.rig.bus.packets import Instruction
from twin.rig.bus.registers import MIDDLE, POSITION_MODE, TICK, WATCHDOG_UNIT, Family, Register

FILTER = 0.2  # share of the new speed in that of the derivative, per ms
AMBIENT, SHUTDOWN = 30.0, {"feetech": 0x20, "dynamixel": 0x20}  # [C]; error bit of an overload
TROUBLES = ("stuck", "hot", "overload", "silent")
# Registers that differ from 0 at first, by the manuals.
FIRST = {
    "feetech": {"highest": 4095, "hottest": 70, "drive_limit": 1000, "p": 32, "d": 32, "dead_up": 1, "dead_down": 1}
    | {"largest_current": 500, "drive_goal": 1000, "firmware": 0x0903, "goal": MIDDLE},
    "dynamixel": {"highest": 4095, "hottest": 70, "drive_limit": 885, "p": 400, "largest_current": 1750, "mode": 3}
    | {"drive_goal": 885, "firmware": 52, "return_delay": 250, "goal": MIDDLE},
}
NUMBERS = {"feetech": 777, "dynamixel": 1200}
SUPPLY = {"feetech": 7.4, "dynamixel": 5.0}  # [V]


@dataclass(frozen=True)
class Hidden:
    """What a host has to find out. `derivative` [s]: duty per rad/s at a D register of 1; noise [rad] of the encoder;
    `reversed_sensor` is none of a servo's, whose loop would run away."""

    pendulum: Pendulum
    derivative: float
    noise: float


def drawn(family: str, seed: int) -> Hidden:
    """The hidden values of the emulated servo `seed`: around the data sheets of an XL330-M288 at 5 V and an STS3215 at
    7.4 V (19.5 kg cm, 50 rev/min), with a weight on the horn."""
    rng = np.random.default_rng([seed, 50, sorted(NUMBERS).index(family)])

    def around(value: float, share: float = 0.2) -> float:
        return float(value * rng.uniform(1.0 - share, 1.0 + share))

    if family == "dynamixel":
        speed, torque, inertia, mass = 10.79, 0.52, 0.0014, 0.25
    else:
        speed, torque, inertia, mass = 5.24, 1.91, 0.02, 0.6
    pendulum = Pendulum(
        mass=around(mass, 0.4),
        length=0.1,
        rated_voltage=SUPPLY[family],
        no_load_speed=around(speed),
        stall_torque=around(torque),
        rotor_inertia=around(inertia),
        coulomb=around(0.04, 0.5) * torque,
        load_friction=float(rng.uniform(0.0, 0.2)),
        supply_resistance=0.0,
        zero=float(rng.uniform(-0.2, 0.2)),
    )
    return Hidden(pendulum, around(0.0012, 0.3), 0.3 * TICK)


class Device:
    """One servo on an emulated bus, with what `hidden` says; it rests with the pendulum hanging."""

    def __init__(self, family: Family, number: int, hidden: Hidden, seed: int = 0, model: int | None = None) -> None:
        self.family, self.number, self.hidden, self.trouble = family, number, hidden, ""
        self.model = family.models[NUMBERS[family.name] if model is None else model]
        self._bytes = bytearray(1024)
        self._registers = {**family.registers, **self.model.registers}
        for name, value in FIRST[family.name].items():
            self.set(name, value)
        self.set("id", number)
        self.set("model", NUMBERS[family.name] if model is None else model)
        self._rng = np.random.default_rng([seed, 51, number])
        self._model, state = board(hidden.pendulum.replace(zero=0.0))
        self._data = mujoco.MjData(self._model)
        self._data.userdata[:] = at_rest(state, hidden.pendulum, 0.0)
        self._duty, self._speed, self._integral = 0.0, 0.0, 0.0
        self._trajectory, self._last, self._heard, self._error = float(MIDDLE), 0.0, 0.0, 0
        self._pending: tuple[int, bytes] | None = None
        self.now = 0.0
        self._settle()
        self.torque_log: list[tuple[float, bool]] = [(0.0, False)]  # when the torque went on and off [s]
        self._measure()

    @property
    def angle(self) -> float:
        """What the sensor shows without noise [rad], 0 at its middle."""
        return float(self._data.qpos[0]) + self.hidden.pendulum.zero

    def get(self, name: str) -> float:
        """A register, in its counts."""
        register = self._register(name)
        return 0 if register is None else register.number(bytes(self._bytes[register.address :][: register.size]))

    def set(self, name: str, value: float) -> None:
        """A register, in its counts."""
        register = self._register(name)
        if register is not None:
            self._bytes[register.address : register.address + register.size] = register.data(round(value))

    def _register(self, name: str) -> Register | None:
        return self._registers.get(name)

    def _settle(self) -> None:
        """What the loop takes from its registers, after a write."""
        get, model = self.get, self.model
        unit = 0.229 * 6.0 / 360.0 * 4096.0 if self.family.name == "dynamixel" else 1.0  # ticks/s
        self._on, self._goal, self._patience = get("torque") == 1, get("goal"), get("watchdog")
        self._kp, self._ki = (get(name) * (model.per_gain or 0.0) for name in ("p", "i"))
        self._kd = self.hidden.derivative * get("d")
        self._dead = max(get("dead_up"), get("dead_down")) * TICK
        self._limit = min(get("drive_limit"), get("drive_goal")) * self._registers["drive_limit"].unit * model.largest
        self._most = get("profile_speed") * unit * TIMESTEP or math.inf

    # The loop.

    def tick(self) -> None:
        """A millisecond. The caller holds `twin.plant.stepping.boards`."""
        self.now += TIMESTEP
        read = round((self.angle + self.hidden.noise * self._rng.standard_normal()) / TICK)
        self._speed += FILTER * ((read - self._last) * TICK / TIMESTEP - self._speed)
        self._last = read
        self._watch()
        self._duty = self._asked(read) if self._on else 0.0
        if not self._on:
            self._trajectory, self._integral = float(read + MIDDLE), 0.0
        if self.trouble == "stuck":
            self._data.qvel[:] = 0.0
        else:
            self._data.ctrl[0] = self._duty * SUPPLY[self.family.name]
            mujoco.mj_step(self._model, self._data)

    def _asked(self, read: int) -> float:
        """The duty that the loop asks for, within its limit, for its own goal, which follows the host's."""
        self._trajectory += min(max(self._goal - self._trajectory, -self._most), self._most)
        error = (self._trajectory - read - MIDDLE) * TICK
        error = 0.0 if abs(error) <= self._dead else error
        asked = self._kp * error - self._kd * self._speed + self._integral
        if abs(asked) < self._limit:
            self._integral += self._ki * error * TIMESTEP
        return min(max(asked, -self._limit), self._limit)

    def _watch(self) -> None:
        """The bus watchdog of a Dynamixel: the servo stops where it is, and takes no goal."""
        if self._on and self._patience > 0 and self.now - self._heard > self._patience * WATCHDOG_UNIT:
            self.set("watchdog", -1)
            self.set("goal", self._last + MIDDLE)
            self._settle()

    def _measure(self) -> None:
        """Put what is measured into its registers."""
        place = (self.angle + self.hidden.noise * self._rng.standard_normal()) / TICK
        values = {"position": round(place) + MIDDLE, "voltage": SUPPLY[self.family.name] / 0.1}
        values["temperature"] = 85 if self.trouble == "hot" else AMBIENT
        values |= {"load": self._duty / 1e-3, "duty": self._duty * 885.0, "error": self._error}
        if current := self._register("current"):
            p = self.hidden.pendulum
            share = self._duty - float(self._data.qvel[0]) / p.no_load_speed
            values["current"] = share * p.stall_torque * p.no_load_speed / p.rated_voltage / current.unit
        for name, value in values.items():
            self.set(name, value)

    def break_down(self, trouble: str) -> None:
        """One of `TROUBLES` happens, or ends where the name is empty."""
        self.trouble = trouble
        if trouble == "overload":
            self._error = SHUTDOWN[self.family.name]
            self._switch(0)
            self._settle()

    def _switch(self, on: int) -> None:
        if on != self.get("torque"):
            self.torque_log.append((self.now, bool(on)))
        self.set("torque", on)

    # The bus.

    def answer(self, instruction: Instruction) -> bytes:
        """The servo's answer to an instruction, empty where it has none."""
        name, code, given = self.family.name, instruction.code, instruction.parameters
        mine = instruction.number in (self.number, packets.EVERYBODY)
        if self.trouble == "silent":
            return b""
        self._heard = self.now
        if code == packets.SYNC_READ:
            address, size, numbers = packets.addressed(name, given)
            return self._read(address, size) if self.number in numbers else b""
        if code == packets.SYNC_WRITE:
            address, size, rest = packets.addressed(name, given)
            for k in range(0, len(rest), size + 1):
                if rest[k] == self.number:
                    self._write(address, rest[k + 1 : k + 1 + size])
            return b""
        if not mine:
            return b""
        everybody = instruction.number == packets.EVERYBODY
        if code == packets.PING:
            about = self._bytes[0:2] + self._bytes[6:7] if name == "dynamixel" else b""
            return packets.status(name, self.number, self._alert(), bytes(about))
        if code == packets.READ and not everybody:
            if name == "dynamixel":
                return self._read(*packets.addressed(name, given)[:2])
            return self._read(given[0], given[1])
        error = 0
        if code == packets.WRITE:
            error = self._write(*packets.written(name, given))
        elif code == packets.REG_WRITE:
            self._pending = packets.written(name, given)
        elif code == packets.ACTION and self._pending is not None:
            self._write(*self._pending)
            self._pending = None
        return b"" if everybody else packets.status(name, self.number, error | self._alert(), b"")

    def _alert(self) -> int:
        """The error byte of an answer: bits of what is wrong, or that something is."""
        if self.family.name == "feetech":
            return self._error
        return 0x80 if self._error else 0

    def _read(self, address: int, size: int) -> bytes:
        self._measure()
        return packets.status(
            self.family.name, self.number, self._alert(), bytes(self._bytes[address : address + size])
        )

    def _write(self, address: int, data: bytes) -> int:
        """Write bytes; returns the number of a refusal."""
        refusal = self._put(address, data)
        self._settle()
        return refusal

    def _put(self, address: int, data: bytes) -> int:
        goal, torque = self.family.registers["goal"], self.family.registers["torque"]
        if address == goal.address:
            value = goal.number(data)
            if self.family.name == "dynamixel":
                if self.get("watchdog") == -1:
                    return 4  # data range
                if not self.get("lowest") <= value <= self.get("highest"):
                    return 6  # data limit
            elif self.get("highest"):
                value = int(np.clip(value, self.get("lowest"), self.get("highest")))
            self.set("goal", value)
            return 0
        if address == torque.address:
            if self.get("mode") == POSITION_MODE[self.family.name] and not (self._error and data[0]):
                self._switch(data[0])
            if data[0] == 0:
                self.set("goal", self._last + MIDDLE)
            return 0
        watchdog = self.family.register("watchdog")
        if watchdog is not None and address == watchdog.address and data[0] == 0 and self.get("watchdog") == -1:
            self.set("goal", self._last + MIDDLE)
        self._bytes[address : address + len(data)] = data
        return 0
