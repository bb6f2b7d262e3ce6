"""What a format of recorded files is."""

from collections.abc import Mapping
from pathlib import Path
from typing import ClassVar, Protocol

import numpy as np

from sysid.base.errors import InputError
from sysid.data.table import Table


class Format(Protocol):
    """The interface of every format; one that only reads keeps `write` and `header` as they are here.

    `suffixes`: suffixes that it reads; `written`: those that it also writes, () if none. `headed`: whether the file
    keeps a header, a text in addition to the columns. Every class declares all three.
    """

    suffixes: ClassVar[tuple[str, ...]]
    written: ClassVar[tuple[str, ...]]
    headed: ClassVar[bool]

    def read(self, path: Path) -> Table:
        """The columns of the file at `path`; raises InputError if the file does not have this format."""
        ...

    def write(self, path: Path, columns: Mapping[str, np.ndarray], header: str) -> None:
        """Write columns (N,) by name, and `header` if the format keeps one; called only for `written` suffixes."""
        raise InputError(f"{path}: files of this format are only read")

    def header(self, path: Path) -> str:
        """The header that `write` stored in the file at `path`; empty if there is none."""
        return ""
