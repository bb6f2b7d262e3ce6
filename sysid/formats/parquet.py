"""Parquet tables."""

from collections.abc import Mapping
from pathlib import Path
from typing import ClassVar

import numpy as np

from sysid.base.errors import InputError
from sysid.data.table import Table

HEADER = "qpal"


class Parquet:
    """Reads .parquet: every numeric column; an empty cell reads as NaN. Writes the header as the metadata `qpal`."""

    suffixes: ClassVar[tuple[str, ...]] = (".parquet",)
    written: ClassVar[tuple[str, ...]] = (".parquet",)
    headed: ClassVar[bool] = True

    def read(self, path: Path) -> Table:
        """The numeric columns of `path`; raises InputError if it is not a Parquet file or has none."""
        import polars

        try:
            frame = polars.read_parquet(path, glob=False)  # a name may hold [ or *
        except OSError:
            raise
        except Exception as error:  # polars has an exception class of its own for each way of being damaged
            raise InputError(
                f"{path} is not a readable Parquet file ({type(error).__name__}); write it again"
            ) from None
        numeric = [name for name in frame.columns if frame.schema[name].is_numeric()]
        if not numeric:
            raise InputError(f"{path} has no numeric column; found {', '.join(frame.columns) or 'nothing'}")
        columns = tuple(frame[name].cast(polars.Float64).to_numpy() for name in numeric)
        return Table(path, tuple(numeric), columns, (range(1, frame.height + 1),) * len(numeric))

    def write(self, path: Path, columns: Mapping[str, np.ndarray], header: str) -> None:
        """Columns (N,) by name, and the header."""
        import polars

        polars.DataFrame(dict(columns)).write_parquet(path, metadata={HEADER: header})

    def header(self, path: Path) -> str:
        """The metadata `qpal` of the file."""
        import polars

        return polars.read_parquet_metadata(path).get(HEADER, "")
