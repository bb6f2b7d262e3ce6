"""One servo on a bus: its file, what it is, its gains, and the check that it follows its goals."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from math import pi, radians
from pathlib import Path
from typing import Any, Literal

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, model_validator

from sysid.base.errors import InputError
from twin.rig.bus.line import Bus, Garbled, Silent
from twin.rig.bus.registers import MIDDLE, POSITION_MODE, TICK, Family, Model
from twin.rig.calibration import read_toml, validated
from twin.rig.calibration import write as write_values

REACH = radians(60.0)  # about the place where it was wired: the soft limits, unless the servo's own are inside
RESTS, STILL = 10, 3  # readings at rest, and ticks by which they may differ
BETWEEN = 0.02  # [s] between them
COOLER = 5.0  # [C] below the servo's own limit
CURRENT = 0.9  # of the servo's own limit
# What shapes the motion, and how the servo guards itself: read before every run, and written into its log.
KEPT = (
    *("firmware", "mode", "drive_mode", "return_delay", "p", "i", "d", "feedforward_1", "feedforward_2"),
    *("dead_up", "dead_down", "drive_limit", "drive_goal", "profile_speed", "profile_acceleration"),
    *("lowest", "highest", "hottest", "largest_current"),
)
_COMMENTS = {
    "bus": "family of the servo",
    "port": "serial port",
    "baud": "[bit/s] rate of the bus",
    "number": "the servo's ID",
    "model": "the servo's model",
    "joint": "name of the joint",
    "reversed": "the angle falls where the servo's position rises",
    "middle": "the servo's position at angle 0",
    "soft_low": "[rad] least goal",
    "soft_high": "[rad] largest goal",
    "beyond": "[rad] beyond a soft limit, at which the torque goes off",
    "slew": "[rad/s] fastest change of the goal",
    "approach": "[rad/s] on the way to the first goal",
    "stall": "[s] at nine tenths of its largest drive without motion, after which the torque goes off",
    "largest_current": "[A] for 0.1 s, after which the torque goes off",
    "hottest": "[C] at which the torque goes off",
}


class Servo(BaseModel):
    """A servo's file: the servo `number` with the model number `model`; its limits are those of the host."""

    model_config = ConfigDict(frozen=True, extra="forbid")
    bus: Literal["feetech", "dynamixel"]
    port: str
    baud: int = Field(gt=0)
    number: int = Field(ge=0, le=253)
    model: int = Field(ge=0)
    joint: str = Field(min_length=1)
    reversed: bool = False
    middle: int = MIDDLE
    soft_low: float
    soft_high: float
    beyond: float = Field(radians(20.0), gt=0)
    slew: float = Field(20.0, gt=0)
    approach: float = Field(0.5, gt=0)
    stall: float = Field(1.0, gt=0)
    largest_current: float | None = Field(None, gt=0)
    hottest: float = Field(65.0, gt=0)

    @model_validator(mode="after")
    def _agree(self) -> "Servo":
        if not self.soft_low < self.soft_high:
            raise ValueError("soft_low is not below soft_high; correct them")
        return self

    @property
    def sign(self) -> int:
        """Of the angle over the position."""
        return -1 if self.reversed else 1

    def angle(self, position: np.ndarray | int) -> np.ndarray:
        """Angles [rad] of positions [ticks]."""
        return self.sign * (np.asarray(position, dtype=float) - self.middle) * TICK

    def position(self, angle: np.ndarray) -> np.ndarray:
        """The nearest positions [ticks] of angles [rad]."""
        return np.round(self.middle + self.sign * np.asarray(angle) / TICK).astype(int)


@dataclass(frozen=True)
class About:
    """What a servo says of itself: `registers` in their counts, those of `KEPT` that it has."""

    family: Family
    model: Model
    registers: Mapping[str, int]

    @property
    def loop(self) -> dict[str, Any]:
        """Its loop as `sysid.structures.ServoJoint` takes it: its terms, and kp in shares of the largest drive per rad
        where the register's scale is known. `largest_drive` is the share of full duty."""
        terms = "pid" if self.registers["i"] else "pd" if self.registers["d"] else "p"
        limit = min(self.registers["drive_limit"], self.registers["drive_goal"])
        share = limit * self.family.registers["drive_limit"].unit * self.model.largest
        kp = None if self.model.per_gain is None else self.registers["p"] * self.model.per_gain / share
        return {"loop": terms, "kp": kp, "largest_drive": round(share, 6)}

    def notes(self) -> list[str]:
        """Sentences on what the model of a servo joint does not have."""
        forward = self.registers.get("feedforward_1", 0) or self.registers.get("feedforward_2", 0)
        found = ["the servo's feedforward gains are not 0, and a servo joint has none"] if forward else []
        if self.model.per_gain is None:
            found.append(
                f"the scale of the P register of a {self.model.name} is not known: kp is found from the record"
            )
        return found


def read(path: str | Path) -> Servo:
    """The servo in a TOML file. Raises InputError, which names the value, for one that is missing or damaged."""
    return validated(Servo, read_toml(path), str(path))


def write(servo: Servo, path: str | Path) -> Path:
    """Write the file, each value with what it is."""
    return write_values(servo, path, _COMMENTS)


def is_servo(path: str | Path) -> bool:
    """Whether the file at `path` is that of a servo."""
    return Path(path).is_file() and "bus" in read_toml(path)


def about(bus: Bus, number: int, expected: int | None = None) -> About:
    """What the servo `number` says of itself.

    Raises InputError for a model that is not known or not the `expected` one, and for another mode than position.
    """
    family, found = bus.family, bus.model(number)
    model = family.models.get(found)
    names = ", ".join(f"{m.name} ({k})" for k, m in family.models.items())
    if model is None:
        raise InputError(f"{bus.port}: servo {number} has the model number {found}; the rig knows {names}")
    if expected not in (None, found):
        other = family.models.get(expected or 0)
        raise InputError(
            f"{bus.port}: servo {number} is a {model.name}, and the rig's file is of "
            f"{'a ' + other.name if other else f'model {expected}'}; run qpal rig wire again"
        )
    values = {}
    for name in KEPT:
        register = family.register(name, model)
        if register is not None:
            values[name] = register.number(bus.bytes_of(number, register.address, register.size))
    if values["mode"] != POSITION_MODE[family.name]:
        raise InputError(
            f"{bus.port}: servo {number} is in mode {values['mode']}, and the rig plays goals in position mode "
            f"({POSITION_MODE[family.name]}); set it with the maker's program"
        )
    return About(family, model, values)


def rest(bus: Bus, servo_number: int, model: Model) -> int:
    """The position [ticks] of a servo that rests. Raises InputError for one that moves, is hot or says an error."""
    positions: list[int] = []
    end = bus.clock.now() + 5.0 * RESTS * BETWEEN
    trouble: InputError = Silent(f"{bus.port}: servo {servo_number} does not answer")
    while len(positions) < RESTS and bus.clock.now() < end:
        try:
            state = bus.state(servo_number, model)
        except (Silent, Garbled) as error:
            trouble = error
            continue
        if state.error:
            raise InputError(
                f"{bus.port}: servo {servo_number} reports {errors_of(bus.family, state.error)}; "
                "switch its supply off and on"
            )
        positions.append(state.position)
        bus.clock.wait_until(bus.clock.now() + BETWEEN)
    if len(positions) < RESTS:
        raise trouble
    if max(positions) - min(positions) > STILL:
        raise InputError(
            f"{bus.port}: servo {servo_number} moves by {np.ptp(positions) * TICK * 180.0 / pi:.1f} deg in "
            f"{RESTS * BETWEEN:.1f} s; wait until it rests"
        )
    return int(np.median(positions))


def errors_of(family: Family, bits: int) -> str:
    """The errors that a servo reports."""
    names = [name for bit, name in family.errors.items() if bits & bit]
    return f"an error of {' and '.join(names)}" if names else f"error {bits}"


def wired(bus: Bus, number: int, joint: str, say: Callable[[str], None]) -> tuple[Servo, About]:
    """The file of a servo that rests, with limits about its place. Nothing moves."""
    known = about(bus, number)
    registers, place = known.registers, rest(bus, number, known.model)
    say(f"servo {number} is a {known.model.name}, at {(place - MIDDLE) * TICK * 180.0 / pi:.1f} deg, and rests")
    gains = ", ".join(f"{name.upper()} {registers[name]}" for name in "pid")
    say(f"its gains are {gains}, its limits {registers['lowest']} and {registers['highest']} ticks")
    low, high = registers["lowest"], registers["highest"]
    if high <= low:  # several turns
        low, high = MIDDLE - 2 * MIDDLE, MIDDLE + 2 * MIDDLE
    current = registers.get("largest_current", 0) * (
        register.unit if (register := bus.family.register("largest_current", known.model)) else 0.0
    )
    values = {
        **{"bus": bus.family.name, "port": bus.port, "baud": bus.baud, "number": number, "joint": joint},
        "model": next(k for k, m in bus.family.models.items() if m is known.model),
        "soft_low": round(max((low - MIDDLE) * TICK, (place - MIDDLE) * TICK - REACH), 4),
        "soft_high": round(min((high - MIDDLE) * TICK, (place - MIDDLE) * TICK + REACH), 4),
        "largest_current": round(CURRENT * current, 4) or None,
        "hottest": max(registers["hottest"] - COOLER, 1.0),
    }
    return validated(Servo, values, "this servo", "correct it"), known
