"""An order of tests in which every worker of xdist begins with long ones."""

from collections.abc import Callable, Hashable, Sequence
from itertools import groupby
from typing import TypeVar

Item = TypeVar("Item")


def in_shares(
    items: Sequence[Item], workers: int, long: Callable[[Item], object], file: Callable[[Item], Hashable]
) -> list[Item]:
    """All items in the consecutive shares that `--dist worksteal` hands out first, one share for each worker.

    The long items of one file, which may use the same fixture, stand together at the front of one share, and those of
    the next file at the front of the next share.
    """
    groups = [list(group) for _, group in groupby(filter(long, items), file)]
    short = [item for item in items if not long(item)]
    found: list[Item] = []
    for worker in range(workers):
        size = (len(items) - len(found)) // (workers - worker)  # as xdist counts
        mine = [item for group in groups[worker::workers] for item in group]
        rest = max(size - len(mine), 0)
        found += mine + short[:rest]
        del short[:rest]
    return found
