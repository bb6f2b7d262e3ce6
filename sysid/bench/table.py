"""The results table: one row for each scenario, method and seed in a Parquet file, and a journal beside it.

A row goes to the journal when its cell ends. Now and then, and at the end, the journal is merged into the Parquet file.
A kill at any moment leaves both readable: a row that is in both counts once. Each row has a check sum: one that was
changed, or that is there twice with other values, is refused when the table is read, and run again when it goes on.
"""

import json
import os
from collections.abc import Collection, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import polars as pl

from sysid.base import tables
from sysid.base.errors import InputError
from sysid.base.files import CHECK, Lines, atomic_file, check_regular_file, check_sum, seal, unseal
from sysid.base.locks import file_lock
from sysid.base.tables import DamagedError

KEY = ("scenario", "method", "seed")
BAR = "from_truth"  # the method whose search begins at the truth
DIVERGED = -1e9  # the fit of a run that is not finite; a finite one is at least a tenth of it
UNTRIED = ("no data", "not installed")  # beginnings of a status: the method had no chance
COLUMNS: dict[str, type[pl.DataType]] = {
    "scenario": pl.String,  # family/name
    "method": pl.String,
    "seed": pl.Int64,
    "status": pl.String,  # "ok", or a sentence that says why there is no result
    "fit": pl.Float64,  # free run on unseen data [%], mean over the tests
    "oracle": pl.Float64,  # the same for the noise-free output; nan without a truth
    "rmse": pl.Float64,  # over all tests, in the unit of the scenario
    "errors": pl.String,  # JSON: RMSE of each test
    "loss": pl.Float64,  # mean squared free-run error on the estimation data
    "noise": pl.Float64,  # variance of the noise on it; nan without a truth
    "pole_error": pl.Float64,  # largest matched |s - s true| / |s true|; nan without both
    "map_error": pl.Float64,  # RMS of steady-state output less its truth over the std of the truth; nan without
    "intervals": pl.Int64,  # how many 95 % intervals were claimed
    "held": pl.Int64,  # how many of them hold the truth
    "width": pl.Float64,  # median half width of them, as a share of the true |s| pole
    "seconds": pl.Float64,  # of the fit alone
    "budget": pl.Float64,  # seconds that it was allowed
    "memory": pl.Float64,  # peak of the process during the fit [MiB]
    "stop": pl.String,
    "structure": pl.String,
    "version": pl.String,  # of the method's own library
    "qpal": pl.String,
    "machine": pl.String,
}
BELONGS = "qpal bench"  # what a row is part of, for its check sum
EVERY = 2000  # rows of the journal before they are merged


class Table:
    """Rows of one run in `path` (.parquet). One process writes; see `writing`."""

    def __init__(self, path: str | os.PathLike) -> None:
        self.path = Path(path)
        if self.path.suffix != ".parquet":
            raise InputError(f"the table is {self.path}; give it a name that ends in .parquet")
        self._journal = Lines(self.path.with_suffix(".journal"))
        self._pending = 0
        self.notes: tuple[str, ...] = ()

    def rows(self) -> pl.DataFrame:
        """All rows, the newest of each key.

        Raises InputError if there is no table, if it is another program's, and if a row is not what was written.
        """
        rows, bad = self._checked_rows()
        if bad:
            raise InputError(
                f"{bad[0]} and is damaged, or was changed since ({len(bad)} in all); the same qpal bench run --out "
                f"{self.path} runs it again"
            )
        if rows is None:
            raise InputError(f"there are no results in {self.path}; run them first: qpal bench run --out {self.path}")
        return rows

    def _checked_rows(self) -> tuple[pl.DataFrame | None, list[str]]:
        """The rows that hold, the newest of each key, and which do not: what stands where."""
        tables.check_fork()
        parts, bad = [], []
        new, lines = journal(self._journal.read())  # first: what is merged meanwhile is in the file then
        if self.path.is_file():
            rows, wrong = parquet(self.path)
            parts.append(rows)
            bad += [f"row {k + 1} of {self.path} does not hold its check sum, or another has its key" for k in wrong]
        if new:
            parts.append(pl.DataFrame(new, schema=COLUMNS))
        bad += [f"line {k + 1} of {self._journal.path} is no row that holds" for k in lines]
        if not parts:
            return None, bad
        return pl.concat(parts).unique(list(KEY), keep="last", maintain_order=True), bad

    def row_keys(self, except_status: Collection[str] = ()) -> set[tuple[str, str, int]]:
        """Keys of the rows that are there, but for those whose status begins so."""
        if not self.path.exists() and not self._journal.read():
            return set()
        rows = self.rows()
        for beginning in except_status:
            rows = rows.filter(~pl.col("status").str.starts_with(beginning))
        return set(rows.select(KEY).iter_rows())

    @contextmanager
    def writing(self) -> Iterator["Table"]:
        """The right to add rows, for one process at a time; the journal is merged at the end."""
        self.path.parent.mkdir(parents=True, exist_ok=True)
        with file_lock(self.path, self._conflict):
            journal_path = self._journal.path
            if journal_path.exists() and not os.access(journal_path, os.W_OK):  # of a killed run of another user
                raise InputError(
                    f"the journal {journal_path} may not be written to; let its owner run the same qpal bench run, or "
                    "give another --out"
                )
            self._mend()
            try:
                yield self
            finally:
                self.merge()

    def _conflict(self, process: str) -> str:
        return (
            f"another run writes to {self.path} ({process}); give this one another --out, or wait until that one ends"
        )

    def _mend(self) -> None:
        """Rows that do not hold leave the table, so that they are run again; `notes` says so."""
        rows, bad = self._checked_rows()
        if bad:
            self.notes = (f"{bad[0]}; it and {len(bad) - 1} more are run again",)
            self._replace(pl.DataFrame(schema=COLUMNS) if rows is None else rows)
        else:
            self.merge()

    def add(self, row: dict[str, Any]) -> None:
        """One row, on the disk when this returns."""
        self._journal.append(json.dumps(seal({name: row[name] for name in COLUMNS}, BELONGS)))
        self._pending += 1
        if self._pending >= EVERY:
            self.merge()

    def merge(self) -> None:
        """The journal into the Parquet file, which is replaced whole before the journal goes."""
        self._pending = 0
        if self._journal.read():
            self._replace(self.rows())

    def _replace(self, rows: pl.DataFrame) -> None:
        try:
            write(rows, self.path)
        except (OSError, pl.exceptions.PolarsError) as error:
            raise InputError(
                f"{self.path} cannot be written ({str(error).splitlines()[0]}); the rows are kept in "
                f"{self._journal.path}: free some space and run again"
            ) from None
        self._journal.path.unlink(missing_ok=True)


def write(rows: pl.DataFrame, path: Path) -> None:
    """The table as a Parquet file, whole or not at all, with a check sum in each row."""
    tables.check_fork()
    rows_in_order = rows.sort(KEY).select(list(COLUMNS))
    sums = pl.Series(CHECK, _sums(rows_in_order), dtype=pl.String)
    with atomic_file(path) as temporary:
        rows_in_order.with_columns(sums).write_parquet(temporary.absolute())


def read(path: str | os.PathLike) -> pl.DataFrame:
    """The rows of a table, its journal included."""
    return Table(path).rows()


def parquet(path: Path) -> tuple[pl.DataFrame, list[int]]:
    """The rows of a Parquet file that hold, and the numbers of those that do not; none of an older version's."""
    try:
        frame = tables.read_parquet(check_regular_file(path))
    except (DamagedError, OSError) as error:
        raise InputError(f"{path} is no results table ({error}); choose another file") from None
    missing = [name for name in COLUMNS if name not in frame.columns]
    if missing:
        raise InputError(f"{path} has no column {missing[0]}; it is not a results table of this version")
    try:
        rows = frame.select([pl.col(name).cast(kind) for name, kind in COLUMNS.items()])
    except pl.exceptions.PolarsError:
        raise InputError(f"{path} has a column of another type; it is not a results table of this version") from None
    if CHECK not in frame.columns:
        return rows, []
    sums = _sums(rows)
    keys = list(rows.select(KEY).iter_rows())
    first = dict(zip(reversed(keys), reversed(sums), strict=True))
    conflicts = {key for key, value in zip(keys, sums, strict=True) if value != first[key]}  # two different rows
    checks = frame[CHECK].to_list()
    good = [value == check and key not in conflicts for key, value, check in zip(keys, sums, checks, strict=True)]
    return rows.filter(pl.Series(good, dtype=pl.Boolean)), [k for k, row_is_good in enumerate(good) if not row_is_good]


def journal(lines: Sequence[str]) -> tuple[list[dict[str, Any]], list[int]]:
    """The rows of a journal that hold, and the numbers of the lines that do not.

    A row without a check sum, as older versions wrote it, may be any: it runs again. Of a key that is there twice with
    other values, no row counts.
    """
    sums: dict[tuple[Any, ...], str] = {}
    rows, bad, conflicts = {}, [], set()
    for k, (row, trouble) in enumerate(unseal(line, BELONGS) for line in lines):
        if trouble or any(row.get(name) is None for name in KEY):
            bad.append(k)
            continue
        key = tuple(row[name] for name in KEY)
        if sums.setdefault(key, value := check_sum(row, BELONGS)) != value:
            conflicts.add(key)
        rows[k] = key, row
    bad += [k for k, (key, _) in rows.items() if key in conflicts]
    return [row for key, row in rows.values() if key not in conflicts], sorted(bad)


def _sums(rows: pl.DataFrame) -> list[str]:
    return [check_sum(row, BELONGS) for row in rows.iter_rows(named=True)]
