"""The tests of a day: half of all, and of a test with many cases a part; each day others, so that all run in turn.

The whole suite takes two processors 26 minutes, and a change may take 20 with all other checks. What breaks a code path
mostly breaks several tests, and of those some are of the day; whoever changes it runs all tests of its rooms.
"""

import zlib
from collections import defaultdict
from collections.abc import Callable, Sequence
from typing import TypeVar

Item = TypeVar("Item")
DAYS = 2  # in which every test runs
CASES = 8  # of one test on one day, at most


def of_the_day(
    items: Sequence[Item], test: Callable[[Item], str], together: Callable[[Item], str], day: int
) -> tuple[list[Item], list[Item]]:
    """The items of this day and those of other days; items of one test are its cases.

    Items that have one name `together`, which is empty for others, run on one day: they build on each other.
    """
    places: dict[tuple[str, str], list[int]] = defaultdict(list)
    for place, item in enumerate(items):
        name = together(item)
        places[name, "" if name else test(item)].append(place)
    today = set()
    for (name, of_test), cases in places.items():
        days = DAYS if name else max(DAYS, -(-len(cases) // CASES))
        first = (day + zlib.crc32((name or of_test).encode())) % days  # tests of one case fall on all days alike
        today |= set(cases[first::days] if not name else cases if first == 0 else ())
    return [x for k, x in enumerate(items) if k in today], [x for k, x in enumerate(items) if k not in today]
