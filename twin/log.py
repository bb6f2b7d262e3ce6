"""Log: what an excitation experiment recorded, to and from a file of any format of `sysid.formats`.

And whether its numbers can be those of a joint of the leg.
"""

import json
import shlex
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from sysid.base.checks import checked, short_text
from sysid.base.errors import InputError, unknown
from sysid.base.quantities import SHARE
from sysid.channels.clock import contradiction_of_header, stated_sampling_time
from sysid.channels.column import parse_header
from sysid.channels.guess import guess
from sysid.channels.mapping import Channel, ChannelMap, Clock, Repair
from sysid.channels.reading import Mapping as MapOrFile
from sysid.channels.reading import read_map_of, sample
from sysid.channels.roles import REFERENCE
from sysid.channels.signals import Signal, Signals
from sysid.data.record import IOData
from sysid.data.table import Table
from sysid.formats import read_table, write_table
from twin.hardware.linkage import end_angles, stroke
from twin.parameters import JOINTS, LEG, Parameters

TIME = "time_s"
INPUTS = {"voltage": "voltage", "servo": "reference"}  # name of the input by mode
UNITS = {"voltage": ("V",), "servo": ("V", "rad")}  # of the input
# What no joint of a leg like this one shows; chosen by hand.
WIDER = 3.0  # times the stroke: what no offset, slope or other leg explains; degrees would be 57 times
SLOWER = 2.0  # times the stroke in one step: a slower leg, of which a sample still shows a motion
LARGER = 10.0  # times the supply: a voltage that no drive gives; millivolts would be 1000 times
_RARE = 0.005  # of the samples at either end, which may be spikes
_MAP = "in a mapping (qpal info FILE --write-map MAP.toml) and give it with --map"


@checked(deferred=("u", "y", "y_true"))
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
                array = np.asarray(values)
            except (TypeError, ValueError):
                array = np.empty(())
            if array.dtype.kind not in "biuf" or not array.ndim or len(array) != len(self.u):
                raise InputError(f"{name} is {short_text(values)}; give an array of numbers, as many as u has")
            object.__setattr__(self, name, array)

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
        mask = np.zeros(self.N, dtype=bool)
        mask[list(self.meta.get("filled", ()))] = True
        missing = mask if mask.any() else None
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
        mapping_of_log = _map_of_log(table, meta) if mapping is None else None
        if mapping_of_log is not None:
            if contradiction := contradiction_of_header(table, mapping_of_log.clock, table.numbers(TIME)):
                raise InputError(
                    f"{table.path}: {contradiction}; correct the one that is wrong, or read it with a mapping"
                )
            signals = sample(table, mapping_of_log)
        elif mapping is not None:
            signals = sample(table, read_map_of(mapping))
        else:
            result = guess(table)
            signals = sample(table, result.sure(table), result.why)
        log = _log(signals, meta, table)
        return log if joint is None else _of_joint(log, joint, table.path)


def column_names(joint: str, mode: str, unit: str = "V") -> tuple[list[str], list[str], list[str]]:
    """Names of a file's columns of input, measured angle and true angle."""
    parts = [f"_{name}" for name in JOINTS] if joint == LEG else [""]
    return (
        [f"{INPUTS[mode]}{part}_{unit}" for part in parts],
        [f"angle{part}_rad" for part in parts],
        [f"angle_true{part}_rad" for part in parts],
    )


def _map_of_log(table: Table, meta: Mapping[str, Any]) -> ChannelMap | None:
    """The mapping of a log that `save` wrote, by its columns; None for another one.

    A header that names a joint is held to the columns of such a log. Without one, all of them have to be there: others
    write time_s and voltage_V too, beside an angle in degrees.
    """
    kinds = [(mode, unit) for mode, units in UNITS.items() for unit in units]
    for mode, unit in kinds:
        for joint in (LEG, str(meta.get("joint", ""))):
            names = column_names(joint, mode, unit)
            required = {TIME, names[0][0]} if meta.get("joint") else {TIME, *names[0], *names[1]}
            if required <= set(table.names):
                true = names[2] if set(names[2]) <= set(table.names) else []
                groups = [(names[0], unit), (names[1], "rad"), (true, "rad")]
                u, y, true_signals = (
                    tuple(Channel(column=name, unit=group_unit) for name in group) for group, group_unit in groups
                )
                # A rig leaves the cell of a sample empty that it has lost.
                repair = Repair(empty="outputs") if "rig" in meta else Repair()
                return ChannelMap(clock=Clock(column=TIME), input=u, output=y, other=true_signals, repair=repair)
    return None


def _log(signals: Signals, meta: dict[str, Any], table: Table) -> Log:
    """The log of signals that have the units of the twin."""
    if len(signals.lengths) > 1:
        raise InputError(
            f"{signals.path}: the file holds {len(signals.lengths)} experiments and this takes one; set part = 1 to "
            f"{len(signals.lengths)} under [range] of a mapping, which keeps one of them"
        )
    u_unit, mode = _check_channels(signals)
    joint = str(meta.get("joint", LEG if len(signals.output) == len(JOINTS) else ""))
    names = column_names(joint, mode, u_unit)
    written_here = all(
        set(group_names) <= {signal.column for signal in group}
        for group_names, group in zip(names, (signals.input, signals.output), strict=False)
    )
    true = [signal for signal in signals.other if signal.column.startswith("angle_true")]
    filled_samples = np.flatnonzero(np.any([signal.missing for signal in signals.output], axis=0))
    content: dict[str, Any] = dict(meta)
    if not written_here:
        content |= {"file": dict(table.meta)} if table.meta and not meta else {}
        content |= {"channels": signals.as_dict()["mapping"]}
    if signals.notes or not written_here:
        content |= {"notes": list(signals.notes), "repairs": dict(signals.counts)}
    if len(filled_samples):
        content |= {"filled": filled_samples.tolist()}
    if mode != "voltage":
        content |= {"mode": mode} | ({"u_unit": u_unit} if u_unit != "V" else {})
    Ts = stated_sampling_time(table)
    Ts = Ts if meta and Ts is not None and abs(Ts - signals.Ts) <= 1e-3 * signals.Ts else signals.Ts
    return Log(
        _stack_columns([signal.values for signal in signals.input]),
        _stack_columns([signal.values for signal in signals.output]),
        Ts,
        _stack_columns([signal.values for signal in true]) if len(true) == len(signals.output) else None,
        joint,
        content,
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


_CONVERTED = {"counts", "1", SHARE, "V", "A", "m", "rad"}  # what a mapping may turn into an angle or a voltage
_COMMANDS = {"cmd", "command", "commanded"}  # a commanded voltage is a voltage


def _wrong_unit(signals: Signals, signal: Signal, role: str, allowed: str, line: str) -> InputError:
    have = f"in {signal.unit}" if signal.unit else "in no known unit"
    if signal.unit and signal.unit not in _CONVERTED:  # a temperature is no angle in another unit
        return InputError(
            f"{signals.path}: the {role} {signal.column!r} is {have}, and the twin is a leg, which needs {allowed}; "
            f"for another plant: qpal identify {shlex.quote(str(signals.path))}"
        )
    return InputError(
        f"{signals.path}: the {role} {signal.column!r} is {have}, and the twin needs {allowed}; set {line} of "
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


def _stack_columns(columns: list[np.ndarray]) -> np.ndarray:
    return columns[0] if len(columns) == 1 else np.column_stack(columns)


def _columns(log: Log) -> dict[str, np.ndarray]:
    names = column_names(log.joint, log.mode, log.u_unit)
    columns = {TIME: np.round(log.t, 9)}  # k Ts in decimals, as it would be written by hand
    for group, values in zip(names, (log.u, log.y, log.y_true), strict=True):
        if values is not None:
            columns |= dict(zip(group, values.reshape(log.N, -1).T, strict=True))
    return columns


def check_plausible(log: Log, joint: str, parameters: Parameters, label: str = "the log") -> None:
    """Raises InputError for a log that cannot be of `joint`, with the numbers that say so and what to set.

    Columns may be exchanged, units misnamed. A search in the twin would take minutes, or days of simulated time, to
    find that nothing explains such a log.
    """
    data = log.io(joint if log.joint else None)
    u, y = data.u[:, 0], data.y[data.observed[:, 0], 0]
    low, high = end_angles(parameters, joint)
    supply, moves = parameters["supply_voltage"], high - low
    span, drive = _span(y), _span(u)
    largest = float(np.quantile(np.abs(u), 1.0 - _RARE))
    if span > WIDER * moves:
        message = f"the angle of {label} spans {span:.3g} rad and the {joint} moves {moves:.3g} rad from end to end"
        if log.mode == "voltage" and drive <= WIDER * moves and float(np.abs(y).max()) <= LARGER * supply:
            raise InputError(
                f"{message}, while the voltage spans {drive:.3g} V only: the columns may be exchanged; correct the "
                f"header of the log, or exchange the columns of [[input]] and [[output]] {_MAP}"
            )
        raise InputError(
            f'{message}: the angle may be in another unit; name the unit of its numbers, as unit = "deg", under '
            f"[[output]] {_MAP}"
        )
    if log.u_unit == "V" and largest > LARGER * supply:
        raise InputError(
            f"the voltage of {label} reaches {largest:.5g} V and the supply has {supply:g} V: it may be in another "
            f'unit; name the unit of its numbers, as unit = "mV", under [[input]] {_MAP}'
        )
    volts = min(largest, supply) if log.mode == "voltage" else supply
    crossing = _crossing(parameters, joint, volts)
    if log.Ts > SLOWER * crossing:
        raise InputError(
            f"{label} is sampled every {log.Ts:g} s, and at {volts:.3g} V the {joint} crosses its whole stroke in "
            f'{crossing:.2g} s: the times may be in another unit; name it, as unit = "ms", under [clock] {_MAP}'
        )


def _span(x: np.ndarray) -> float:
    """The range of x (N,) without its rarest values."""
    low, high = np.quantile(x, (_RARE, 1.0 - _RARE))
    return float(high - low)


def _crossing(parameters: Parameters, joint: str, volts: float) -> float:
    """Time [s] in which the unloaded drive goes from end to end; infinite without a voltage."""
    low, high = stroke(parameters, joint)
    speed = parameters[f"{joint}.no_load_speed"] * volts / parameters[f"{joint}.rated_voltage"]
    return (high - low) / speed if speed > 0.0 else float("inf")
