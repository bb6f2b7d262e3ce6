"""From a file to a uniform record: read, mapped or guessed, sampled."""

import os
from typing import Literal

from sysid.base.checks import checked
from sysid.base.errors import InputError
from sysid.channels.guess import Given, guess
from sysid.channels.mapping import ChannelMap, Range, Repair
from sysid.channels.mapping_file import read_map
from sysid.channels.sampling import sample
from sysid.channels.signals import Signals
from sysid.data.table import Table
from sysid.formats import read_table

Mapping = ChannelMap | str | os.PathLike[str]


@checked
def read_signals(path: str | os.PathLike[str], mapping: Mapping | None = None) -> Signals:
    """The record in the file at `path`: its channels in SI, by role, sampled uniformly.

    `mapping` is a ChannelMap or the path of its file; None guesses, and `notes` say what was guessed. Raises
    InputError that names file and place for what cannot be read, for what the mapping's repairs do not cover, and
    for a guess that is not sure.
    """
    table = read_table(path)
    return sample(table, read_map_of(mapping)) if mapping is not None else from_table(table)


def read_map_of(mapping: Mapping) -> ChannelMap:
    """The mapping, from its file if it is a path."""
    return mapping if isinstance(mapping, ChannelMap) else read_map(mapping)


def from_table(
    table: Table,
    given: Given = Given(),  # noqa: B008 - it is frozen
    range: Range = Range(),  # noqa: B008
    empty: Literal["refuse", "fill", "outputs"] = "refuse",
) -> Signals:
    """The record of a table by guess, as far as columns are not `given`; `empty` as in `Repair`.

    Of a clock that is given no sample may be lost: to fill some, say so in a mapping.
    """
    found = guess(table, given)
    repair = Repair(empty=empty) if given.time is None else Repair(longest_gap=0, empty=empty)
    mapping = found.sure(table).model_copy(update={"range": range, "repair": repair})
    if given.Ts is not None and given.time is not None:
        record = sample(table, mapping, found.why)
        if abs(given.Ts - record.Ts) > mapping.repair.jitter * record.Ts:
            raise InputError(
                f"{table.path}: --ts is {given.Ts:g} s but column {given.time!r} steps by {record.Ts:g} s; leave one "
                "of the two out"
            )
        return record
    return sample(table, mapping, found.why)


def parse_range(text: str) -> Range:
    """The range START:STOP [s] after the first stamp; either may be left out. Raises InputError for another text."""
    first, mark, last = text.partition(":")
    try:
        start, stop = (float(part) if part.strip() else None for part in (first, last))
    except ValueError:
        mark = ""
    if not mark:
        raise InputError(f"--range is {text!r}; give START:STOP in seconds after the first sample, such as 2.5:30")
    return Range(start=start, stop=stop)
