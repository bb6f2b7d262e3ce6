"""The small table that tests of readers write in other programs' formats."""

import numpy as np

T = np.arange(6) / 10
U = np.array([0.0, 1.5, -2.25, 3.125, 4.0, -5.5])


def columns(table) -> dict[str, list[float]]:
    """The numbers of a table by the names of its columns."""
    return {name: table.numbers(name).tolist() for name in table.names}
