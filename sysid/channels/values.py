"""The numbers of a column, and what a channel of the mapping makes of them."""

import numpy as np

from sysid.base.errors import InputError
from sysid.channels.complaints import brief, closest
from sysid.channels.mapping import Channel
from sysid.channels.units import COUNTS, Conversion, convert
from sysid.data.overflow import overflowed
from sysid.data.table import LARGEST, Table, Texts, is_number

EMPTY = ("", "nan", "na", "n/a", "null", "none", "-", "--")


def numbers(table: Table, name: str, entry: str = "", fill: bool = False) -> np.ndarray:
    """Column `name` (n,) as float64; with `fill`, cells without a value are nan.

    Raises InputError for an unknown column, with the `entry` of the mapping that names it, and for the first cell
    that is no number, or has no value.
    """
    if name not in table.names:
        where = f" ({entry} of the mapping)" if entry else ""
        raise InputError(f"{table.path}: unknown column {brief(name)!r}{where}; {closest(name, table.names)}")
    cells = table.columns[table.names.index(name)]
    if isinstance(cells, np.ndarray) and cells.dtype == np.float64 and len(cells):
        low, high = cells.min(), cells.max()  # nan if one is
        if low >= -LARGEST and high <= LARGEST:
            return cells  # no copy: a long record would be held twice
    if not fill:
        return table.numbers(name)
    if isinstance(cells, np.ndarray) and cells.dtype.kind in "biuf":
        values = np.array(cells, dtype=float)
    else:
        values = soft_numbers(table, name)
        if any(str(cells[k]).strip().lower() not in EMPTY for k in map(int, np.flatnonzero(np.isnan(values)))):
            return table.numbers(name)  # which says where
    if np.any(np.abs(values[np.isfinite(values)]) > LARGEST) or np.isinf(values).any():
        return table.numbers(name)
    return values


def soft_numbers(table: Table, name: str) -> np.ndarray:
    """Column `name` (n,) as float64 with nan for every cell that is no number: for looking, not for use."""
    cells = table.columns[table.names.index(name)]
    if isinstance(cells, np.ndarray) and cells.dtype.kind in "biuf":
        return np.asarray(cells, dtype=float)
    if isinstance(cells, Texts):
        return cells.numbers(table.decimal)
    texts = [str(cell).replace(",", ".") if table.decimal == "," else str(cell) for cell in cells]
    try:
        return np.array([float(text) for text in texts])
    except ValueError:
        return np.array([float(text) if is_number(text) else np.nan for text in texts])


def channel_values(table: Table, channel: Channel, entry: str, fill: bool) -> tuple[np.ndarray, Conversion]:
    """Values (n,) of the channel in SI, nan where its cells are empty, and the conversion of its unit.

    value = sign (scale x + offset); x is the number, as a signed word, through the adc's line, times another column.
    """
    x = numbers(table, channel.column, f"{entry}.column", fill)
    _check_measured(table, channel, x)
    if channel.signed:
        x = _signed(table, channel, x)
    unit = convert(channel.unit)
    if not is_calibrated(channel) and channel.sign * unit.factor == 1.0:
        return x, unit
    with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
        values = _calibrated(table, channel, entry, x, fill) * (channel.sign * unit.factor)
    lost = np.isinf(values) | (np.isnan(values) & np.isfinite(x))
    if channel.times and lost.any():
        lost &= np.isfinite(numbers(table, channel.times, f"{entry}.times", fill))
    if lost.any():
        k = int(np.argmax(lost))
        raise table.error(
            table.names.index(channel.column),
            k,
            f"found {x[k]:g}, of which adc, times, scale and offset of the mapping make {values[k]:g}; correct them",
        )
    return values, unit


def _calibrated(table: Table, channel: Channel, entry: str, x: np.ndarray, fill: bool) -> np.ndarray:
    """scale x + offset (n,), with x through the adc's line, times another column."""
    if channel.adc is not None:
        low, high, first, second = channel.adc.line()
        if channel.adc.bits is not None:
            _check_codes(table, channel, x, high)
        x = first + (x - low) * ((second - first) / (high - low))
    if channel.times:
        x = x * numbers(table, channel.times, f"{entry}.times", fill)
    if channel.scale != 1.0:
        x = channel.scale * x
    return x + channel.offset if channel.offset else x


def is_calibrated(channel: Channel) -> bool:
    """Whether the mapping gives the channel's numbers another meaning than the file's."""
    return channel.adc is not None or bool(channel.times) or (channel.scale, channel.offset) != (1.0, 0.0)


def _check_measured(table: Table, channel: Channel, x: np.ndarray) -> None:
    """Raises InputError where the numbers (n,) have one that an instrument writes for none."""
    bad = overflowed(x)
    if bad.any():
        k, count = int(np.argmax(bad)), int(bad.sum())
        more = f" (and {count - 1} more like it)" if count > 1 else ""
        raise table.error(
            table.names.index(channel.column),
            k,
            f"found {x[k]:.6g}{more}, far outside the others, as instruments write for an overflow or for no value; "
            "empty such cells, which are missing samples then, or remove the rows",
        )


def _signed(table: Table, channel: Channel, x: np.ndarray) -> np.ndarray:
    whole = 2.0**channel.signed
    bad = np.isfinite(x) & ((x < -0.5 * whole) | (x >= whole) | (x != np.rint(x)))
    if bad.any():
        k = int(np.argmax(bad))
        raise table.error(
            table.names.index(channel.column),
            k,
            f"found {x[k]:g} in a word of {channel.signed} bits; set signed of this channel in the mapping",
        )
    return np.where(x >= 0.5 * whole, x - whole, x)


def _check_codes(table: Table, channel: Channel, x: np.ndarray, largest: float) -> None:
    bad = np.isfinite(x) & ((x < 0) | (x > largest))
    if bad.any():
        k = int(np.argmax(bad))
        raise table.error(
            table.names.index(channel.column),
            k,
            f"found {x[k]:g} where the adc of the mapping has 0 to {largest:g} {COUNTS}; correct bits, or the row",
        )
