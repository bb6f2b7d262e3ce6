"""The results table: one Parquet file, and a journal beside it that takes each row at once.

A row goes to the journal when its cell ends. Now and then, and at the end, the journal is merged into the Parquet file.
A kill at any moment leaves both readable: a row that is in both counts once.
"""

import json
import os
from collections.abc import Collection, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import polars as pl

from sysid.base.errors import InputError
from sysid.base.files import Lines, whole_file
from sysid.bench.columns import COLUMNS, KEY

EVERY = 2000  # rows of the journal before they are merged


class Table:
    """Rows of one run in `path` (.parquet). One process writes; see `writing`."""

    def __init__(self, path: str | os.PathLike) -> None:
        self.path = Path(path)
        if self.path.suffix != ".parquet":
            raise InputError(f"the table is {self.path}; give it a name that ends in .parquet")
        self._journal = Lines(self.path.with_suffix(".journal"))
        self._waiting = 0

    def rows(self) -> pl.DataFrame:
        """All rows, the newest of each key. Raises InputError if there is no table or it is another program's."""
        parts = []
        if self.path.is_file():
            parts.append(_parquet(self.path))
        new = self._new()
        if new:
            parts.append(pl.DataFrame(new, schema=COLUMNS))
        if not parts:
            raise InputError(f"there are no results in {self.path}; run them first: qpal bench run --out {self.path}")
        return pl.concat(parts).unique(list(KEY), keep="last", maintain_order=True)

    def _new(self) -> list[dict[str, Any]]:
        """Rows of the journal."""
        try:
            rows = [json.loads(line) for line in self._journal.read()]
            if any(row[name] is None for row in rows for name in KEY):
                raise ValueError("a row without a key")
        except (ValueError, KeyError, TypeError) as error:
            where = self._journal.path
            raise InputError(f"{where} is damaged ({error}); remove the line, or the file, and run again") from None
        return rows

    def done(self, but: Collection[str] = ()) -> set[tuple[str, str, int]]:
        """Keys of the rows that are there, but for those whose status begins so."""
        if not self.path.exists() and not self._journal.read():
            return set()
        rows = self.rows()
        for beginning in but:
            rows = rows.filter(~pl.col("status").str.starts_with(beginning))
        return set(rows.select(KEY).iter_rows())

    @contextmanager
    def writing(self) -> Iterator["Table"]:
        """The right to add rows, for one process at a time; the journal is merged at the end."""
        self.path.parent.mkdir(parents=True, exist_ok=True)
        with _locked(self.path.with_suffix(".lock")):
            try:
                yield self
            finally:
                self.merge()

    def add(self, row: dict[str, Any]) -> None:
        """One row, on the disk when this returns."""
        self._journal.append(json.dumps({name: row[name] for name in COLUMNS}))
        self._waiting += 1
        if self._waiting >= EVERY:
            self.merge()

    def merge(self) -> None:
        """The journal into the Parquet file, which is replaced whole before the journal goes."""
        self._waiting = 0
        if not self._journal.read():
            return
        try:
            write(self.rows(), self.path)
        except (OSError, pl.exceptions.PolarsError) as error:
            raise InputError(
                f"{self.path} cannot be written ({str(error).splitlines()[0]}); the rows are kept in "
                f"{self._journal.path}: free some space and run again"
            ) from None
        self._journal.path.unlink()


def write(rows: pl.DataFrame, path: Path) -> None:
    """The table as a Parquet file, whole or not at all."""
    with whole_file(path) as temporary:
        rows.sort(KEY).write_parquet(temporary)


def read(path: str | os.PathLike) -> pl.DataFrame:
    """The rows of a table, its journal included."""
    return Table(path).rows()


def _parquet(path: Path) -> pl.DataFrame:
    try:
        found = pl.read_parquet(path)
    except (pl.exceptions.PolarsError, OSError) as error:
        raise InputError(f"{path} is no results table ({error}); choose another file") from None
    missing = [name for name in COLUMNS if name not in found.columns]
    if missing:
        raise InputError(f"{path} has no column {missing[0]}; it is not a results table of this version")
    return found.select([pl.col(name).cast(kind) for name, kind in COLUMNS.items()])


@contextmanager
def _locked(path: Path) -> Iterator[None]:
    """Holds the file `path` alone. A lock of a killed process is free again, since the system releases it."""
    import fcntl

    with path.open("w") as file:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            raise InputError(
                f"another run writes to {path.with_suffix('.parquet')}; give this one another --out"
            ) from None
        yield
        path.unlink(missing_ok=True)
