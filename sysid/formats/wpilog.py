"""Data logs of WPILib (.wpilog), by the layout that is published as "WPILib Data Log File Format" (version 1.0).

A header (`WPILOG`, version, extra text), then records: one byte with the lengths of the three numbers that follow
(entry, size of the payload, time stamp [us], little endian), then the payload. Entry 0 starts and ends the others.
"""

from array import array
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path
from typing import ClassVar

import numpy as np

from sysid.base.errors import InputError
from sysid.data.table import Table
from sysid.formats._format import Format
from sysid.formats._groups import Group, table_of_groups

MAGIC = b"WPILOG"
HEADER = 12  # bytes before the extra text
START = 0  # the control record that begins an entry
KINDS = {"double": "<f8", "float": "<f4", "int64": "<i8", "boolean": "?"}
LONGEST = 64  # elements of an array that become columns
MICRO = 1e-6  # [s] of a stamp


@dataclass
class Entry:
    """The records of one entry: stamps [us] and raw payloads; `kind` is the NumPy type, "" of what is left out."""

    name: str
    type: str
    stamps: array = field(default_factory=lambda: array("q"))
    payloads: list[bytes] = field(default_factory=list)

    @property
    def kind(self) -> str:
        """The type of its numbers."""
        return KINDS.get(self.type.removesuffix("[]"), "")


class Wpilog(Format):
    """Reads .wpilog: each entry of numbers or truth values is a column with a time of its own, in seconds.

    Element k (from 0) of an array is called name[k]; texts and structures are left out and told.
    """

    suffixes: ClassVar[tuple[str, ...]] = (".wpilog",)
    written: ClassVar[tuple[str, ...]] = ()
    headed: ClassVar[bool] = False

    def read(self, path: Path) -> Table:
        """The entries in `path`; raises InputError if it is no such log or has no numbers."""
        raw = path.read_bytes()
        if raw[: len(MAGIC)] != MAGIC or len(raw) < HEADER or raw[7] != 1:
            raise InputError(f"{path} is not a readable log of WPILib (version 1); copy it from the robot again")
        entries, whole = _entries(raw, HEADER + int.from_bytes(raw[8:HEADER], "little"))
        notes = [] if whole else ["the file is cut off; its last record is left out"]
        omitted = [f"{entry.name} ({entry.type})" for entry in entries if not entry.kind and entry.payloads]
        notes += [f"left out {', '.join(omitted)}"] if omitted else []
        groups = [_group(path, entry) for entry in entries if entry.kind and entry.payloads]
        return table_of_groups(path, groups, "record", notes)


def _entries(raw: bytes, place: int) -> tuple[list[Entry], bool]:
    """The entries of the records from `place` on, and whether the last record is whole."""
    entries: list[Entry] = []
    open_entries: dict[int, Entry] = {}
    while place < len(raw):
        bits = raw[place]
        lengths = (bits & 3) + 1, (bits >> 2 & 3) + 1, (bits >> 4 & 7) + 1
        ends = np.cumsum([place + 1, *lengths]).tolist()
        if ends[-1] > len(raw):
            return entries, False
        number, size, stamp = (int.from_bytes(raw[a:b], "little") for a, b in pairwise(ends))
        place = ends[-1] + size
        if place > len(raw):
            return entries, False
        payload = raw[ends[-1] : place]
        if number == 0 and payload[:1] == bytes([START]):
            begun = _start(payload)
            if begun is not None:
                # An entry that is started again under its name goes on.
                entry = next((e for e in entries if (e.name, e.type) == begun[1:]), None) or Entry(*begun[1:])
                entries += [] if any(entry is each for each in entries) else [entry]
                open_entries[begun[0]] = entry
        elif number in open_entries and stamp < 1 << 63:
            open_entries[number].stamps.append(stamp)
            open_entries[number].payloads.append(payload)
    return entries, True


def _start(payload: bytes) -> tuple[int, str, str] | None:
    """Number, name and type of the entry that a control record starts; None of a damaged one."""
    texts, place = [], 5
    for _ in range(2):
        length = int.from_bytes(payload[place : place + 4], "little")
        texts.append(payload[place + 4 : place + 4 + length].decode(errors="replace"))
        place += 4 + length
    return (int.from_bytes(payload[1:5], "little"), texts[0], texts[1]) if place <= len(payload) else None


def _group(path: Path, entry: Entry) -> Group:
    """The numbers of one entry; elements that a shorter array lacks are nan."""
    size = np.dtype(entry.kind).itemsize
    if any(len(payload) % size for payload in entry.payloads):
        raise InputError(f"{path}: entry {entry.name!r} has records that are no {entry.type}; the file is damaged")
    widths = [len(payload) // size for payload in entry.payloads]
    group = Group(entry.name, np.array(entry.stamps, dtype=float) * MICRO)
    if not entry.type.endswith("[]") and set(widths) == {1}:
        group.channels[entry.name] = np.frombuffer(b"".join(entry.payloads), entry.kind).astype(float)
        return group
    rows = [np.frombuffer(payload, entry.kind).astype(float) for payload in entry.payloads]
    for k in range(min(max(widths), LONGEST)):
        group.channels[f"{entry.name}[{k}]"] = np.array([row[k] if k < len(row) else np.nan for row in rows])
    return group
