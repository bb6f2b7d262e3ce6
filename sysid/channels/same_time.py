"""Two clocks of one record: the stamp of the source beside the time at which a robot log received the message."""

from collections.abc import Sequence

import numpy as np

from sysid.channels.looks import Look

TOLD = 0.01  # of a step, by which two clocks of the same time may differ without a word


def of_source(chosen: Look, others: Sequence[Look]) -> Look:
    """The stamp inside the messages of a topic instead of their receive time, where it ticks more evenly."""
    topic, dot, field = chosen.name.rpartition(".")
    if not dot or field != "time":
        return chosen
    own = [o for o in others if o.name.startswith(f"{topic}.") and "stamp" in o.name[len(topic) :].lower()]
    return min([chosen, *own], key=_unevenness)


def apart(clock: Look, other: Look, unit: float, other_unit: float) -> str:
    """What to say of the distance of two clocks in units of so many seconds; nothing where it is small."""
    if len(clock.values) != len(other.values):
        return ""
    off = clock.values * unit - other.values * other_unit
    off = off[np.isfinite(off)]
    step = clock.step * unit
    if not len(off) or not step > 0 or np.ptp(off) <= TOLD * step:
        return ""
    return (
        f", but is up to {np.ptp(off):.3g} s earlier or later beside it ({np.ptp(off) / step:.0%} of a step); choose "
        f"it with --time {other.name!r} if it is the better one"
    )


def _unevenness(look: Look) -> float:
    """Standard deviation of the steps, in middle steps."""
    return float(np.std(np.diff(look.finite))) / look.step
