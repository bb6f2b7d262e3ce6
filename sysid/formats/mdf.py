"""Measurement data files of ASAM (.mf4, .mdf) by asammdf. Needs the extra `mdf`."""

from pathlib import Path
from typing import Any, ClassVar

from sysid.data.table import Table
from sysid.formats._format import Format
from sysid.formats._groups import Group, damage, group_of, libraries_of, table_of_groups

LIBRARIES = {"asammdf": "asammdf"}


class Mdf(Format):
    """Reads .mf4 and .mdf: every channel of numbers, each group with its own time.

    Numbers that stand for words stay numbers; samples that are marked as invalid are left out.
    """

    suffixes: ClassVar[tuple[str, ...]] = (".mdf", ".mf4")
    written: ClassVar[tuple[str, ...]] = ()
    headed: ClassVar[bool] = False

    @staticmethod
    def libraries(path: Path) -> tuple[str, ...]:
        """None that can be loaded once for many files: numexpr has threads, which a fork would lose."""
        libraries_of(path, LIBRARIES, "mdf", "ASAM MDF files")
        return ()

    def read(self, path: Path) -> Table:
        """The channels in `path`; raises InputError if it is damaged or has no numbers."""
        from asammdf import MDF

        with damage(path, "MDF", "write it again with what made it"), MDF(path) as file:
            groups = [group for k in range(len(file.groups)) for group in _groups(file, k)]
        return table_of_groups(path, groups, "sample")


def _groups(file: Any, k: int) -> list[Group]:
    """The channels of group k by their times: samples that are invalid in one channel alone are not in its time."""
    groups: list[Group] = []
    for j, channel in enumerate(file.groups[k].channels):
        if j == file.masters_db.get(k):
            continue
        signal = file.get(channel.name, group=k, index=j)
        if signal.samples.dtype.kind in "SUO":
            signal = file.get(channel.name, group=k, index=j, raw=True)
        group = group_of(
            groups, getattr(file.groups[k].channel_group, "acq_name", "") or channel.name, signal.timestamps
        )
        group.channels[channel.name] = signal.samples
        group.units[channel.name] = signal.unit
    return groups
