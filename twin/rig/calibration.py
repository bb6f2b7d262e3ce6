"""What a rig is: its port, how a joint is wired to it, counts to angles, and limits. A small TOML file in SI units."""

from collections import deque
from collections.abc import Mapping
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

from sysid.base.errors import InputError
from sysid.base.files import read_limited, toml_values, write_text
from twin.rig import wire

Kind = TypeVar("Kind", bound=BaseModel)
DEFAULT = "rig.toml"
# 27 and 10 kOhm before a pin of 5 V. What resistors of 5 % may be off by, and the 5 V of USB (4.75 to 5.25
# V, USB 2.0 section 7.2.2), which the converter compares with.
SUPPLY_FULL, RESISTOR, USB = 5.0 * (27.0 + 10.0) / 10.0, 0.05, 0.05
SUPPLY_OFF = 27.0 / 37.0 * 2.0 * RESISTOR + USB  # share by which a good supply may seem to be another
SURE = 1.2  # times the share that moved a joint: beyond it the joint moves
_COMMENTS = {
    "port": "serial port",
    "board": "who answers there: name and version of the firmware",
    "joint": "name of the joint in logs",
    "channel": "joint number on the board, from 0",
    "motor_reversed": "a positive duty turns the motor so that the sensor's counts fall",
    "supply": "[V]",
    "supply_full": "[V] supply at which its pin shows a full reading: 5 V, by the divider",
    "largest": "[V] largest input",
    "slew": "[V/s] fastest change of the input",
    "strike": "[rad/s] speed at which the drive goes off",
    "stall": "[s] under drive without motion, after which the drive goes off",
    "motion": "[rad] least motion in this time; a joint so near to a soft limit is at it",
    "moves_up": "share of the supply that moves the joint to higher counts",
    "moves_down": "the same to lower counts",
    "low_counts": "reading at the end of low counts",
    "low_angle": "[rad] there",
    "high_counts": "reading at the end of high counts",
    "high_angle": "[rad] there",
    "soft_low": "[rad] below which the motor is cut in that direction",
    "soft_high": "[rad] above which it is cut",
    "linearity": "[rad] largest deviation of the sensor from a straight line, by its data sheet",
    "crossing": "[s] from end to end at the supply's voltage, about",
}


class Calibration(BaseModel):
    """One joint on a rig. The ends are None until `qpal rig zero` has found them.

    The log's voltage is positive where it raises the angle.
    """

    model_config = ConfigDict(frozen=True, extra="forbid")
    port: str
    board: str = ""
    joint: str = Field(min_length=1)
    channel: int = Field(ge=0, lt=wire.JOINTS)
    motor_reversed: bool = False
    supply: float = Field(12.0, gt=0, le=60)
    supply_full: float = Field(SUPPLY_FULL, gt=0)
    largest: float = Field(12.0, gt=0)
    slew: float = Field(12_000.0, gt=0)
    strike: float = Field(10.0, gt=0)
    stall: float = Field(3.0, gt=0, le=60)
    motion: float = Field(float(np.deg2rad(2.0)), gt=0)
    moves_up: float = Field(1.0, gt=0, le=1)
    moves_down: float = Field(1.0, gt=0, le=1)
    low_counts: float | None = None
    low_angle: float | None = None
    high_counts: float | None = None
    high_angle: float | None = None
    soft_low: float | None = None
    soft_high: float | None = None
    crossing: float | None = None
    linearity: float = Field(0.0, ge=0)

    @model_validator(mode="after")
    def _agree(self) -> "Calibration":
        if self.largest > self.supply:
            raise ValueError(f"largest is {self.largest:g} V and the supply has {self.supply:g} V; give at most this")
        values = [getattr(self, name) for name in ENDS]
        if any(v is None for v in values) and any(v is not None for v in values):
            raise ValueError("some values of the ends are missing; run qpal rig zero again")
        if self.is_zeroed and (self.low_counts == self.high_counts or self.low_angle == self.high_angle):
            raise ValueError("both ends have the same reading or angle; run qpal rig zero again")
        if self.is_zeroed and not values[-2] < values[-1]:
            raise ValueError("soft_low is not below soft_high; correct them")
        return self

    @property
    def is_zeroed(self) -> bool:
        """Whether counts have angles."""
        return self.low_counts is not None

    @property
    def scale(self) -> float:
        """[rad] of a count; negative where the angle falls with rising counts."""
        low_counts, low, high_counts, high = self._points()
        return (high - low) / (high_counts - low_counts)

    def angle(self, counts: np.ndarray) -> np.ndarray:
        """The angles [rad] of readings (n,) [counts]."""
        low_counts, low, _, _ = self._points()
        return low + self.scale * (np.asarray(counts, dtype=float) - low_counts)

    def counts(self, angle: float) -> float:
        """The reading of an angle [rad]."""
        low_counts, low, _, _ = self._points()
        return low_counts + (angle - low) / self.scale

    def levels(self, u: np.ndarray) -> np.ndarray:
        """The levels (N,) [duty] for voltages (N,) that raise the angle where they are positive."""
        return np.round(np.sign(self.scale) * np.asarray(u) / self.supply * wire.FULL).astype(int)

    def volts(self, duty: np.ndarray) -> np.ndarray:
        """The voltages (N,) of duties as they were played."""
        return np.sign(self.scale) * np.asarray(duty) / wire.FULL * self.supply

    def patience(self, levels: np.ndarray, Ts: float) -> float:
        """The longest time [s] under drive for which levels (N,) [duty] may not move the joint by the least motion.

        The firmware adds up the time of a drive, and rising pulses from rest and small reversals are meant to move it
        little. How fast it goes is guessed from its crossing, with friction as high as the share that moved it when it
        was wired.
        """
        if self.crossing is None or self.low_angle is None or self.high_angle is None:
            return 0.0
        dry = np.minimum(SURE * np.where(levels > 0, self.moves_up, self.moves_down), 0.95)
        share = np.maximum(np.abs(levels) / wire.FULL - dry, 0.0) / (1.0 - dry)
        places = np.cumsum(np.sign(levels) * share) * Ts * abs(self.high_angle - self.low_angle) / self.crossing
        return longest_within(places, levels != 0, self.motion) * Ts

    def setup(self, full: int, patience: float = 0.0) -> wire.Setup:
        """The limits as the firmware takes them, for a converter with a reading of up to `full` counts.

        `patience` [s] is added to the stall time.
        """
        if self.soft_low is None or self.soft_high is None:
            raise self._not_zeroed()
        low, high = sorted(self.counts(angle) for angle in (self.soft_low, self.soft_high))
        scale = abs(self.scale)
        return wire.Setup(
            self.channel,
            int(np.clip(np.floor(low), 0, full - 2)),
            int(np.clip(np.ceil(high), 1, full - 1)),
            _whole(self.strike / scale),
            _whole(self.largest / self.supply * wire.FULL),
            _whole(self.slew / self.supply * wire.FULL * 1e-3, 2 * wire.FULL),
            _whole((self.stall + patience) * 1e3),
            _whole(self.motion / scale),
            wire.USED + wire.REVERSED * self.motor_reversed,
        )

    def raw_setup(self, full: int, share: float, stall: float, motion: float) -> wire.Setup:
        """Limits before the ends are known: the whole range of the sensor, a duty up to `share`, and `motion` as a
        share of a full reading in `stall` [s]."""
        return wire.Setup(
            self.channel,
            round(0.015 * full),
            round(0.985 * full),
            _whole(4.0 * full),
            _whole(share * wire.FULL),
            wire.FULL,
            _whole(stall * 1e3),
            _whole(motion * full),
            wire.USED + wire.REVERSED * self.motor_reversed,
        )

    def _points(self) -> tuple[float, float, float, float]:
        points = self.low_counts, self.low_angle, self.high_counts, self.high_angle
        if any(value is None for value in points):
            raise self._not_zeroed()
        return points  # type: ignore[return-value]

    def _not_zeroed(self) -> InputError:
        return InputError(f"the ends of the {self.joint} have no angles yet; run qpal rig zero first")


def longest_within(places: np.ndarray, counted: np.ndarray, width: float) -> int:
    """The most samples that are `counted` (N,) in a stretch in which `places` (N,) stay within less than `width`."""
    lows, highs = deque[int](), deque[int]()  # numbers of samples whose places rise, and fall: the first is the extreme
    total, first, longest = np.concatenate([[0], np.cumsum(counted)]), 0, 0
    for k, place in enumerate(places):
        while lows and places[lows[-1]] >= place:
            lows.pop()
        while highs and places[highs[-1]] <= place:
            highs.pop()
        lows.append(k)
        highs.append(k)
        while places[highs[0]] - places[lows[0]] >= width:
            first += 1
            for ends in (lows, highs):
                if ends[0] < first:
                    ends.popleft()
        longest = max(longest, int(total[k + 1] - total[first]))
    return longest


def of_joint(
    port: str,
    joint: str,
    channel: int,
    supply: float,
    largest: float,
    linearity: float,
    board: str = "",
    supply_full: float = SUPPLY_FULL,
) -> Calibration:
    """What is known of a joint before it has moved. Raises InputError for values that do not fit each other."""
    values = {"port": port, "board": board, "joint": joint, "channel": channel, "supply": supply, "largest": largest}
    return _valid({**values, "supply_full": supply_full, "linearity": linearity}, "this rig", "correct it")


ENDS = ("low_counts", "low_angle", "high_counts", "high_angle", "soft_low", "soft_high")


def _whole(value: float, most: int = 2**16 - 1) -> int:
    """The nearest whole number from 1 to `most`."""
    return int(np.clip(round(value), 1, most))


MOST = 10**6  # [byte] of a calibration, which has about a thousand
REMEDY = "correct it, or make the file anew with qpal rig wire"


def read(path: str | Path) -> Calibration:
    """The calibration in a TOML file. Raises InputError, which names the value, for one that is missing or damaged."""
    return _valid(read_toml(path), str(path), REMEDY)


def read_toml(path: str | Path) -> dict[str, Any]:
    """The values in a rig's file. Raises InputError for one that is missing, or is no TOML file."""
    source = Path(path)
    try:
        return toml_values(read_limited(source, MOST).decode("utf-8"))
    except OSError as error:
        raise InputError(f"{source}: {error.strerror}; make it with qpal rig wire") from None
    except (ValueError, RecursionError) as error:
        raise InputError(
            f"{source} is no TOML file ({error}); correct it, or make it anew with qpal rig wire"
        ) from None


def from_dict(content: dict[str, Any], source: str) -> Calibration:
    """The calibration whose values are in `content`. Raises InputError for what is none."""
    return _valid(content, source, "it is damaged")


def _valid(content: dict[str, Any], source: str, remedy: str) -> Calibration:
    return validated(Calibration, content, source, remedy)


def validated(kind: type[Kind], content: dict[str, Any], source: str, remedy: str = REMEDY) -> Kind:
    """The values as a `kind`. Raises InputError with the first that does not do."""
    try:
        return kind.model_validate(content)
    except ValidationError as error:
        first = error.errors()[0]
        place = ".".join(map(str, first["loc"]))
        found = f"{place}: {first['msg']}" if place else first["msg"].removeprefix("Value error, ")
        raise InputError(f"{source}: {found}; {remedy}") from None


def write(calibration: BaseModel, path: str | Path, comments: Mapping[str, str] = _COMMENTS) -> Path:
    """Write the calibration, each value with what it is; whole or not at all."""
    lines = ["# A rig of qpal, see docs/rig.md. SI units."]
    for name, value in calibration:
        if value is not None:
            lines.append(f"{name} = {_toml(value)}  # {comments[name]}")
    return write_text(path, "\n".join(lines) + "\n")


def _toml(value: Any) -> str:
    if isinstance(value, str):
        return '"' + value.replace("\\", "\\\\").replace('"', '\\"') + '"'
    return str(value).lower() if isinstance(value, bool) else repr(value)
