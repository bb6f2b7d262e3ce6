"""Measurements of LabVIEW and DIAdem (.tdms) by npTDMS. Needs the extra `tdms`."""

from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from sysid.data.table import Table
from sysid.formats._arrays import NUMERIC, TIMES, seconds
from sysid.formats._format import Format
from sysid.formats._groups import Group, damage, group_of, libraries_of, table_of_groups

LIBRARIES = {"nptdms": "npTDMS"}
CLOCKS = ("time", "t", "timestamp", "zeit", "x_value")  # channels that are the time of their group, in small letters


class Tdms(Format):
    """Reads .tdms: every channel of numbers. Its time is that of its waveform (start, offset, increment), else the
    channel of its group that is called time, else none.
    """

    suffixes: ClassVar[tuple[str, ...]] = (".tdms",)
    written: ClassVar[tuple[str, ...]] = ()
    headed: ClassVar[bool] = False

    @staticmethod
    def libraries(path: Path) -> tuple[str, ...]:
        """The module that reads this file."""
        return libraries_of(path, LIBRARIES, "tdms", "TDMS files")

    def read(self, path: Path) -> Table:
        """The channels in `path`; raises InputError if it is damaged or has no numbers."""
        from nptdms import TdmsFile

        with damage(path, "TDMS", "write it again with what made it"):
            groups = [part for group in TdmsFile.read(path).groups() for part in _groups(group)]
        first = min((group.t[0] for group in groups if group.t is not None and len(group.t)), default=0.0)
        for group in groups:
            if group.t is not None and abs(first) > 1e8:  # since 1970
                group.t = group.t - first
        return table_of_groups(path, groups, "sample")


def _groups(group: Any) -> list[Group]:
    """The channels of a group by their times."""
    channels = [channel for channel in group.channels() if len(channel) and channel.dtype.kind in NUMERIC + TIMES]
    clock = next((channel for channel in channels if channel.name.strip().lower() in CLOCKS), None)
    parts: list[Group] = []
    for channel in channels:
        if channel is clock:
            continue
        name = group.name if not parts else f"{group.name}.{channel.name}"
        part = group_of(parts, name, _time(channel, clock))
        part.channels[channel.name] = channel[:]
        part.units[channel.name] = str(channel.properties.get("unit_string", ""))
    return parts


def _time(channel: Any, clock: Any) -> np.ndarray | None:
    """The times (n,) [s] of a channel; since 1970 where its waveform has a date; None where nothing says them."""
    step, start = channel.properties.get("wf_increment"), channel.properties.get("wf_start_time")
    if step:
        t = float(channel.properties.get("wf_start_offset", 0.0)) + step * np.arange(len(channel))
        is_date = isinstance(start, np.datetime64) and start > np.datetime64("1980-01-01")
        return t + (start - np.datetime64(0, "s")) / np.timedelta64(1, "s") if is_date else t
    if clock is None or len(clock) != len(channel):
        return None
    values = clock[:]
    if values.dtype.kind == "M":
        return seconds(values - np.datetime64(0, "us"))
    return seconds(values) if values.dtype.kind == "m" else values.astype(float)
