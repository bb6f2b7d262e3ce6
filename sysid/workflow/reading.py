"""sysid.read: a record from a file, as `qpal identify` reads it, for Python."""

import os
import re

from sysid.base.checks import checked
from sysid.base.errors import InputError
from sysid.channels.mapping import Range
from sysid.channels.reading import Mapping
from sysid.data.record import IOData
from sysid.workflow.record import read_record

_OPTIONS = {"ts": "Ts", "time-unit": "time_unit"}  # of the command line, whose arguments have other names here


@checked
def read(
    path: str | os.PathLike[str],
    input: str | None = None,
    output: str | None = None,
    Ts: float | None = None,
    time: str | None = None,
    map: Mapping | None = None,
    start: float | None = None,
    stop: float | None = None,
    time_unit: str | None = None,
    missing: str = "mark",
) -> IOData:
    """The record in a file: CSV, Parquet, MAT, NumPy, JSON, a serial capture, and with their extra MCAP and ROS bags.

    `input` and `output` name columns; what is not named is found by name, unit and numbers where that is beyond doubt.
    Ts [s] comes from `Ts` or from the column `time`, in `time_unit`. `map`, a `ChannelMap` or the path of one, says
    instead how the file is read, with several channels, scales and repairs. `start` and `stop` [s] after the first
    stamp cut the record. `missing` says what becomes of outputs without a value, such as empty cells: "mark" (missing
    samples), "fill" or "refuse". Names stay, units become SI (degrees become rad). What was assumed and repaired:
    `sysid.workflow.record.read_record(path).notes`. Raises InputError that names the file and the place.
    """
    cut = Range(start=start, stop=stop)
    try:
        return read_record(path, input, output, Ts, time, map, cut, time_unit, missing).data
    except InputError as error:
        raise InputError(in_python(str(error))) from None


def in_python(sentence: str) -> str:
    """The sentence with arguments of `read` in place of options of the command line."""
    sentence = re.sub(r"--range(?= \d| or|$)", "start= and stop=", sentence)
    sentence = sentence.replace("--ts SECONDS", "Ts=SECONDS")
    return re.sub(r"--(input|output|ts|time-unit|time|map)\b( is)?", _argument, sentence)


def _argument(found: re.Match) -> str:
    """Ts= for --ts, and Ts where the sentence says what it is."""
    name = _OPTIONS.get(found[1], found[1])
    return f"{name} is" if found[2] else f"{name}="
