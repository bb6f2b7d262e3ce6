"""What a column looks like: its header, its numbers, whether it rises like a clock."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from sysid.channels.names import Header, header
from sysid.channels.values import soft_numbers
from sysid.data.table import Table

RISING = 0.9  # of the steps of a clock; the others are repeated stamps, wraps, faults
ALIKE = 0.9  # of the steps of an unnamed clock are within a tenth of the middle one


@dataclass(frozen=True)
class Look:
    """A column of a table: `values` (n,) with nan for cells that are no numbers; `finite` are the others.

    `dated` columns held dates or times of day, which were read as seconds; `timed` ones are
    times by their type in the file, in seconds whatever their name says.
    """

    header: Header
    values: np.ndarray
    dated: bool = False
    timed: bool = False

    @property
    def name(self) -> str:
        """Name of the column."""
        return self.header.name

    @cached_property
    def finite(self) -> np.ndarray:
        """The numbers."""
        known = np.isfinite(self.values)
        return self.values if known.all() else self.values[known]

    @cached_property
    def numeric(self) -> bool:
        """Whether most cells are numbers."""
        return len(self.values) > 0 and 2 * len(self.finite) >= len(self.values)

    @cached_property
    def constant(self) -> bool:
        """Whether all numbers are one."""
        x = self.finite
        return len(x) == 0 or bool(np.ptp(x) == 0)

    @cached_property
    def whole(self) -> bool:
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
    def rises(self) -> bool:
        """Whether nearly all steps are upwards; stamps may repeat."""
        steps = np.diff(self.finite)
        return len(steps) > 0 and float(np.mean(steps >= 0)) >= RISING and bool(np.any(steps > 0))

    @cached_property
    def ticks(self) -> bool:
        """Whether it rises in nearly equal steps, as a clock does and hardly any signal."""
        steps = np.diff(self.finite)
        if not self.rises or len(steps) < 3:
            return False
        return float(np.mean(np.abs(steps - self.step) <= 0.1 * self.step)) >= ALIKE

    @cached_property
    def barely_varies(self) -> bool:
        """Whether it keeps its sign and stays within a third of its mean, as a supply does."""
        x = self.finite
        mean = abs(float(x.mean())) if len(x) else 0.0
        return len(x) > 0 and float(np.ptp(x)) < 0.67 * mean and bool(x.min() * x.max() > 0)


def look_at(table: Table, name: str) -> Look:
    """What one column looks like, whatever it holds."""
    of, values = header(name, table.units.get(name, "")), soft_numbers(table, name)
    return Look(of, values, name in table.dates, name in table.timed)


def looks(table: Table) -> dict[str, Look]:
    """Every column that holds numbers, by name."""
    found = {}
    for name in table.names:
        look = look_at(table, name)
        if look.numeric:
            found[name] = look
    return found
