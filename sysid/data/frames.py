"""Records from and to tables of pandas and xarray, neither of which is needed for anything else."""

import re
from collections.abc import Mapping, Sequence
from importlib import import_module
from typing import Any

import numpy as np

from sysid.base.checks import shown
from sysid.base.errors import InputError

Names = str | Sequence[str]
APART = 0.1  # of a step, by which a given sampling time may differ from the times: the same as for a file
JITTER = 0.01  # of a step, by which a stamp may be off: the same as for a file
SECONDS = ("s", "sec", "secs", "second", "seconds")
IN_NAME = re.compile(r"[\[(_ ](ms|msec|us|µs|μs|usec|ns|min|minutes|hours)[\])]?$")  # `t [ms]`, `t_us`


def library(name: str) -> Any:
    """pandas or xarray; raises InputError with the command that installs it."""
    try:
        return import_module(name)
    except ImportError:
        raise InputError(f"{name} is not installed; install it with: pip install 'qpal[notebook]'") from None


def of_pandas(table: Any, input: Names, output: Names, Ts: float | None) -> dict[str, Any]:
    """The arguments of IOData for columns of a DataFrame."""
    _check_kind(table, "pandas DataFrame", ("columns", "index", "attrs"))
    _check_named(input, output)
    for name in (*_listed(input), *_listed(output)):
        if name not in table.columns:
            raise InputError(f"the table has no column {name!r}; choose one of {', '.join(map(str, table.columns))}")
    several = getattr(table.index, "nlevels", 1)
    if several > 2:
        raise InputError(f"the index has {several} levels; give one of times, or experiment and time")
    lengths = [len(table)]
    if several == 2:
        of = np.asarray(table.index.codes[0])
        cuts = np.flatnonzero(np.diff(of)) + 1
        if len(np.unique(of)) != len(cuts) + 1:
            raise InputError("the rows of an experiment are not in one piece; sort the table by its index first")
        lengths = np.diff([0, *cuts, len(table)]).tolist()
    stamps = table.index.get_level_values(several - 1)
    if type(stamps).__name__ == "PeriodIndex":
        stamps = stamps.to_timestamp()  # the start of each period
    if getattr(stamps, "tz", None) is not None:
        stamps = stamps.tz_convert(None)
    counts = several == 1 and type(stamps).__name__ == "RangeIndex"  # rows that nobody gave a time
    timed = not counts and not (Ts is not None and np.asarray(stamps).dtype.kind not in "mMf")
    units = table.attrs.get("units", {})
    times = _seconds(np.asarray(stamps), "the index", stamps.name, units.get(stamps.name)) if timed else None
    values = {name: table[name].to_numpy() for name in (*_listed(input), *_listed(output))}
    return _arguments(values, input, output, _step(times, Ts, lengths), units, tuple(lengths))


def of_xarray(table: Any, input: Names, output: Names, Ts: float | None) -> dict[str, Any]:
    """The arguments of IOData for variables of a Dataset."""
    _check_kind(table, "xarray Dataset", ("data_vars", "coords"))
    _check_named(input, output)
    names = (*_listed(input), *_listed(output))
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
    times = None
    if axis in table.coords and (Ts is None or table[axis].dtype.kind in "mMf"):
        times = _seconds(table[axis].to_numpy(), f"the coordinate {axis!r}", axis, table[axis].attrs.get("units"))
    units = {name: str(table[name].attrs.get("units", "")) for name in names}
    values = {name: table[name].to_numpy() for name in names}
    lengths = (len(values[names[0]]),)
    return _arguments(values, input, output, _step(times, Ts, lengths), units, lengths)


def _check_kind(table: Any, wanted: str, has: Sequence[str]) -> None:
    if isinstance(table, type) or not all(hasattr(table, name) for name in has):
        raise InputError(f"the table is {shown(table)}; give a {wanted}")


def _check_named(input: Names, output: Names) -> None:
    for role, names in (("input", input), ("output", output)):
        if not _listed(names):
            raise InputError(f"{role} names no column; give the name of one, or a list of names")
    for name in _listed(input):
        if name in _listed(output):
            raise InputError(f"{name!r} is named as input and as output; give each a column of its own")


def to_pandas(data: Any) -> Any:
    """The DataFrame of a record."""
    pandas = library("pandas")
    values, units = _recorded(data)
    pieces = [np.arange(n) * data.Ts for n in data.lengths]
    index = pandas.Index(pieces[0], name="time")
    if len(pieces) > 1:
        of = np.repeat(np.arange(1, len(pieces) + 1), data.lengths)
        index = pandas.MultiIndex.from_arrays([of, np.concatenate(pieces)], names=["experiment", "time"])
    table = pandas.DataFrame(values, index=index)
    table.attrs["units"] = {"time": "s", **units}
    return table


def to_xarray(data: Any) -> Any:
    """The Dataset of a record."""
    xarray = library("xarray")
    if len(data.lengths) > 1:
        raise InputError(f"the record has {len(data.lengths)} experiments; convert each of data.experiments")
    values, units = _recorded(data)
    variables = {name: ("time", column, {"units": units[name]}) for name, column in values.items()}
    return xarray.Dataset(variables, coords={"time": ("time", data.t, {"units": "s"})})


def _recorded(data: Any) -> tuple[dict[str, np.ndarray], dict[str, str]]:
    """Every channel (N,) by a name of its own as it was recorded, and the units."""
    values: dict[str, np.ndarray] = {}
    units: dict[str, str] = {}
    y = np.where(data.observed, data.y + data.y_offset, np.nan)
    for array, name, unit in ((data.u + data.u_offset, data.u_name, data.u_unit), (y, data.y_name, data.y_unit)):
        for k, column in enumerate(array.T):
            own = name if array.shape[1] == 1 else f"{name}{k + 1}"
            own = own if own not in values else f"{own} (output)"
            values[own], units[own] = column, unit
    return values, units


def _arguments(
    values: Mapping[str, np.ndarray],
    input: Names,
    output: Names,
    Ts: float,
    units: Mapping[str, str],
    lengths: tuple[int, ...],
) -> dict[str, Any]:
    u, y = (np.column_stack([_floats(values[n], n) for n in _listed(names)]) for names in (input, output))
    lost = np.isnan(y)
    found = {"u": u, "y": y, "Ts": Ts, "missing": lost if lost.any() else None, "lengths": lengths}
    for role, names, default in (("u", _listed(input), "u"), ("y", _listed(output), "y")):
        found[f"{role}_name"] = str(names[0]) if len(names) == 1 else default
        said = {str(units.get(name, "")) for name in names}
        found[f"{role}_unit"] = said.pop() if len(said) == 1 else ""
    return found


def _floats(column: np.ndarray, name: str) -> np.ndarray:
    try:
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
        told = str(unit or "").split() or ([in_name[1]] if in_name else [])
        if told and told[0].lower() not in SECONDS:  # also of `seconds since 2000-01-01`
            raise InputError(f"{where} is in {told[0]!r}; convert it to seconds, and its name or units too")
        return stamps.astype(float)
    raise InputError(f"{where} holds no times; give Ts, the sampling time in seconds")


def _step(times: np.ndarray | None, Ts: float | None, lengths: Sequence[int]) -> float:
    """The sampling time of the stamps of all experiments, which must be uniform; or `Ts`, which they must not deny."""
    if Ts is not None:
        steps = np.empty(0) if times is None else np.diff(times)
        step = float(np.median(steps[np.isfinite(steps)])) if np.isfinite(steps).any() else 0.0
        if step > 0.0 and abs(step - Ts) > APART * max(step, Ts):
            raise InputError(
                f"Ts is {Ts:g} s and the times of the table step by {step:.6g} s; leave Ts out, or the times: "
                "table.reset_index(drop=True) in pandas, table.drop_vars in xarray"
            )
        return Ts
    if times is None:
        raise InputError("the table has no times; give Ts, the sampling time in seconds, or set the times as its index")
    ends = np.cumsum(lengths)
    pieces = np.split(times, ends[:-1])
    steps = np.concatenate([np.diff(piece) for piece in pieces])
    if not len(steps) or not np.all(np.isfinite(steps)):
        raise InputError("the index has fewer than two times; give Ts, the sampling time in seconds")
    found = float(np.mean([(p[-1] - p[0]) / (len(p) - 1) for p in pieces if len(p) > 1]))
    off = np.abs(steps - found) > JITTER * abs(found)
    if not found > 0.0 or off.any():
        k = int(np.argmax(np.abs(steps - found)))
        raise InputError(
            f"the times are not uniform: after row {k} comes a step of {steps[k]:g} s where the mean is {found:g} s; "
            "bring the table to one rate first, for example by table.resample, or read the file with sysid.read"
        )
    return float(f"{found:.12g}")  # 0.1 s, not the mean of rounded differences


def _listed(names: Names) -> list[str]:
    return [names] if isinstance(names, str) else list(names)
