"""Dates and times of day without an offset from UTC, in which an hour is lost or comes twice when clocks change."""

import numpy as np

from sysid.channels.mapping import Clock
from sysid.data.table import Table

HOUR = 3600.0  # [s]
OFF = 0.01  # of an hour and of a step: what is so near an hour off is a change of clocks
MONTHS = (3, 4, 9, 10, 11)  # in which clocks are changed, north or south
NIGHT = (-4.0, 5.0)  # [h] from the midnight between Saturday and Sunday
SHORT = 20 * 60.0  # [s] below that an hour is a gap that is refused anyway, or a stamp that runs back
PLACES = 300  # between two stamps that are looked at
WRITE = "write dates in UTC or with their offset"


def change_of_clocks(table: Table, clock: Clock, step: float, usual: float) -> str:
    """What a step [s] between dates may be that is an hour off the `usual` one; else nothing."""
    if clock.column not in table.local or not _is_an_hour_off(step, usual):
        return ""
    return f", about an hour, as a local clock makes at the change of clocks: {WRITE}"


def changed(table: Table, clock: Clock, values: np.ndarray) -> tuple[int, str] | None:
    """The place of the first stamp (n,) [s] behind a change of clocks, and the sentence; None if there is none.

    A slow log does not show it otherwise: the hour is a lost sample, or a stamp that repeats. Where the date is known,
    only nights in which clocks are changed count; samples that are lost at other times are filled.
    """
    if clock.column not in table.local or len(values) < 3:
        return None
    steps = np.diff(values)
    usual = float(np.median(steps[steps > 0])) if np.any(steps > 0) else 0.0
    if usual < SHORT:
        return None
    for k in np.flatnonzero(np.abs(np.abs(steps - usual) - HOUR) <= OFF * (HOUR + usual)).tolist():
        low, high = sorted((values[k], values[k] + usual))
        if _may_change(table.local[clock.column], low, high):
            off = "more" if steps[k] > usual else "less"
            return k + 1, (
                f"found a step of {steps[k]:.6g} s where most are {usual:.6g} s: an hour {off}, as a local clock makes "
                f"at the change of clocks; {WRITE}, or give the sampling time with --ts if the rows are uniform"
            )
    return None


def _is_an_hour_off(step: float, usual: float) -> bool:
    return bool(abs(abs(step - usual) - HOUR) <= OFF * (HOUR + usual))


def _may_change(origin: float, low: float, high: float) -> bool:
    """Whether clocks may be changed between two local times [s]; `origin` is nan where the date is not known."""
    places = np.linspace(low, high, PLACES)
    if np.isnan(origin):
        return True
    days = (origin + places) / 86400.0
    from_sunday = ((days + 4.0 + 3.5) % 7.0 - 3.5) * 24.0  # 1970 began on a Thursday
    months = days.astype("datetime64[D]").astype("datetime64[M]").astype(int) % 12 + 1
    return bool(np.any(np.isin(months, MONTHS) & (from_sunday >= NIGHT[0]) & (from_sunday <= NIGHT[1])))
