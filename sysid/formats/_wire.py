"""How a table goes from the process that reads a file to the one that asked: plain numbers and JSON, nothing that runs.

The file holds the columns, then a JSON object that says where each of them is, then its length in 8 bytes.
"""

import json
import mmap
import os
from pathlib import Path
from typing import Any

import numpy as np

from sysid.data.table import Table

_TAIL = 8  # bytes of the length


def write(file: int, found: Table | None, **said: Any) -> None:
    """Writes a table, and whatever else is said, into the open file descriptor."""
    place, columns = 0, []
    for values in found.columns if found else ():
        values = np.ascontiguousarray(values)
        columns.append((values.dtype.str, len(values), place))
        _all(file, memoryview(values).cast("B") if len(values) else b"")
        place += values.nbytes
    if found:
        said["table"] = {
            "names": found.names,
            "columns": columns,
            "place": found.place,
            "units": dict(found.units),
            "meta": dict(found.meta),
            "notes": found.notes,
            "timed": sorted(found.timed),
            "local": dict(found.local),
        }
    text = json.dumps(said).encode()
    _all(file, text + len(text).to_bytes(_TAIL, "little"))


def read(file: int, path: Path) -> dict[str, Any]:
    """What `write` said, its table as `table`. Raises ValueError or KeyError if it was not written to the end."""
    size = os.fstat(file).st_size
    if size < _TAIL:
        raise ValueError("nothing was written")
    held = mmap.mmap(file, size, access=mmap.ACCESS_COPY)  # arrays keep it; nothing is copied
    end = size - _TAIL
    length = int.from_bytes(held[end:], "little")
    said = json.loads(held[max(0, end - length) : end])
    if "table" in said:
        table = said["table"]
        columns = tuple(np.frombuffer(held, kind, count, place) for kind, count, place in table["columns"])
        rows = tuple(range(1, len(values) + 1) for values in columns)
        said["table"] = Table(
            path,
            tuple(table["names"]),
            columns,
            rows,
            place=table["place"],
            units=table["units"],
            meta=table["meta"],
            notes=tuple(table["notes"]),
            timed=frozenset(table["timed"]),
            local=table["local"],
        )
    return said


def _all(file: int, raw: Any) -> None:
    left = memoryview(raw)
    while left:
        left = left[os.write(file, left) :]
