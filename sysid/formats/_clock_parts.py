"""A clock in two columns: whole seconds, or dates, beside the milliseconds or nanoseconds within them.

Neither of the two is a clock: the first stands still, the second starts again. Together they are one, in a column of
its own.
"""

import re
from dataclasses import replace

import numpy as np

from sysid.data.table import Table

WORDS = {
    1.0: "s sec secs second seconds",
    1e-3: "ms msec msecs milli millis millisec millisecs millisecond milliseconds",
    1e-6: "us usec usecs micro micros microsec microsecs microsecond microseconds",
    1e-9: "ns nsec nsecs nano nanos nanosec nanosecs nanosecond nanoseconds",
}
FACTORS = {word: factor for factor, words in WORDS.items() for word in words.split()}  # [s]
WHOLE = {*WORDS[1.0].split(), "time", "timestamp", "epoch", "stamp", "t", "unix"}
STEPS = (1.0, 60.0)  # [s] of the first column: whole seconds, and dates without seconds
LAST = re.compile(r"(?P<stem>.*?)(?P<mark>[\W_]*)(?P<word>[^\W\d_]+)[\W_]*")
SURE = 0.99  # of the steps within one second that rise; the others are stamps that run back, which are told later


def with_joined_clocks(table: Table) -> Table:
    """The table with a column for each pair that is one clock, in seconds since the first; `joined` names its parts."""
    names = [name for name, cells in zip(table.names, table.columns, strict=True) if _is_numeric(cells)]
    pairs = [pair for fine in names if (pair := _pair(table, names, fine))]
    if not pairs:
        return table
    origin = min((float(_cells(table, first).min()) for first, *_ in pairs if first not in table.dates), default=0.0)
    new, joined, dates, local, clocks = {}, {}, dict(table.dates), dict(table.local), dict(table.clocks)
    for first, fine, factor in pairs:
        name = f"{first}+{_stem_and_word(fine)[1]}"
        if name in table.names or name in new:
            continue
        whole = _cells(table, first)
        new[name] = (whole if first in table.dates else whole - origin) + factor * _cells(table, fine)
        joined[name] = (first, fine)
        since = f"; {table.dates[first]}" if first in table.dates else f", in s since {origin:.10g} s"
        dates[name] = f"columns {first!r} and {fine!r} were read together as one clock{since}"
        local |= {name: table.local[first]} if first in table.local else {}
        clocks |= {name: table.clocks[first]} if first in table.clocks else {}
    return replace(
        table,
        names=(*table.names, *new),
        columns=(*table.columns, *new.values()),
        rows=(*table.rows, *(table.rows[table.names.index(first)] for first, _ in joined.values())),
        units={**table.units, **dict.fromkeys(new, "s")},
        dates=dates,
        local=local,
        clocks=clocks,
        joined=joined,
    )


def _pair(table: Table, names: list[str], fine: str) -> tuple[str, str, float] | None:
    """The column of whole seconds of which `fine` is the rest, that one, and its unit [s]; None if there is none."""
    stem, word = _stem_and_word(fine)
    factor = FACTORS.get(word.lower())
    values = _cells(table, fine)
    if factor is None or not np.isfinite(values).all() or values.min() < 0 or not np.any(np.diff(values) < 0):
        return None
    for first in names:
        first_stem, first_word = _stem_and_word(first)
        is_time = first in table.dates or first in table.timed or first_word.lower() in WHOLE
        if first == fine or not is_time or stem not in ("", first_stem, first.strip(" _.")):
            continue
        if len(_cells(table, first)) == len(values) and _is_rest(_cells(table, first), factor * values):
            return first, fine, factor
    return None


def _is_rest(whole: np.ndarray, rest: np.ndarray) -> bool:
    """Whether times (n,) [s] are whole, and `rest` (n,) [s] goes on from 0 within each of their steps."""
    if not np.isfinite(whole).all() or np.ptp(whole) == 0:
        return False
    if whole[0] > whole[-1]:  # the newest row stands first
        whole, rest = whole[::-1], rest[::-1]
    steps = [step for step in STEPS if np.all((whole - whole[0]) % step == 0) and (step == 60.0) == (rest.max() >= 1.0)]
    if not steps or rest.max() >= steps[0]:
        return False
    within = np.diff(rest)[np.diff(whole) == 0]
    return not len(within) or float(np.mean(within >= 0)) >= SURE


def _stem_and_word(name: str) -> tuple[str, str]:
    """A name without its last word and the marks before it, and this word."""
    text = re.sub(r"(?<=[a-z])(?=[A-Z])", "_", name.strip())
    match = LAST.fullmatch(text)
    return (match["stem"], match["word"]) if match else (text, "")


def _is_numeric(cells: object) -> bool:
    return isinstance(cells, np.ndarray) and cells.dtype.kind in "biuf" and len(cells) > 1


def _cells(table: Table, name: str) -> np.ndarray:
    return np.asarray(table.columns[table.names.index(name)], dtype=float)
