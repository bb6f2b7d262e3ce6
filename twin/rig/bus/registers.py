"""Registers of bus servos: where each stands, in which unit, and what the gains of a model stand for.

Sources. Dynamixel: ROBOTIS e-manual, control tables of XL330-M288, XL330-M077 and XL430-W250. Feetech: memory table of
the STS series (magnetic encoder), and model numbers as the servos give them.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

TICKS = 4096  # of a turn, in both families
TICK = 2.0 * math.pi / TICKS  # [rad]
MIDDLE = 2048  # position at angle 0, unless the joint's file says another
TWO = -1  # two's complement


@dataclass(frozen=True)
class Register:
    """`size` bytes from `address` on, low byte first. `sign` is `TWO`, the number of a sign bit, or 0 for none; a value
    of 1 stands for `unit`."""

    address: int
    size: int
    sign: int = 0
    unit: float = 1.0

    def number(self, data: bytes) -> int:
        """The number in `size` bytes."""
        raw = int.from_bytes(data[: self.size], "little")
        if self.sign == TWO:
            return raw - (raw >> (8 * self.size - 1) << (8 * self.size))
        if self.sign and raw >> self.sign & 1:
            return -(raw & ~(1 << self.sign))
        return raw

    def data(self, number: int) -> bytes:
        """The bytes of a number."""
        if self.sign > 0 and number < 0:
            number = -number | 1 << self.sign
        return (number % (1 << (8 * self.size))).to_bytes(self.size, "little")

    def value(self, data: bytes) -> float:
        """The number in its unit."""
        return self.number(data) * self.unit


@dataclass(frozen=True)
class Model:
    """A servo with the number `number`. `per_gain` [1/rad]: share of full duty for an error of 1 rad at a P register of
    1, None where nobody has measured it. `largest` is its largest duty. `registers` are those that it has besides those
    of its family."""

    name: str
    per_gain: float | None = None
    largest: float = 1.0
    registers: Mapping[str, Register] = field(default_factory=dict)


@dataclass(frozen=True)
class Family:
    """A protocol with its registers by name. `state` (address, bytes) is what one read of a run brings: the goal that
    the servo has, its position and the rest. `errors` are the bits of "error"."""

    name: str
    words: str
    library: str
    package: str
    bauds: tuple[int, ...]
    registers: Mapping[str, Register]
    models: Mapping[int, Model]
    state: tuple[int, int]
    errors: Mapping[int, str]
    most_id: int

    def register(self, name: str, model: Model | None = None) -> Register | None:
        """A register by name, None where the servo has none."""
        return {**self.registers, **(model.registers if model else {})}.get(name)


# Oscilloscope, STS3215 of 7.4 V (Rhoban/bam, bam/feetech/actuator.py): 0.166 of full duty for an error of 1 rad at a P
# register of 1, and a largest duty of 0.97.
_STS3215 = Model("STS3215", 0.166, 0.97)
# The manual divides the P register by 128. The 16 public logs of docs/servo.md show 256, within 1 %: duty over error is
# 4096 / (2 pi) / 256 / 885 for a register of 1. For the XL430 there are no such logs.
_XL330_GAIN = TICKS / (2.0 * math.pi) / 256.0 / 885.0
_XL330 = {"current": Register(126, 2, TWO, 1e-3), "largest_current": Register(38, 2, 0, 1e-3)}
_XL430 = {"load": Register(126, 2, TWO, 1e-3)}

FEETECH = Family(
    "feetech",
    "Feetech STS",
    "scservo_sdk",
    "ftservo-python-sdk",
    (1_000_000, 500_000, 115_200),
    {
        "firmware": Register(0, 2),
        "model": Register(3, 2),
        "id": Register(5, 1),
        "lowest": Register(9, 2),
        "highest": Register(11, 2),
        "hottest": Register(13, 1),
        "drive_limit": Register(16, 2, 0, 1e-3),
        "p": Register(21, 1),
        "d": Register(22, 1),
        "i": Register(23, 1),
        "dead_up": Register(26, 1),
        "dead_down": Register(27, 1),
        "largest_current": Register(28, 2, 0, 6.5e-3),
        "mode": Register(33, 1),
        "torque": Register(40, 1),
        "profile_acceleration": Register(41, 1),
        "goal": Register(42, 2, 15),
        "profile_speed": Register(46, 2, 15),
        "drive_goal": Register(48, 2, 0, 1e-3),
        "position": Register(56, 2, 15),
        "load": Register(60, 2, 10, 1e-3),
        "voltage": Register(62, 1, 0, 0.1),
        "temperature": Register(63, 1),
        "error": Register(65, 1),
        "current": Register(69, 2, 15, 6.5e-3),
    },
    {777: _STS3215, 2825: Model("STS3250")},
    (42, 29),
    {1: "voltage", 2: "encoder", 4: "temperature", 8: "current", 32: "load"},
    253,
)
DYNAMIXEL = Family(
    "dynamixel",
    "Dynamixel X",
    "dynamixel_sdk",
    "dynamixel-sdk",
    (57_600, 1_000_000, 115_200, 2_000_000, 3_000_000, 4_000_000),
    {
        "model": Register(0, 2),
        "firmware": Register(6, 1),
        "id": Register(7, 1),
        "return_delay": Register(9, 1, 0, 2e-6),
        "drive_mode": Register(10, 1),
        "mode": Register(11, 1),
        "hottest": Register(31, 1),
        "drive_limit": Register(36, 2, 0, 1.0 / 885.0),
        "highest": Register(48, 4, TWO),
        "lowest": Register(52, 4, TWO),
        "torque": Register(64, 1),
        "error": Register(70, 1),
        "d": Register(80, 2),
        "i": Register(82, 2),
        "p": Register(84, 2),
        "feedforward_2": Register(88, 2),
        "feedforward_1": Register(90, 2),
        "watchdog": Register(98, 1, TWO),
        "drive_goal": Register(100, 2, TWO, 1.0 / 885.0),
        "profile_acceleration": Register(108, 4),
        "profile_speed": Register(112, 4),
        "goal": Register(116, 4, TWO),
        "duty": Register(124, 2, TWO, 1.0 / 885.0),
        "position": Register(132, 4, TWO),
        "voltage": Register(144, 2, 0, 0.1),
        "temperature": Register(146, 1),
    },
    {
        1200: Model("XL330-M288", _XL330_GAIN, 1.0, _XL330),
        1190: Model("XL330-M077", _XL330_GAIN, 1.0, _XL330),
        1060: Model("XL430-W250", None, 1.0, _XL430),
    },
    (116, 31),
    {1: "voltage", 4: "temperature", 8: "encoder", 16: "electrical shock", 32: "load"},
    252,
)
FAMILIES = {family.name: family for family in (FEETECH, DYNAMIXEL)}
POSITION_MODE = {"feetech": 0, "dynamixel": 3}
WATCHDOG_UNIT = 0.02  # [s] of "watchdog"
