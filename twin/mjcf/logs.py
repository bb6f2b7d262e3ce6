"""Logs of a robot: columns of commands and of positions, in the order of its actuators, in SI."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from sysid.base.errors import InputError
from sysid.channels.reading import Mapping as ChannelMapping
from sysid.workflow.record import read_record
from twin.calibrate.problem import noise_of
from twin.mjcf.held import posture
from twin.mjcf.robot import Drive, Robot

FIRST = 3  # samples whose median is the first angle
NEAR = 3.0  # standard deviations of the noise, within which the first reading is known
FASTEST = 0.99  # of the changes from reading to reading: the largest are spikes
LEAST = 1e-6  # [rad, m, s] a reading is never surer
WIDEST = 60.0  # [rad]: a hinge that seems to move so far is logged in degrees
REMEDY = 'name it in the header, as in "angle [deg]", or as unit in a mapping (qpal info FILE --write-map MAP.toml)'


@dataclass(frozen=True)
class RobotLog:
    """Commands u (N, drives), each held for Ts [s], and readings y (N, drives) [rad or m], NaN where one is lost.

    `odd` (N, drives) are readings that were taken out because no joint makes them; `units` are those of command and
    position in the file, drive by drive. `posture` are the angles [rad or m] of joints that were held meanwhile.
    """

    name: str
    u: np.ndarray
    y: np.ndarray
    Ts: float
    odd: np.ndarray = field(default_factory=lambda: np.zeros((0, 0), dtype=bool), repr=False)
    units: tuple[tuple[str, str], ...] = ()
    posture: Mapping[str, float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if self.odd.shape != self.y.shape:
            object.__setattr__(self, "odd", np.zeros(self.y.shape, dtype=bool))

    def without(self, odd: np.ndarray) -> "RobotLog":
        """The log without the readings (N, drives) that are odd."""
        return replace(self, y=np.where(odd, np.nan, self.y), odd=self.odd | odd)

    def part(self, rows: slice | None = None, drives: Sequence[int] | None = None) -> "RobotLog":
        """Some rows, or some drives, of the log."""
        rows, columns = rows or slice(None), slice(None) if drives is None else list(drives)
        u, y, odd = (each[rows][:, columns] for each in (self.u, self.y, self.odd))
        return replace(self, u=u, y=y, odd=odd, units=())

    @property
    def start(self) -> np.ndarray:
        """The start (3, drives) of a log at rest: first reading, no speed, and the first command held before it."""
        first = [np.median(column[np.isfinite(column)][:FIRST]) for column in self.y.T]
        return np.array([first, np.zeros(len(first)), self.u[0]])

    @property
    def doubt(self) -> np.ndarray:
        """How far (3, drives) the log may be from that start, as deviations."""
        firsts = [column[np.isfinite(column)][:FIRST] for column in self.y.T]
        reading = NEAR * np.maximum(self.noise, LEAST) + np.array([np.ptp(first) for first in firsts])
        speed = np.nanquantile(np.abs(np.diff(self.y, axis=0)), FASTEST, axis=0) / self.Ts
        return np.maximum([reading, speed, np.ptp(self.u, axis=0)], LEAST)

    @property
    def noise(self) -> np.ndarray:
        """Standard deviation (drives,) of white noise on the readings."""
        return np.array([noise_of(column) for column in self.y.T])


def read(
    path: str, robot: Robot, input: str | None = None, output: str | None = None, mapping: ChannelMapping | None = None
) -> RobotLog:
    """The log at `path`; `input` and `output` name its columns, "a,b", in the order of the robot's drives.

    Without them, a log of one drive is read by guess, as everywhere. Raises InputError for a file that cannot be read,
    for columns that it lacks, for another number of columns than drives, and for units that are not those of a drive.
    """
    several = len(robot.drives) > 1
    names = ", ".join(drive.name for drive in robot.drives)
    if several and mapping is None and not (input and output):
        raise InputError(
            f"{path}: which columns are the commands and positions of {names}? give them in this order with --input "
            "a,b --output a,b, or in a mapping with --map"
        )
    record = read_record(path, input, output, mapping=mapping, missing="outputs", moving=not several)
    if not np.ptp(record.data.u, axis=0).any():
        raise InputError(f"{path}: no command changes; give a log in which a joint is moved")
    for role, signals in (("input", record.signals.input), ("output", record.signals.output)):
        if len(signals) != len(robot.drives):
            raise InputError(
                f"{path}: {len(signals)} {role} column(s) for {len(robot.drives)} actuator(s) ({names}); give one each"
            )
    for drive, command, position in zip(robot.drives, record.signals.input, record.signals.output, strict=True):
        _check_unit(path, drive, "output", position.column, position.unit, drive.unit)
        if drive.servo:
            _check_unit(path, drive, "input", command.column, command.unit, drive.unit)
    data = record.data
    y = np.where(data.observed, data.y, np.nan)
    for drive, column in zip(robot.drives, y.T, strict=True):
        if drive.unit == "rad" and np.nanmax(np.abs(column)) > WIDEST:
            raise InputError(
                f"{path}: the position of {drive.name} reaches {np.nanmax(np.abs(column)):.4g} rad; where its unit is "
                f"another one, {REMEDY}"
            )
    channels = zip(record.signals.mapping.input, record.signals.mapping.output, strict=True)
    units = tuple((command.unit, position.unit) for command, position in channels)
    return RobotLog(Path(path).name, data.u, y, data.Ts, units=units, posture=posture(path, robot))


def _check_unit(path: str, drive: Drive, role: str, column: str, unit: str, allowed: str) -> None:
    """No unit stands for SI."""
    if unit not in ("", allowed):
        raise InputError(
            f"{path}: the {role} {column!r} is in {unit}, and actuator {drive.name!r} needs {allowed}; {REMEDY}"
        )
