"""Flight logs of PX4 (.ulg) by pyulog. Needs the extra `ulog`."""

from pathlib import Path
from typing import ClassVar

from sysid.data.table import Table
from sysid.formats._format import Format
from sysid.formats._groups import Group, damage, libraries_of, table_of_groups

LIBRARIES = {"pyulog": "pyulog"}
MICRO = 1e-6  # [s] of a stamp


class Ulog(Format):
    """Reads .ulg: each number of a topic is the column topic.field, with topic.time in seconds since the log began.

    A topic of several instances is called topic[k].
    """

    suffixes: ClassVar[tuple[str, ...]] = (".ulg",)
    written: ClassVar[tuple[str, ...]] = ()
    headed: ClassVar[bool] = False

    @staticmethod
    def libraries(path: Path) -> tuple[str, ...]:
        """The module that reads this file."""
        return libraries_of(path, LIBRARIES, "ulog", "ULog files")

    def read(self, path: Path) -> Table:
        """The topics in `path`; raises InputError if it is damaged or has no numbers."""
        from pyulog import ULog

        with damage(path, "ULog", "download it from the vehicle again"):
            log = ULog(str(path))
        names = [topic.name for topic in log.data_list]
        groups = []
        for topic in log.data_list:
            name = topic.name if names.count(topic.name) == 1 else f"{topic.name}[{topic.multi_id}]"
            group = Group(name, (topic.data["timestamp"].astype(float) - log.start_timestamp) * MICRO)
            for field, values in topic.data.items():
                is_stamp = field.startswith("timestamp") and values.dtype.kind == "u"
                if field != "timestamp":
                    seconds = (values.astype(float) - log.start_timestamp) * MICRO if is_stamp else values
                    group.channels[f"{name}.{field}"] = seconds
                    group.units |= {f"{name}.{field}": "s"} if is_stamp else {}
            groups.append(group)
        notes = [f"{len(log.dropouts)} dropout(s) of the logger"] if log.dropouts else []
        return table_of_groups(path, groups, "sample", notes)
