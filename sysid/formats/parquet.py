"""Parquet tables."""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from sysid.base import tables
from sysid.base.errors import InputError
from sysid.data.table import Table
from sysid.formats._arrays import Arrays
from sysid.formats._long_table import may_be_long, pivoted

if TYPE_CHECKING:
    import polars

HEADER = "qpal"


class Parquet:
    """Reads .parquet: every numeric or boolean column; an empty cell reads as NaN.

    Times are read as seconds, dates as seconds since the first one in the file. A field f of a column c of structs is
    called c.f; element k (from 0) of a column a of arrays of one length is called a[k]. Writes the header as the
    metadata `qpal`.
    """

    suffixes: ClassVar[tuple[str, ...]] = (".parquet",)
    written: ClassVar[tuple[str, ...]] = (".parquet",)
    headed: ClassVar[bool] = True

    @staticmethod
    def libraries(path: Path) -> tuple[str, ...]:
        """None that can be loaded once for many files: polars has threads, which a fork would lose."""
        return ()

    def read(self, path: Path) -> Table:
        """The numeric columns of `path`; raises InputError if it is not a Parquet file or has none."""
        try:
            frame = tables.read_parquet(path)
        except tables.DamagedError as error:
            error_name = str(error).partition(":")[0]
            raise InputError(f"{path} is not a readable Parquet file ({error_name}); write it again") from None
        if not frame.height:
            raise InputError(f"{path} has no rows; give a file with one row a sample")
        arrays, texts = Arrays(path), _texts(frame)
        for column in frame.iter_columns():
            if column.name not in texts:
                _add_column(arrays, column.name, column)
        table = arrays.table("row", f"has no numeric column; found {', '.join(frame.columns) or 'nothing'}")
        return _with_texts(table, texts)

    def write(self, path: Path, columns: Mapping[str, np.ndarray], header: str) -> None:
        """Columns (N,) by name, and the header."""
        import polars

        tables.check_fork()
        polars.DataFrame(dict(columns)).write_parquet(path.absolute(), metadata={HEADER: header})

    def header(self, path: Path) -> str:
        """The metadata `qpal` of the file."""
        import polars

        tables.check_fork()
        return polars.read_parquet_metadata(path.absolute()).get(HEADER, "")


def _texts(frame: "polars.DataFrame") -> dict[str, list[str]]:
    """The columns of text of a table that may be a long one, in which they name the signals; none of another."""
    import polars

    kinds = (polars.String, polars.Categorical, polars.Enum)
    columns = [column for column in frame.iter_columns() if isinstance(column.dtype, kinds)]
    if not may_be_long(frame.columns) or len(columns) == frame.width:
        return {}
    return {column.name: column.cast(polars.String).fill_null("").to_list() for column in columns}


def _with_texts(table: Table, texts: Mapping[str, list[str]]) -> Table:
    """The numbers of the table, with a column for each name in a long one."""
    if not texts:
        return table
    rows = table.rows[0]
    long = replace(
        table,
        names=(*table.names, *texts),
        columns=(*table.columns, *texts.values()),
        rows=(*table.rows, *(rows for _ in texts)),
    )
    pivot = pivoted(long)
    if pivot is not long:
        return pivot
    return replace(table, notes=(*table.notes, f"left out what is no signal: {', '.join(texts)} (text)"))


def _add_column(arrays: Arrays, name: str, column: "polars.Series") -> None:
    """Add a column to the arrays by its type, the fields of a struct and the elements of an array as columns each."""
    import polars

    kind = column.dtype
    if kind.is_numeric() or kind == polars.Boolean:
        exact = kind.is_integer() and not column.null_count()
        arrays.column(name, column.to_numpy() if exact else column.cast(polars.Float64).to_numpy())
    elif kind in (polars.Date, polars.Datetime):
        local = getattr(kind, "time_zone", None) is None
        arrays.column(name, column.cast(polars.Datetime("ns")).to_numpy(), local)
    elif kind in (polars.Duration, polars.Time):
        arrays.column(name, column.cast(polars.Duration("ns")).to_numpy(), kind == polars.Time)
    elif isinstance(kind, polars.Struct):
        for field in kind.fields:
            _add_column(arrays, f"{name}.{field.name}", column.struct.field(field.name))
    elif isinstance(kind, polars.Array | polars.List):
        _add_elements(arrays, name, column)
    else:
        arrays.leave_out(name, str(kind))


def _add_elements(arrays: Arrays, name: str, column: "polars.Series") -> None:
    import polars

    rows = column if isinstance(column.dtype, polars.List) else column.arr.to_list()
    lengths = rows.list.len().unique().to_list()
    if len(lengths) != 1 or not lengths[0]:
        arrays.leave_out(name, "lists of several lengths")
        return
    for k in range(lengths[0]):
        _add_column(arrays, f"{name}[{k}]", rows.list.get(k))
