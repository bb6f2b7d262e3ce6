"""Records from and to tables of pandas and xarray, neither of which is needed for anything else."""

import re
from collections.abc import Mapping, Sequence
from importlib import import_module
from typing import Any

import numpy as np

from sysid.base.checks import short_text
from sysid.base.errors import InputError

Names = str | Sequence[str]
APART = 0.1  # of a step, by which a given sampling time may differ from the times: the same as for a file
JITTER = 0.01  # of a step, by which a stamp may be off: the same as for a file
SECONDS = ("s", "sec", "secs", "second", "seconds")
IN_NAME = re.compile(  # `t [ms]`, `t_us`, `time/ms`, `millis`
    r"(?:^|[\[(_ /.])(ms|msecs?|millis|milliseconds|[uµμ]s|usecs?|micros|microseconds|ns|nsecs?|nanos|nanoseconds|mins?"
    r"|minutes?|h|hrs?|hours?|days?|ticks?|counts?)[\])]?$",
    re.IGNORECASE,
)
LATEST = 1e11  # [s] since 1970, in the year 5138: a later stamp counts in a smaller unit
GAP = 0.5  # of a step, by which a stamp may be early or late where Ts is given
ROWS = "table.reset_index(drop=True) in pandas, table.drop_vars in xarray"


def library(name: str) -> Any:
    """pandas or xarray; raises InputError with the command that installs it."""
    try:
        return import_module(name)
    except ImportError:
        raise InputError(f"{name} is not installed; install it with: pip install 'qpal[notebook]'") from None


def of_pandas(table: Any, input: Names, output: Names, Ts: float | None) -> dict[str, Any]:
    """The arguments of IOData for columns of a DataFrame."""
    _check_kind(table, "pandas DataFrame", ("columns", "index", "attrs"))
    input, output = _as_list(input), _as_list(output)
    _check_named(input, output)
    for name in (*input, *output):
        if name not in table.columns:
            raise InputError(f"the table has no column {name!r}; choose one of {', '.join(map(str, table.columns))}")
        if table[name].ndim != 1:
            raise InputError(f"{table[name].shape[1]} columns are named {name!r}; give each a name of its own")
    if not len(table):
        raise InputError("the table has no rows; give one with at least 2")
    index_levels = getattr(table.index, "nlevels", 1)
    if index_levels > 2:
        raise InputError(f"the index has {index_levels} levels; give one of times, or experiment and time")
    lengths = [len(table)]
    if index_levels == 2:
        codes = np.asarray(table.index.codes[0])
        cuts = np.flatnonzero(np.diff(codes)) + 1
        if len(np.unique(codes)) != len(cuts) + 1:
            raise InputError("the rows of an experiment are not in one piece; sort the table by its index first")
        lengths = np.diff([0, *cuts, len(table)]).tolist()
    stamps = table.index.get_level_values(index_levels - 1)
    if type(stamps).__name__ == "PeriodIndex":
        stamps = stamps.to_timestamp()  # the start of each period
    if getattr(stamps, "tz", None) is not None:
        stamps = stamps.tz_convert(None)
    counts = index_levels == 1 and type(stamps).__name__ == "RangeIndex"  # rows that nobody gave a time
    units = table.attrs.get("units") or {}
    if not isinstance(units, Mapping):
        raise InputError(f'attrs["units"] is {short_text(units)}; give a dict: the unit of each column by its name')
    row_times = (
        None if counts else (np.asarray(stamps.infer_objects()), "the index", stamps.name, units.get(stamps.name))
    )
    values = {name: table[name].to_numpy() for name in (*input, *output)}
    return _arguments(values, input, output, _sampling_time(row_times, Ts, lengths), units, tuple(lengths))


def of_xarray(table: Any, input: Names, output: Names, Ts: float | None) -> dict[str, Any]:
    """The arguments of IOData for variables of a Dataset."""
    _check_kind(table, "xarray Dataset", ("data_vars", "coords"))
    input, output = _as_list(input), _as_list(output)
    _check_named(input, output)
    names = (*input, *output)
    for name in names:
        if name not in table.data_vars:
            raise InputError(
                f"the dataset has no variable {name!r}; choose one of {', '.join(map(str, table.data_vars))}"
            )
        if len(table[name].dims) != 1 or table[name].dims != table[names[0]].dims:
            raise InputError(
                f"{name!r} has the dimensions {table[name].dims}; give variables of the same one dimension"
            )
    (axis,) = table[names[0]].dims
    row_times = None
    if axis in table.coords:
        row_times = table[axis].to_numpy(), f"the coordinate {axis!r}", axis, table[axis].attrs.get("units")
    units = {name: table[name].attrs.get("units") for name in names}
    values = {name: table[name].to_numpy() for name in names}
    lengths = (len(values[names[0]]),)
    if not lengths[0]:
        raise InputError(f"the dimension {axis!r} has no values; give a dataset with at least 2")
    return _arguments(values, input, output, _sampling_time(row_times, Ts, lengths), units, lengths)


def _check_kind(table: Any, kind_name: str, has: Sequence[str]) -> None:
    if isinstance(table, type) or not all(hasattr(table, name) for name in has):
        raise InputError(f"the table is {short_text(table)}; give a {kind_name}")


def _check_named(input: Sequence[str], output: Sequence[str]) -> None:
    for role, names in (("input", input), ("output", output)):
        if not names:
            raise InputError(f"{role} names no column; give the name of one, or a list of names")
    for name in input:
        if name in output:
            raise InputError(f"{name!r} is named as input and as output; give each a column of its own")


def to_pandas(data: Any) -> Any:
    """The DataFrame of a record."""
    pandas = library("pandas")
    values, units = _recorded_channels(data)
    pieces = [np.arange(n) * data.Ts for n in data.lengths]
    index = pandas.Index(pieces[0], name="time")
    if len(pieces) > 1:
        experiment_numbers = np.repeat(np.arange(1, len(pieces) + 1), data.lengths)
        index = pandas.MultiIndex.from_arrays(
            [experiment_numbers, np.concatenate(pieces)], names=["experiment", "time"]
        )
    table = pandas.DataFrame(values, index=index)
    table.attrs["units"] = {"time": "s", **units}
    return table


def to_xarray(data: Any) -> Any:
    """The Dataset of a record."""
    xarray = library("xarray")
    if len(data.lengths) > 1:
        raise InputError(f"the record has {len(data.lengths)} experiments; convert each of data.experiments")
    values, units = _recorded_channels(data)
    variables = {name: ("time", column, {"units": units[name]}) for name, column in values.items()}
    return xarray.Dataset(variables, coords={"time": ("time", data.t, {"units": "s"})})


def _recorded_channels(data: Any) -> tuple[dict[str, np.ndarray], dict[str, str]]:
    """Every channel (N,) by a name of its own as it was recorded, and the units."""
    values: dict[str, np.ndarray] = {}
    units: dict[str, str] = {}
    y = np.where(data.observed, data.y + data.y_offset, np.nan)
    for array, name, unit in ((data.u + data.u_offset, data.u_name, data.u_unit), (y, data.y_name, data.y_unit)):
        for k, column in enumerate(array.T):
            channel_name = name if array.shape[1] == 1 else f"{name}{k + 1}"
            channel_name = channel_name if channel_name not in values else f"{channel_name} (output)"
            values[channel_name], units[channel_name] = column, unit
    return values, units


def _arguments(
    values: Mapping[str, np.ndarray],
    input: Sequence[str],
    output: Sequence[str],
    Ts: float,
    units: Mapping[str, Any],
    lengths: tuple[int, ...],
) -> dict[str, Any]:
    u, y = (np.column_stack([_floats(values[n], n) for n in names]) for names in (input, output))
    is_missing = np.isnan(y)
    arguments = {"u": u, "y": y, "Ts": Ts, "missing": is_missing if is_missing.any() else None, "lengths": lengths}
    for role, names, default in (("u", input, "u"), ("y", output, "y")):
        arguments[f"{role}_name"] = str(names[0]) if len(names) == 1 else default
        unit_names = {str(units.get(name) or "") for name in names}
        arguments[f"{role}_unit"] = unit_names.pop() if len(unit_names) == 1 else ""
    return arguments


def _floats(column: np.ndarray, name: str) -> np.ndarray:
    try:
        if column.dtype.kind in "cmM":  # which NumPy makes real numbers of
            raise TypeError
        return np.asarray(column, dtype=float)
    except (TypeError, ValueError):
        raise InputError(f"column {name!r} holds values that are not numbers; give a column of floats") from None


def _seconds(stamps: np.ndarray, where: str, name: object, unit: object) -> np.ndarray:
    """Stamps (N,) in seconds: dates, differences, or numbers whose `name` and `unit` tell no other unit."""
    if stamps.dtype.kind == "M":
        return (stamps - stamps[0]) / np.timedelta64(1, "ns") * 1e-9
    if stamps.dtype.kind == "m":
        return stamps / np.timedelta64(1, "ns") * 1e-9
    if stamps.dtype.kind in "iuf":
        in_name = IN_NAME.search(str(name))
        unit_words = str(unit or "").split() or ([in_name[1]] if in_name else [])
        if unit_words and unit_words[0].lower() not in SECONDS:  # also of `seconds since 2000-01-01`
            raise InputError(f"{where} is in {unit_words[0]!r}; convert it to seconds, and its name or units too")
        if len(stamps) and np.abs(stamps[0]) > LATEST:
            raise InputError(f"{where} begins at {stamps[0]:g}, which are no seconds since 1970; convert it to seconds")
        return stamps.astype(float)
    raise InputError(f"{where} holds no times; convert it by pandas.to_datetime, or leave it out ({ROWS}) and give Ts")


def _sampling_time(
    row_times: tuple[np.ndarray, str, object, object] | None, Ts: float | None, lengths: Sequence[int]
) -> float:
    """The sampling time of `row_times` (stamps, where they stand, their name and unit), or Ts."""
    if row_times is None:
        return _step(None, Ts, lengths)
    stamps, where = row_times[:2]
    if Ts is None or stamps.dtype.kind not in "iub":
        return _step(_seconds(*row_times), Ts, lengths)
    ends = np.cumsum(lengths)[:-1]
    steps = np.concatenate([np.diff(piece.astype(float)) for piece in np.split(stamps, ends)])  # numbers of rows
    if len(steps) and not (steps[0] > 0 and np.all(steps == steps[0])):
        k = int(np.argmax((steps != steps[0]) | (steps <= 0)))
        raise InputError(
            f"{where} numbers the rows, and goes on by {steps[k]:g} after row {k}; keep all rows, with nan for a lost "
            f"output, or leave the numbers out: {ROWS}"
        )
    return Ts


def _step(times: np.ndarray | None, Ts: float | None, lengths: Sequence[int]) -> float:
    """The sampling time of the stamps of all experiments, which must be uniform; or `Ts`, which they must not deny."""
    if Ts is not None:
        for piece in [] if times is None else np.split(times, np.cumsum(lengths)[:-1]):
            _check_given(piece, Ts)
        return Ts
    if times is None:
        raise InputError("the table has no times; give Ts, the sampling time in seconds, or set the times as its index")
    ends = np.cumsum(lengths)
    pieces = np.split(times, ends[:-1])
    steps = np.concatenate([np.diff(piece) for piece in pieces])
    if not len(steps) or not np.all(np.isfinite(steps)):
        raise InputError("the index has fewer than two times; give Ts, the sampling time in seconds")
    mean_step = float(np.mean([(p[-1] - p[0]) / (len(p) - 1) for p in pieces if len(p) > 1]))
    off = np.abs(steps - mean_step) > JITTER * abs(mean_step)
    if not mean_step > 0.0 or off.any():
        k = int(np.argmax(np.abs(steps - mean_step)))
        raise InputError(
            f"the times are not uniform: after row {k} comes a step of {steps[k]:g} s where the mean is "
            f"{mean_step:g} s; "
            "bring the table to one rate first, for example by table.resample, or read the file with sysid.read"
        )
    return float(f"{mean_step:.12g}")  # 0.1 s, not the mean of rounded differences


def _check_given(times: np.ndarray, Ts: float) -> None:
    """Raises InputError if the times (n,) of an experiment step by another time than Ts, or leave samples out."""
    (known_rows,) = np.nonzero(np.isfinite(times))
    steps, rows = np.diff(times[known_rows]), np.diff(known_rows)
    if not len(steps):
        return
    step = float(np.median(steps / rows))
    if abs(step - Ts) > APART * max(abs(step), Ts):
        raise InputError(
            f"Ts is {Ts:g} s and the times of the table step by {step:.6g} s; leave Ts out, or the times: {ROWS}"
        )
    deviation = np.abs(steps - rows * Ts)
    if deviation.max() > GAP * Ts:
        k = int(np.argmax(deviation))
        raise InputError(
            f"Ts is {Ts:g} s, and after row {known_rows[k]} of an experiment comes a step of {steps[k]:g} s; give "
            "uniform "
            f"rows, with nan for a lost output, or leave the times out: {ROWS}"
        )


def _as_list(names: Names) -> list[str]:
    return [names] if isinstance(names, str) else list(names)
