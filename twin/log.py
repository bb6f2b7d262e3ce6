"""Log: what an excitation experiment recorded, to and from a file of any format of `sysid.formats`."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from sysid.base.errors import InputError, unknown
from sysid.data.record import IOData
from sysid.formats import read_header, read_table, write_table
from twin.parameters import JOINTS, LEG

TIME = "time_s"
INPUTS = {"voltage": "voltage", "servo": "reference"}  # name of the input by mode


@dataclass(frozen=True)
class Log:
    """A record of one joint: input u (N,) [V], measured angle y (N,) [rad], sampled every Ts [s].

    u is the commanded voltage or, in servo mode, the reference of the position loop. y[k] is read at t[k] = k Ts,
    before u[k] is applied over [t[k], t[k+1]). y_true (N,) [rad] is the reading without noise, ADC and dropped samples
    (the potentiometer's nonlinearity is included), None if unknown. A record of all three joints has joint "leg" and
    u, y, y_true (N, 3) in the order of `JOINTS`. `meta` can be written as JSON.
    """

    u: np.ndarray
    y: np.ndarray
    Ts: float
    y_true: np.ndarray | None = None
    joint: str = ""
    meta: Mapping[str, Any] = field(default_factory=dict)

    @property
    def N(self) -> int:
        """Number of samples."""
        return len(self.u)

    @property
    def t(self) -> np.ndarray:
        """Time of each sample (N,) [s]."""
        return np.arange(self.N) * self.Ts

    @property
    def mode(self) -> str:
        """The drive mode: "voltage" or "servo"."""
        return str(self.meta.get("mode", "voltage"))

    def io(self, joint: str | None = None) -> IOData:
        """Input and measured angle, ready to identify; only those of `joint` if the log has all three joints."""
        u, y = self.u, self.y
        if joint is not None and joint != self.joint:
            if self.joint != LEG or joint not in JOINTS:
                raise unknown("joint of this log", joint, JOINTS if self.joint == LEG else (self.joint,))
            u, y = u[:, JOINTS.index(joint)], y[:, JOINTS.index(joint)]
        return IOData(u, y, self.Ts, INPUTS[self.mode], "angle", "V", "rad")

    def save(self, path: str | Path) -> Path:
        """Write a file whose suffix is one of `sysid.formats.WRITTEN`; no half-written file appears.

        Joint and meta stand in the file's header, in a .csv in a comment line at the top. Raises InputError for
        another suffix and for a place that cannot be written to.
        """
        return write_table(path, _columns(self), json.dumps({**self.meta, "joint": self.joint, "Ts": self.Ts}))

    @staticmethod
    def load(path: str | Path) -> "Log":
        """Read what `save` wrote; joint and meta are empty if another program wrote the file.

        Raises InputError, which names the place, for a file that is missing, damaged or not sampled uniformly.
        """
        path = Path(path)
        table = read_table(path)
        meta = _meta(read_header(path))
        joint, mode = _kind(table.names, meta)
        names = column_names(joint, mode)
        required = [TIME, *names[0], *names[1]]
        values = {
            name: table.numbers(name) for name in (*required, *names[2]) if name in table.names or name in required
        }
        t = values[TIME]
        if len({len(column) for column in values.values()}) > 1 or len(t) < 2:
            raise InputError(f"{path}: the columns need one length of at least 2 rows; write the file again")
        steps = np.diff(t)
        off = np.abs(steps - np.median(steps))
        if steps.min() <= 0 or off.max() > 1e-3 * np.median(steps):
            j, k = table.names.index(TIME), int(off.argmax()) + 1
            raise table.error(j, k, f"found a step of {steps[k - 1]:g} s; resample the record to one step")
        u, y, true = ([values[name] for name in group if name in values] for group in names)
        return Log(
            _joined(u),
            _joined(y),
            float(meta.get("Ts", f"{steps.mean():.9g}")),
            _joined(true) if len(true) == len(y) else None,
            joint,
            meta if mode == "voltage" else {**meta, "mode": mode},
        )


def column_names(joint: str, mode: str) -> tuple[list[str], list[str], list[str]]:
    """Names of a file's columns of input, measured angle and true angle."""
    parts = [f"_{each}" for each in JOINTS] if joint == LEG else [""]
    return (
        [f"{INPUTS[mode]}{part}_V" for part in parts],
        [f"angle{part}_rad" for part in parts],
        [f"angle_true{part}_rad" for part in parts],
    )


def _kind(names: Sequence[str], meta: Mapping[str, Any]) -> tuple[str, str]:
    """Joint and mode of a log with these columns."""
    for mode in INPUTS:
        for joint in (LEG, str(meta.get("joint", ""))):
            if column_names(joint, mode)[0][0] in names:
                return joint, mode
    return str(meta.get("joint", "")), "voltage"


def _meta(header: str) -> dict[str, Any]:
    """The header that `save` wrote; empty if another program wrote the file."""
    try:
        found = json.loads(header)
    except ValueError:
        return {}
    return found if isinstance(found, dict) else {}


def _joined(columns: list[np.ndarray]) -> np.ndarray:
    return columns[0] if len(columns) == 1 else np.column_stack(columns)


def _columns(log: Log) -> dict[str, np.ndarray]:
    names = column_names(log.joint, log.mode)
    columns = {TIME: np.round(log.t, 9)}  # k Ts in decimals, as it would be written by hand
    for group, values in zip(names, (log.u, log.y, log.y_true), strict=True):
        if values is not None:
            columns |= dict(zip(group, values.reshape(log.N, -1).T, strict=True))
    return columns
