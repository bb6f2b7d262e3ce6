"""Logs of robots: MCAP files and ROS bags, whose topics come at rates of their own. Needs the extra `robot`."""

import json
import math
from array import array
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, fields, is_dataclass
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from sysid.base.errors import InputError
from sysid.data.table import Table
from sysid.formats._format import Format
from sysid.formats._groups import damage, libraries_of
from sysid.formats._unit_names import units_of

LONGEST = 64  # elements of a list in a message that become columns; an image or a scan is no signal
SECOND = 1_000_000_000  # [ns]
LIBRARIES = {"mcap.reader": "mcap", "rosbags.highlevel": "rosbags"}


@dataclass(frozen=True)
class Stamp:
    """A point in time inside a message [ns since 1970]."""

    ns: int


class Topic:
    """The messages of one topic: log times [ns] and a column for each number in them."""

    def __init__(self) -> None:
        self.times = array("q")
        self.columns: dict[str, array] = {}
        self.stamps: set[str] = set()

    def add(self, time: int, message: Any) -> None:
        """Takes one message; a number that it lacks is NaN."""
        count = len(self.times)
        self.times.append(time)
        for name, value in _numbers("", message):
            if isinstance(value, Stamp):
                self.stamps.add(name)
            if name not in self.columns:
                # Whole nanoseconds since 1970 do not fit a float64.
                self.columns[name] = (
                    array("q", [time] * count) if isinstance(value, Stamp) else array("d", [math.nan]) * count
                )
            column = self.columns[name]
            if len(column) == count:
                column.append(value.ns if isinstance(value, Stamp) else value)
        for name, column in self.columns.items():
            if len(column) == count:
                column.append(time if name in self.stamps else math.nan)


class RobotLog(Format):
    """Reads .mcap (messages in JSON, ROS 1 or ROS 2), .db3, .bag and folders of rosbag2: each number of a topic is the
    column topic.field.

    `topic.time` is the log time of its messages, in seconds since the first message of the file; columns of several
    topics have several lengths. Element k (from 0) of a list is called field[k], or field[joint] where the message
    names its joints as JointState does. Lists of more than 64 elements and texts are left out.
    """

    suffixes: ClassVar[tuple[str, ...]] = (".bag", ".db3", ".mcap")
    written: ClassVar[tuple[str, ...]] = ()
    headed: ClassVar[bool] = False

    @staticmethod
    def libraries(path: Path) -> tuple[str, ...]:
        """The modules that read this file, loaded once for many files. Raises InputError if one is not installed."""
        return libraries_of(path, LIBRARIES, "robot", "robot logs")

    def read(self, path: Path) -> Table:
        """The numbers in `path`; raises InputError if it is damaged, has none, or the extra is not installed."""
        topics: dict[str, Topic] = {}
        notes: list[str] = []
        omitted: dict[str, str] = {}
        is_mcap = path.suffix.lower() == ".mcap"
        messages = _mcap_messages(path, notes, omitted) if is_mcap else _ros_messages(path, omitted)
        with damage(path, "robot log", "repair it with mcap recover or ros2 bag reindex, or record it again"):
            for name, time, message in messages:
                topics.setdefault(name.removeprefix("/"), Topic()).add(time, message)
        if omitted:
            notes.append(f"left out {', '.join(f'{topic} ({reason})' for topic, reason in omitted.items())}")
        return _table(path, topics, notes)


def _table(path: Path, topics: dict[str, Topic], notes: list[str]) -> Table:
    """The table of all topics, times in seconds since the first message."""
    if not any(topic.columns for topic in topics.values()):
        topics_found = ", ".join(topics) or "no messages"
        raise InputError(
            f"{path} has no numbers; found {topics_found} {'; '.join(notes)}; record a topic that has signals"
        )
    start = min(min(topic.times) for topic in topics.values())
    columns: dict[str, np.ndarray] = {}
    clocks: dict[str, str] = {}
    seconds = []
    for name, topic in topics.items():
        if topic.columns:
            columns[f"{name}.time"] = (np.array(topic.times) - start) / SECOND
            seconds.append(f"{name}.time")
        for field, values in topic.columns.items():
            column = f"{name}.{field}" if field != "time" else f"{name}.message.time"
            stamp = field in topic.stamps
            columns[column] = (np.array(values) - start) / SECOND if stamp else np.array(values)
            seconds += [column] if stamp else []
            clocks[column] = f"{name}.time"
    notes.append(f"times are seconds since the first message, at {start} ns since 1970")
    return Table(
        path,
        tuple(columns),
        tuple(columns.values()),
        tuple(range(1, len(values) + 1) for values in columns.values()),
        place="message",
        units=units_of(columns) | dict.fromkeys(seconds, "s"),
        meta={"start_ns": start},
        notes=tuple(notes),
        clocks=clocks,
    )


def _mcap_messages(path: Path, notes: list[str], omitted: dict[str, str]) -> Iterator[tuple[str, int, Any]]:
    """Topic, log time [ns] and message. A file that was cut is read up to there, which is noted."""
    from mcap.reader import NonSeekingReader, make_reader

    decoders: dict[int, Any] = {}
    with path.open("rb") as file:
        reader: Any = make_reader(file, validate_crcs=True)
        try:
            whole = reader.get_summary() is not None
        except Exception:  # the summary stands at the end, which a cut file lacks
            whole = False
        if not whole:
            file.seek(0)
            reader = NonSeekingReader(file, validate_crcs=True)
        count = 0
        try:
            for schema, channel, message in reader.iter_messages(log_time_order=whole):
                if channel.id not in decoders:
                    decoders[channel.id] = _decoder(schema, channel)
                decoder = decoders[channel.id]
                if callable(decoder):
                    yield channel.topic, message.log_time, decoder(message.data)
                else:
                    omitted[channel.topic] = decoder
                count += 1
        except Exception as error:  # mcap has no one class for what a cut does
            if whole or not count:
                raise
            notes.append(f"the file is cut off ({type(error).__name__}); kept the {count} messages before")


def _decoder(schema: Any, channel: Any) -> Any:
    """What takes the bytes of a message to the message; a text that says why not, if there is none."""
    encoding = channel.message_encoding
    if encoding == "json":
        return json.loads
    if encoding not in ("cdr", "ros1") or schema is None:
        return f"messages in {encoding}"
    from rosbags.typesys import Stores, get_types_from_idl, get_types_from_msg, get_typestore

    text = schema.data.decode()
    idl = schema.encoding == "ros2idl"
    name = schema.name if "/msg/" in schema.name or "/" not in schema.name else schema.name.replace("/", "/msg/", 1)
    store = get_typestore(Stores.EMPTY)
    store.register(get_types_from_idl(text) if idl else get_types_from_msg(text, name))
    read = store.deserialize_ros1 if encoding == "ros1" else store.deserialize_cdr
    return lambda raw: read(raw, name)


def _ros_messages(path: Path, omitted: dict[str, str]) -> Iterator[tuple[str, int, Any]]:
    """Topic, log time [ns] and message of a bag of ROS 1 or ROS 2."""
    from rosbags.highlevel import AnyReader
    from rosbags.typesys import Stores, get_typestore

    with AnyReader([path], default_typestore=get_typestore(Stores.LATEST)) as reader:
        readable = [
            connection_ for connection_ in reader.connections if connection_.msgtype in reader.typestore.fielddefs
        ]
        omitted |= {
            connection_.topic: f"unknown type {connection_.msgtype}"
            for connection_ in reader.connections
            if connection_ not in readable
        }
        for connection, time, raw in reader.messages(connections=readable) if readable else ():
            yield connection.topic, time, reader.deserialize(raw, connection.msgtype)


def _numbers(prefix: str, value: Any) -> Iterator[tuple[str, float | Stamp]]:
    """The numbers in a message by the name of their field."""
    if isinstance(value, bool | int | float | np.number | np.bool_):
        try:
            yield prefix or "value", float(value)
        except OverflowError:
            yield prefix or "value", math.inf
    elif is_dataclass(value):
        kind = getattr(value, "__msgtype__", "")
        if kind.endswith("/Time") and hasattr(value, "nanosec"):
            yield prefix, Stamp(int(getattr(value, "sec", 0)) * SECOND + int(value.nanosec))
        else:
            members = {
                element.name: getattr(value, element.name) for element in fields(value) if element.name != "__msgtype__"
            }
            yield from _members(prefix, members)
    elif isinstance(value, dict):
        yield from _members(prefix, value)
    elif isinstance(value, list | tuple | np.ndarray) and len(value) <= LONGEST:
        for k, element in enumerate(value):
            yield from _numbers(f"{prefix}[{k}]", element)


def _members(prefix: str, members: Mapping[str, Any]) -> Iterator[tuple[str, float | Stamp]]:
    joints = members.get("name", ())
    named = isinstance(joints, list) and bool(joints) and all(isinstance(joint, str) for joint in joints)
    for name, value in members.items():
        column = f"{prefix}.{name}" if prefix else str(name)
        if named and isinstance(value, list | tuple | np.ndarray) and len(value) == len(joints) and name != "name":
            for joint, element in zip(joints, value, strict=True):
                yield from _numbers(f"{column}[{joint}]", element)
        else:
            yield from _numbers(column, value)
