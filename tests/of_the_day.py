"""A part of every family of tests: each day another, so that all cases run within weeks and no run takes an hour.

A family is a test with many cases. One code path costs a family a second or a minute, and what breaks it mostly breaks
many of its cases; the whole of all families took twice the time that a change may take.
"""

from collections import defaultdict
from collections.abc import Callable, Hashable, Sequence
from typing import TypeVar

Item = TypeVar("Item")
CASES = 8  # of a family on one day: half of the suite's time, measured


def of_the_day(items: Sequence[Item], family: Callable[[Item], Hashable], day: int) -> tuple[list[Item], list[Item]]:
    """The items of this day, at most `CASES` of a family and spread over it, and those of other days."""
    members: dict[Hashable, list[Item]] = defaultdict(list)
    for item in items:
        members[family(item)].append(item)
    today, others = [], []
    place: dict[Hashable, int] = defaultdict(int)
    for item in items:
        name = family(item)
        days = -(-len(members[name]) // CASES)
        (today if place[name] % days == day % days else others).append(item)
        place[name] += 1
    return today, others
