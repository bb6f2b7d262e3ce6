"""Readers of recorded files: one file a format, one class, one line in `TABLE`, which goes by the file's suffix."""

import os
from pathlib import Path
from typing import Protocol

from sysid.base.errors import InputError
from sysid.data.table import Table
from sysid.formats.delimited import Delimited
from sysid.formats.mat import Mat
from sysid.formats.parquet import Parquet


class Reader(Protocol):
    """What every reader offers."""

    def read(self, path: Path) -> Table:
        """The columns of the file at `path`; raises InputError where it is not such a file."""
        ...


TABLE: dict[str, type] = {".csv": Delimited, ".dat": Delimited, ".mat": Mat, ".parquet": Parquet, ".txt": Delimited}


def read_table(path: str | os.PathLike[str]) -> Table:
    """The columns of the file at `path`, read by the reader that `TABLE` has for its suffix."""
    path = Path(path)
    allowed = ", ".join(TABLE)
    if path.is_dir():
        raise InputError(f"{path} is a folder; give one file ({allowed})")
    if not path.exists():
        raise InputError(f"{path} does not exist; check the name and the folder you are in")
    if path.suffix.lower() not in TABLE:
        raise InputError(f"{path}: unknown file suffix {path.suffix!r}; give a file of {allowed}")
    try:
        if path.is_file() and path.stat().st_size == 0:
            raise InputError(f"{path} is empty; give a file with at least one column of input and one of output")
        return TABLE[path.suffix.lower()]().read(path)
    except OSError as error:
        raise InputError(
            f"{path} cannot be read ({error.strerror or error}); check that it is a readable file"
        ) from None


__all__ = ["TABLE", "Delimited", "Mat", "Parquet", "Reader", "read_table"]
