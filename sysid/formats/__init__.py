"""Formats of recorded files: one file, one class and one line in `FORMATS` each; the file suffix selects the format.

A class reads its suffixes and writes those in `written`. Help texts, error messages and tests use these tables.
"""

import json
import os
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, TypeGuard

import numpy as np

from sysid.base.checks import checked
from sysid.base.errors import InputError
from sysid.base.files import atomic_file, check_regular_file
from sysid.data.hexadecimal import with_prefixed_words
from sysid.data.table import Table
from sysid.formats import _sandbox
from sysid.formats._clock_parts import with_joined_clocks
from sysid.formats._dates import read_dates, with_days
from sysid.formats._format import Format
from sysid.formats._long_table import pivoted
from sysid.formats._stack import EXPERIMENT_WORDS, RUN_WORDS, sampling_times, stacked
from sysid.formats._unit_names import unit_in
from sysid.formats.delimited import Delimited
from sysid.formats.json_records import JsonRecords
from sysid.formats.labview import LabView
from sysid.formats.mat import Mat
from sysid.formats.mdf import Mdf
from sysid.formats.numpy_arrays import NumpyArrays
from sysid.formats.parquet import Parquet
from sysid.formats.robot_log import RobotLog
from sysid.formats.serial_capture import SerialCapture
from sysid.formats.tdms import Tdms
from sysid.formats.ulog import Ulog
from sysid.formats.wpilog import Wpilog

FORMATS: tuple[type[Format], ...] = (
    *(Delimited, JsonRecords, LabView, Mat, Mdf, NumpyArrays, Parquet, RobotLog, SerialCapture),
    *(Tdms, Ulog, Wpilog),
)
TABLE: dict[str, type[Format]] = dict(sorted((suffix, each) for each in FORMATS for suffix in each.suffixes))
# Read by libraries of others:
FOREIGN: tuple[type[_sandbox.Foreign], ...] = (Mat, Mdf, NumpyArrays, Parquet, RobotLog, Tdms, Ulog)
WRITTEN: tuple[str, ...] = tuple(suffix for suffix, each in TABLE.items() if suffix in each.written)


@checked
def read_table(path: str | os.PathLike[str]) -> Table:
    """The columns of the file at `path`, or the folder of a bag, read in the format for its suffix in `TABLE`.

    `meta` of the table holds what the writer said of the record, as far as it is a JSON object. Dates and times of
    day become seconds since their first cell; `dates` and `undated` say how, or why not. A table of time, name and
    value has a column for each name, and two columns that are one clock are joined.
    Raises InputError with the file name if it is missing, empty, damaged or of an unknown format.
    """
    path = check_regular_file(path)
    suffixes = ", ".join(TABLE)
    bag = path.is_dir() and (path / "metadata.yaml").is_file()  # a folder of rosbag2
    if path.is_dir() and not bag:
        raise InputError(f"{path} is a folder; give one file ({suffixes})")
    if not path.exists():
        raise InputError(f"{path} does not exist; check the name and the current folder")
    if not bag and path.suffix.lower() not in TABLE:
        raise InputError(f"{path}: unknown file suffix {path.suffix!r}; give a file of {suffixes}")
    try:
        if path.is_file() and path.stat().st_size == 0:
            raise InputError(f"{path} is empty; give a file with at least one column of input and one of output")
        table, header = _read(path, RobotLog if bag else TABLE[path.suffix.lower()])
        table = replace(table, meta={**_meta(header), **table.meta})
        table = with_prefixed_words(table)
        table = stacked(with_days(table, read_dates(table)))
        return with_joined_clocks(pivoted(table))
    except OSError as error:
        raise InputError(
            f"{path} cannot be read ({error.strerror or error}); check that it is a readable file"
        ) from None


@checked
def read_header(path: str | os.PathLike[str]) -> str:
    """The header of a file read by `read_table`; empty if it has none."""
    path = check_regular_file(path)
    kind = TABLE[path.suffix.lower()]
    return _sandbox.header(path, kind) if _foreign(kind) else kind().header(path)


def _read(path: Path, kind: type[Format]) -> tuple[Table, str]:
    return _sandbox.read(path, kind) if _foreign(kind) else (kind().read(path), kind().header(path))


def _foreign(kind: type[Format]) -> TypeGuard[type[_sandbox.Foreign]]:
    return kind in FOREIGN


def _meta(header: str) -> dict[str, Any]:
    """What a header says as a JSON object; nothing if it is none, as in a file of another program."""
    try:
        value = json.loads(header)
    except (ValueError, RecursionError):
        return {}
    return value if isinstance(value, dict) else {}


@checked
def check_written(path: str | os.PathLike[str]) -> Path:
    """`path`, if a format writes files of its suffix, else InputError."""
    path = Path(path)
    if path.suffix.lower() not in WRITTEN:
        raise InputError(
            f"{path}: cannot write a table {f'to {path.suffix}' if path.suffix else 'without a suffix'}; end its "
            f"name in {', '.join(WRITTEN)}"
        )
    return path


@checked(deferred=("columns",))  # nan is a missing sample
def write_table(path: str | os.PathLike[str], columns: Mapping[str, np.ndarray], header: str = "") -> Path:
    """Write columns (N,) by name to `path`, under a temporary name first, so that no incomplete file appears.

    A sample that is nan is missing; in a text table its cell is empty.

    Raises InputError for a suffix that no format writes and for a place that cannot be written to.
    """
    path = check_written(path)
    if not path.parent.is_dir():
        raise InputError(f"{path}: there is no folder {path.parent}; make it first or choose another place")
    try:
        with atomic_file(path) as temporary:
            TABLE[path.suffix.lower()]().write(temporary, columns, header)
    except OSError as error:
        raise InputError(f"{path}: cannot be written ({error.strerror or error}); choose another place") from None
    return path


__all__ = [
    "EXPERIMENT_WORDS",
    "FOREIGN",
    "FORMATS",
    "RUN_WORDS",
    "TABLE",
    "WRITTEN",
    "Delimited",
    "Format",
    "JsonRecords",
    "LabView",
    "Mat",
    "Mdf",
    "NumpyArrays",
    "Parquet",
    "RobotLog",
    "SerialCapture",
    "Tdms",
    "Ulog",
    "Wpilog",
    "check_written",
    "read_header",
    "read_table",
    "sampling_times",
    "unit_in",
    "write_table",
]
