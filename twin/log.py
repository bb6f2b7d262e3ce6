"""Log: what an excitation experiment recorded, to and from a file of any format of `sysid.formats`."""

import json
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from sysid.base.checks import checked, shown
from sysid.base.errors import InputError, unknown
from sysid.channels.clock import contradiction_of_header, stated_sampling_time
from sysid.channels.column import parse_header
from sysid.channels.guess import guess
from sysid.channels.mapping import Channel, ChannelMap, Clock
from sysid.channels.reading import Mapping as MapOrFile
from sysid.channels.reading import read_map_of, sample
from sysid.channels.roles import REFERENCE
from sysid.channels.signals import Signal, Signals
from sysid.data.record import IOData
from sysid.data.table import Table
from sysid.formats import read_table, write_table
from twin.parameters import JOINTS, LEG

TIME = "time_s"
INPUTS = {"voltage": "voltage", "servo": "reference"}  # name of the input by mode
UNITS = {"voltage": ("V",), "servo": ("V", "rad")}  # of the input


@checked(own=("u", "y", "y_true"))
@dataclass(frozen=True)
class Log:
    """A record of one joint: input u (N,) [V], measured angle y (N,) [rad], sampled every Ts [s].

    u is the commanded voltage or, in servo mode, the reference of the position loop in `u_unit`: V of the potentiometer
    on the bench, rad in most servos. y[k] is read at t[k] = k Ts, before u[k] is applied over [t[k], t[k+1]). y_true
    (N,) [rad] is the reading without noise, ADC and dropped samples (the potentiometer's nonlinearity is included),
    None if unknown. A record of all three joints has joint "leg" and u, y, y_true (N, 3) in the order of `JOINTS`.
    `meta` can be written as JSON. Of a log that another program wrote it
    holds `channels` (the mapping), `repairs` (counts), `notes`, `filled` (samples whose y was lost) and `file` (what
    the writer said).
    """

    u: np.ndarray
    y: np.ndarray
    Ts: float
    y_true: np.ndarray | None = None
    joint: str = ""
    meta: Mapping[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        """Arrays of one length; nan is what a simulation leaves that MuJoCo gave up."""
        for name, values in (("u", self.u), ("y", self.y), ("y_true", self.y_true)):
            if name == "y_true" and values is None:
                continue
            try:
                found = np.asarray(values)
            except (TypeError, ValueError):
                found = np.empty(())
            if found.dtype.kind not in "biuf" or not found.ndim or len(found) != len(self.u):
                raise InputError(f"{name} is {shown(values)}; give an array of numbers, as many as u has")
            object.__setattr__(self, name, found)

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

    @property
    def u_unit(self) -> str:
        """Unit of the input: "V", or "rad" for the reference of a servo that takes angles."""
        return str(self.meta.get("u_unit", "V"))

    @checked(late=True)
    def io(self, joint: str | None = None) -> IOData:
        """Input and measured angle, ready to identify; only those of `joint` if the log has all three joints."""
        u, y = self.u, self.y
        if joint is not None and joint != self.joint:
            if self.joint != LEG or joint not in JOINTS:
                raise unknown("joint of this log", joint, JOINTS if self.joint == LEG else (self.joint,))
            u, y = u[:, JOINTS.index(joint)], y[:, JOINTS.index(joint)]
        filled = np.zeros(self.N, dtype=bool)
        filled[list(self.meta.get("filled", ()))] = True
        missing = filled if filled.any() else None
        return IOData(u, y, self.Ts, INPUTS[self.mode], "angle", self.u_unit, "rad", missing=missing)

    @checked(late=True)
    def save(self, path: str | Path) -> Path:
        """Write a file whose suffix is one of `sysid.formats.WRITTEN`; no half-written file appears.

        Joint and meta stand in the file's header, in a .csv in a comment line at the top. Raises InputError for
        another suffix and for a place that cannot be written to.
        """
        return write_table(path, _columns(self), json.dumps({**self.meta, "joint": self.joint, "Ts": self.Ts}))

    @staticmethod
    @checked(late=True)
    def load(path: str | Path, mapping: MapOrFile | None = None, joint: str | None = None) -> "Log":
        """Read what `save` wrote, or any log whose input is a voltage or a reference and whose output is an angle.

        `mapping`, a ChannelMap or its file, says which columns these are and what is done about gaps; without one they
        are guessed (`qpal info FILE` shows how). `joint` names the joint of a log that does not, and picks one of a log
        of all three. Raises InputError, which names the place, for a file that is missing or damaged, for stamps that
        cannot be made uniform, and for channels in other units, with the line of the mapping to set.
        """
        table = read_table(path)
        meta = dict(table.meta) if table.meta.get("joint") in (*JOINTS, LEG, "") else {}
        own = _own_map(table, meta) if mapping is None else None
        if own is not None:
            if other := contradiction_of_header(table, own.clock, table.numbers(TIME)):
                raise InputError(f"{table.path}: {other}; correct the one that is wrong, or read it with a mapping")
            signals = sample(table, own)
        elif mapping is not None:
            signals = sample(table, read_map_of(mapping))
        else:
            found = guess(table)
            signals = sample(table, found.sure(table), found.why)
        log = _log(signals, meta, table)
        return log if joint is None else _of_joint(log, joint, table.path)


def column_names(joint: str, mode: str, unit: str = "V") -> tuple[list[str], list[str], list[str]]:
    """Names of a file's columns of input, measured angle and true angle."""
    parts = [f"_{each}" for each in JOINTS] if joint == LEG else [""]
    return (
        [f"{INPUTS[mode]}{part}_{unit}" for part in parts],
        [f"angle{part}_rad" for part in parts],
        [f"angle_true{part}_rad" for part in parts],
    )


def _own_map(table: Table, meta: Mapping[str, Any]) -> ChannelMap | None:
    """The mapping of a log that `save` wrote, by its columns; None for another one.

    A header that names a joint is held to the columns of such a log. Without one, all of them have to be there: others
    write time_s and voltage_V too, beside an angle in degrees.
    """
    kinds = [(mode, unit) for mode, units in UNITS.items() for unit in units]
    for mode, unit in kinds:
        for joint in (LEG, str(meta.get("joint", ""))):
            names = column_names(joint, mode, unit)
            needed = {TIME, names[0][0]} if meta.get("joint") else {TIME, *names[0], *names[1]}
            if needed <= set(table.names):
                true = names[2] if set(names[2]) <= set(table.names) else []
                groups = [(names[0], unit), (names[1], "rad"), (true, "rad")]
                u, y, other = (tuple(Channel(column=name, unit=of) for name in group) for group, of in groups)
                return ChannelMap(clock=Clock(column=TIME), input=u, output=y, other=other)
    return None


def _log(signals: Signals, meta: dict[str, Any], table: Table) -> Log:
    """The log of signals that have the units of the twin."""
    u_unit, mode = _check_channels(signals)
    joint = str(meta.get("joint", LEG if len(signals.output) == len(JOINTS) else ""))
    names = column_names(joint, mode, u_unit)
    own = all(
        set(each) <= {signal.column for signal in group}
        for each, group in zip(names, (signals.input, signals.output), strict=False)
    )
    true = [signal for signal in signals.other if signal.column.startswith("angle_true")]
    lost = np.flatnonzero(np.any([signal.missing for signal in signals.output], axis=0))
    said: dict[str, Any] = dict(meta)
    if not own:
        said |= {"file": dict(table.meta)} if table.meta and not meta else {}
        said |= {"channels": signals.as_dict()["mapping"]}
    if signals.notes or not own:
        said |= {"notes": list(signals.notes), "repairs": dict(signals.counts)}
    if len(lost):
        said |= {"filled": lost.tolist()}
    if mode != "voltage":
        said |= {"mode": mode} | ({"u_unit": u_unit} if u_unit != "V" else {})
    Ts = stated_sampling_time(table)
    Ts = Ts if meta and Ts is not None and abs(Ts - signals.Ts) <= 1e-3 * signals.Ts else signals.Ts
    return Log(
        _joined([signal.values for signal in signals.input]),
        _joined([signal.values for signal in signals.output]),
        Ts,
        _joined([signal.values for signal in true]) if len(true) == len(signals.output) else None,
        joint,
        said,
    )


def _check_channels(signals: Signals) -> tuple[str, str]:
    """Unit of the inputs and mode; raises InputError for channels that the twin does not have."""
    n = len(signals.input)
    if n != len(signals.output) or n not in (1, len(JOINTS)):
        raise InputError(
            f"{signals.path}: the mapping has {n} input(s) and {len(signals.output)} output(s); give one of each, or "
            f"{len(JOINTS)} for {', '.join(JOINTS)}"
        )
    for signal in signals.output:
        if signal.unit != "rad":
            raise _wrong_unit(signals, signal, "output", "an angle", 'unit = "deg" or "rad", or adc with such a unit')
    units = {signal.unit for signal in signals.input}
    if units == {"rad"}:
        return "rad", "servo"
    for signal in signals.input:
        if signal.unit != "V":
            raise _wrong_unit(
                signals, signal, "input", "a voltage, or the reference angle of a servo", 'scale and unit = "V"'
            )
    return "V", "servo" if all(parse_header(s.column).has(REFERENCE - _COMMANDS) for s in signals.input) else "voltage"


_COMMANDS = {"cmd", "command", "commanded"}  # a commanded voltage is a voltage


def _wrong_unit(signals: Signals, signal: Signal, role: str, needed: str, line: str) -> InputError:
    have = f"in {signal.unit}" if signal.unit else "in no known unit"
    return InputError(
        f"{signals.path}: the {role} {signal.column!r} is {have}, and the twin needs {needed}; set {line} of "
        f"[[{role}]] in a mapping (qpal info FILE --write-map MAP.toml) and give it with --map"
    )


def _of_joint(log: Log, joint: str, path: Path) -> Log:
    """The log with its joint named, or one joint of all three."""
    if joint not in (*JOINTS, LEG):
        raise unknown("joint", joint, JOINTS)
    if log.joint == joint:
        return log
    if log.joint == LEG:
        k = JOINTS.index(joint)
        true = None if log.y_true is None else log.y_true[:, k]
        return Log(log.u[:, k], log.y[:, k], log.Ts, true, joint, {**log.meta, "joint": joint})
    if log.joint or joint == LEG:
        raise InputError(f"{path}: the log is of {f'the {log.joint}' if log.joint else 'one joint'}, not the {joint}")
    return replace(log, joint=joint)


def _joined(columns: list[np.ndarray]) -> np.ndarray:
    return columns[0] if len(columns) == 1 else np.column_stack(columns)


def _columns(log: Log) -> dict[str, np.ndarray]:
    names = column_names(log.joint, log.mode, log.u_unit)
    columns = {TIME: np.round(log.t, 9)}  # k Ts in decimals, as it would be written by hand
    for group, values in zip(names, (log.u, log.y, log.y_true), strict=True):
        if values is not None:
            columns |= dict(zip(group, values.reshape(log.N, -1).T, strict=True))
    return columns
