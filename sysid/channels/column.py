"""What a column is: its name, its unit and the words of the name, its numbers, and whether these rise like a clock."""

import re
from collections.abc import Container
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from sysid.base.errors import InputError
from sysid.channels.complaints import brief, closest
from sysid.channels.conversion import ANYWHERE, COUNTS, convert, is_time
from sysid.data.table import (
    LARGEST,
    SWITCH_WORDS,
    Table,
    Texts,
    explain_non_number,
    is_hexadecimal,
    is_like_a_number,
    is_number,
)
from sysid.formats import unit_in

# Limits chosen by hand; the logs of tests/corpus hold them.
RISING = 0.9  # of the steps of a clock; the others are repeated stamps, wraps, faults
ALIKE = 0.9  # of the steps of an unnamed clock are within a tenth of the middle one
EMPTY = ("", "nan", "na", "n/a", "null", "none", "-", "--")
FEW = 10  # cells of a column without numbers that are looked at: one of another kind may stand above them
IN = re.compile(r"(?<=\S)\s+in\s+(?=\S)")  # before a unit
# Within the brackets of a clock's name, and no unit.
RELATIVE = {"relative", "rel", "elapsed", "absolute", "abs", "raw", "local", "utc", "gmt", "start", "-", "1", ""}
_WRITTEN = (
    re.compile(r".+?\s*[\[({]\s*([^\[\](){}]*?)\s*[\])}]\s*"),
    re.compile(r"\s*(?:t|time|zeit)\s*/\s*(\S+)\s*", re.IGNORECASE),
)


def words(text: str) -> set[str]:
    """The words of a text: those that tell what a column is."""
    return set(text.split())


@dataclass(frozen=True)
class Header:
    """A column's name without its unit, the unit as it is written, and the words of the name in small letters."""

    name: str
    base: str
    unit: str
    words: frozenset[str]

    def has(self, words: set[str]) -> bool:
        """Whether one of the words is in the name."""
        return bool(self.words & words)

    @property
    def mapped_unit(self) -> str:
        """The unit for a mapping: as it is written, or counts where only the name says so."""
        return self.unit or (COUNTS if self.has({"adc", "counts", "ticks"}) else "")


def parse_header(name: str, unit: str = "") -> Header:
    """The header of a column; `unit` is what its reader found in or beside the name."""
    base = name.strip()
    if unit:
        pattern = "[/_]".join(map(re.escape, unit.split("/")))  # rad/s stands in a name as rad_s
        forms = (r"(.+?)\s*[\[({]\s*[^\[\](){}]*\s*[\])}]", rf"(.+?)\s+in\s+{pattern}", rf"(.+?)\s*[/_, ]\s*{pattern}")
        match = next((match for form in forms if (match := re.fullmatch(form, base))), None)
        base = match[1] if match else base
    parts = re.findall(r"[A-Z]+(?![a-z])|[A-Z]?[a-z]+|[^\W\d_]+", IN.sub(" ", base))  # "Weg in Schritten" is no input
    return Header(name, base, unit.strip(), frozenset(part.lower() for part in parts))


def label(name: str, role: str, unit: str = "") -> str:
    """The name of a column in reports: without `unit`, if the name says it; the role where the column has no name."""
    return role if name.isdigit() else parse_header(name, unit).base.replace("_", " ").strip() or role


def full_name(table: Table, name: str) -> str:
    """The column that a person names without its unit: temp for `temp [degC]`, where that is the only one."""
    if name in table.names:
        return name
    like = [full for full in table.names if parse_header(full, table.units.get(full, "")).base == name.strip()]
    return like[0] if len(like) == 1 else name


def unit_in_brackets(name: str) -> str:
    """What stands where the name of a clock has its unit: the unit if it is one of time in other letters (MS, Min)."""
    for form in _WRITTEN:
        match = form.fullmatch(name)
        if match and match[1].lower() not in RELATIVE and not match[1].isdigit():
            spellings = (text for text in (match[1], match[1].lower(), match[1].rstrip(".")) if is_time(text))
            return next(spellings, match[1])
    return ""


@dataclass(frozen=True)
class Column:
    """A column of a table: `values` (n,) with nan for cells that are no numbers; `finite` are the others.

    `dated` columns held dates or times of day, which were read as seconds; `timed` ones are
    times by their type in the file, in seconds whatever their name says. `blank` cells have no value, as those of a
    column do that has a rate of its own: they are counted where few cells are numbers.
    """

    header: Header
    values: np.ndarray
    dated: bool = False
    timed: bool = False
    blank: int = 0

    @property
    def name(self) -> str:
        """Name of the column."""
        return self.header.name

    @cached_property
    def finite(self) -> np.ndarray:
        """The numbers."""
        mask = np.isfinite(self.values)
        return self.values if mask.all() else self.values[mask]

    @cached_property
    def numeric(self) -> bool:
        """Whether most cells are numbers, or all that have a value are."""
        if len(self.values) > 0 and 2 * len(self.finite) >= len(self.values):
            return True
        return not self.constant and len(self.finite) + self.blank == len(self.values)

    @cached_property
    def constant(self) -> bool:
        """Whether all numbers are one."""
        x = self.finite
        return len(x) == 0 or bool(np.ptp(x) == 0)

    @cached_property
    def integer(self) -> bool:
        """Whether all numbers are whole."""
        x = self.finite
        return len(x) > 0 and bool(np.all(x == np.rint(x)))

    @cached_property
    def step(self) -> float:
        """The middle step between numbers that rise."""
        steps = np.diff(self.finite)
        rising = steps[steps > 0]
        return float(np.median(rising)) if len(rising) else 0.0

    @cached_property
    def rising(self) -> bool:
        """Whether nearly all steps are upwards; stamps may repeat."""
        steps = np.diff(self.finite)
        return len(steps) > 0 and float(np.mean(steps >= 0)) >= RISING and bool(np.any(steps > 0))

    @cached_property
    def ticking(self) -> bool:
        """Whether it rises in nearly equal steps, as a clock does and hardly any signal."""
        steps = np.diff(self.finite)
        if not self.rising or len(steps) < 3:
            return False
        return float(np.mean(np.abs(steps - self.step) <= 0.1 * self.step)) >= ALIKE

    @cached_property
    def held(self) -> bool:
        """Whether the column keeps its value from most rows to the next."""
        steps = np.diff(self.finite)
        return len(steps) > 0 and bool(np.median(np.abs(steps)) == 0)

    @cached_property
    def nearly_constant(self) -> bool:
        """Whether it keeps its sign and stays within a third of its mean, as a supply does."""
        x = self.finite
        mean = abs(float(x.mean())) if len(x) else 0.0
        return len(x) > 0 and float(np.ptp(x)) < 0.67 * mean and bool(x.min() * x.max() > 0)

    @property
    def unit_conflict(self) -> str:
        """A sentence if its name has two units of one quantity, or another than the row below; else nothing.

        mV beside V and ms beside s are a factor of 1000; V beside deg is a pot whose volts became an angle.
        """
        if self.dated or self.timed:  # the type of the values settles it
            return ""
        header = self.header
        times = sorted(ANYWHERE[word] for word in header.words if word in ANYWHERE)
        texts = [unit_in(self.name), unit_in(header.base), header.unit, *(times if header.unit else ())]
        units = [(text, unit) for text in dict.fromkeys(filter(None, texts)) if (unit := convert(text)).known]
        for text, unit in units[1:]:
            first, reference = units[0]
            if unit.unit == reference.unit and abs(unit.factor - reference.factor) > 1e-9 * reference.factor:
                return f"column {self.name!r} has two units, {first} and {text}"
        return ""


def column_of(table: Table, name: str) -> Column:
    """One column of a table, whatever it holds."""
    header = parse_header(name, table.units.get(name, ""))
    values = soft_numbers(table, name)
    column = Column(header, values, name in table.dates, name in table.timed)
    return column if column.numeric else replace(column, blank=_count_blank(table, name, values))


def _count_blank(table: Table, name: str, values: np.ndarray) -> int:
    """How many cells have no value, among those that are no numbers (n,) in `values`."""
    cells = table.columns[table.names.index(name)]
    if isinstance(cells, np.ndarray):
        return int(np.isnan(values).sum())
    return sum(cell.strip().lower() in EMPTY for cell in cells)


def numeric_columns(table: Table) -> dict[str, Column]:
    """Every column that holds numbers, by name."""
    columns = {name: column_of(table, name) for name in table.names}
    return {name: column for name, column in columns.items() if column.numeric}


def numbers(table: Table, name: str, entry: str = "", fill: bool = False) -> np.ndarray:
    """Column `name` (n,) as float64; with `fill`, cells without a value are nan.

    Raises InputError for an unknown column, with the `entry` of the mapping that names it, and for the first cell
    that is no number, or has no value.
    """
    if name not in table.names:
        place = f" ({entry} of the mapping)" if entry else ""
        raise InputError(f"{table.path}: unknown column {brief(name)!r}{place}; {closest(name, table.names)}")
    cells = table.columns[table.names.index(name)]
    if isinstance(cells, np.ndarray) and cells.dtype == np.float64 and len(cells):
        low, high = cells.min(), cells.max()  # nan if one is
        if low >= -LARGEST and high <= LARGEST:
            return cells  # no copy: a long record would be held twice
    if (switched := switch_words(table, name)) is not None and (fill or np.isfinite(switched).all()):
        return switched
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


def switch_words(table: Table, name: str) -> np.ndarray | None:
    """A column of true and false, or of on and off, as 1 and 0 (n,), nan for cells without a value; None for others.

    Only where the column is asked for: a flag that nobody names is neither input nor output.
    """
    cells = table.columns[table.names.index(name)]
    if isinstance(cells, np.ndarray) and cells.dtype.kind in "biuf":
        return None
    found: dict[str, float] = {}
    for cell in cells:
        if cell not in found:
            word = str(cell).strip().lower()
            if word not in SWITCH_WORDS and word not in EMPTY:
                return None
            found[cell] = SWITCH_WORDS.get(word, np.nan)
    return np.array([found[cell] for cell in cells]) if np.isfinite(list(found.values())).any() else None


def misspelt_number(table: Table, numeric: Container[str], single: str = "") -> str:
    """The first cell that was meant as a number and is not read as one, among columns that are not `numeric`.

    A sentence with its row, what stands there and what to do; nothing if there is none. `single` is the one column to
    look at.
    """
    for j, (name, cells) in enumerate(zip(table.names, table.columns, strict=True)):
        if name in numeric or (single and name != single) or not len(cells) or not isinstance(cells[0], str):
            continue
        for k in map(int, np.flatnonzero(np.isnan(soft_numbers(table, name)))[:FEW]):
            if is_like_a_number(cells[k]) or (single and is_hexadecimal(cells[k])):
                sentence = explain_non_number(cells[k], name, table.decimal, cells)
                return f"{table.place} {table.rows[j][k]}, column {name!r}: {sentence}"
    return ""
