"""How often a statistical test runs: some seeds by default, all with QPAL_FULL=1."""

import os

FULL = os.environ.get("QPAL_FULL") == "1"


def often(every: int, some: int) -> range:
    """The first `some` of `every` seeds, or all of them in a full run."""
    return range(every if FULL else some)
