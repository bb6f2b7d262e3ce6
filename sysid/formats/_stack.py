"""Columns that stand once for each experiment, as test(1).u and test(2).u do, as one, and a column of their numbers."""

import re
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from typing import Any

import numpy as np

from sysid.data.table import Table

EXPERIMENT = "experiment"  # the column that numbers them
TIME = "time_s"  # of experiments whose sampling times differ
# Words for experiments in the names of columns, structs and lists; the second may also be switches or counters.
EXPERIMENT_WORDS = {"episode", "ep", "trial", "attempt", "exp", "experiment", "rep", "repetition", "session", "segment"}
EXPERIMENT_WORDS |= {"versuch", "messung"}
RUN_WORDS = {"run", "test", "cycle", "iteration", "batch"}
NAMES = re.compile(rf"({'|'.join(sorted(EXPERIMENT_WORDS | RUN_WORDS))})s?", re.IGNORECASE)
FEWEST = 2  # columns of an experiment
# What a writer calls the sampling time or its inverse, the sampling rate [Hz], and the time [s] of such a number.
RATES = {"Ts": lambda value: value, "dt": lambda value: value, "fs": lambda value: 1.0 / value}


def stacked(table: Table) -> Table:
    """The table with one column a field where all columns are GROUP.field, of groups that differ by a number alone.

    Groups may also be joints that were recorded together: they are experiments where their names say so, or where they
    differ in length, which what is recorded together by one clock does not. Other tables as they are.
    """
    groups: dict[str, dict[str, int]] = {}
    for j, name in enumerate(table.names):
        group, _, field = name.rpartition(".")
        groups.setdefault(group, {})[field] = j
    stems = {re.sub(r"\d+", "#", group, count=1) for group in groups}
    first = next(iter(groups.values()), {})
    if len(groups) < 2 or len(stems) != 1 or "#" not in (stem := stems.pop()):
        return table
    if len(first) < FEWEST or any(list(group) != list(first) for group in groups.values()):
        return table
    lengths = [{len(table.columns[j]) for j in group.values()} for group in groups.values()]
    if any(len(each) != 1 for each in lengths):
        return table
    sizes = [each.pop() for each in lengths]
    said = NAMES.fullmatch(stem.rpartition(".")[2].partition("#")[0].strip("({[_ -"))
    return _stack(table, groups, sizes) if said or (len(set(sizes)) > 1 and not table.clocks) else table


def entries_of(meta: Mapping[str, Any], name: str) -> Iterator[tuple[str, Any]]:
    """What the writer said under this name in parts of a file, such as test(1).Ts: the part, and the value."""
    for key, value in meta.items():
        part, _, last = key.rpartition(".")
        if isinstance(value, Mapping):
            yield from ((".".join(filter(None, (key, inner))), each) for inner, each in entries_of(value, name))
        elif last == name and isinstance(value, int | float | str):
            yield part, value


def sampling_times(meta: Mapping[str, Any], names: Sequence[str] = tuple(RATES)) -> Iterator[tuple[str, float]]:
    """The sampling times [s] that the writer said under these names, and of which part of the file."""
    for name in names:
        for part, value in entries_of(meta, name):
            with suppress(OverflowError):  # a whole number of more than 308 digits
                if not isinstance(value, bool | str) and 0.0 < (number := float(value)) < np.inf:
                    yield part, RATES[name](number)


def _stack(table: Table, groups: dict[str, dict[str, int]], sizes: list[int]) -> Table:
    fields = list(next(iter(groups.values())))
    places = {field: [group[field] for group in groups.values()] for field in fields}
    columns = [np.concatenate([np.asarray(table.columns[j]) for j in places[field]]) for field in fields]
    rows: list[Any] = [np.concatenate([np.asarray(table.rows[j]) for j in places[field]]) for field in fields]
    number = np.repeat(np.arange(1.0, len(sizes) + 1.0), sizes)
    names, shown = list(groups), f"{next(iter(groups))} to {list(groups)[-1]}"
    stated = dict(sampling_times(table.meta))
    steps = [stated[group] for group in groups if group in stated]
    if len(set(steps)) > 1 and len(steps) == len(groups):
        time = [step * np.arange(n) for step, n in zip(steps, sizes, strict=True)]  # each has a clock of its own
        fields, columns, rows = [*fields, TIME], [*columns, np.concatenate(time)], [*rows, rows[0]]
        places[TIME] = places[fields[0]]
    units = {
        field: table.units[table.names[places[field][0]]]
        for field in fields
        if table.names[places[field][0]] in table.units
    }
    timed = frozenset(field for field in fields if all(table.names[j] in table.timed for j in places[field]))
    note = f"read {len(names)} experiments, {shown}: their columns are {', '.join(fields)}"
    return replace(
        table,
        names=(*fields, EXPERIMENT),
        columns=(*columns, number),
        rows=(*rows, rows[0]),
        units=units,
        notes=(*table.notes, note),
        timed=timed,
        local={},
        dates={},
        undated={},
        clocks={},
    )
