"""The static gain that the first screen shows: of a model with maps with the level of the input that it holds at."""

import numpy as np

from sysid.base.errors import InputError
from sysid.base.quantities import estimate, number
from sysid.estimation.result import Fit
from sysid.model.tangents import steady_curve, tangent
from sysid.report import figures, sections
from sysid.report.bands import bands
from sysid.uncertainty import intervals
from sysid.uncertainty.intervals import Interval
from sysid.workflow.results import Evaluation

LEVELS = 41  # of the input, over its range: a fortieth of the range is nothing that people tell apart
_SAME = 1e-6  # of the largest gain: gains that differ by rounding


def gain_rows(e: Evaluation) -> list[tuple[str, ...]]:
    """Name, value, interval and unit of the gain dy/du at rest: where the output settles, else nothing.

    With maps it is the mean over the range, unless the record shows that the gain at the mean input is another: then it
    is that one. Where the output does not react there, as in a dead zone, it is that of the level where it is most
    surely large.
    """
    if e.outputs or not e.linear or not e.stable:
        return []
    try:
        middle = _at(e, float(np.mean(e.estimation.u)))
        low, high = float(e.estimation.u.min()), float(e.estimation.u.max())
        levels = np.linspace(low, high, LEVELS)
        over = [_at(e, level) for level in levels]
    except InputError:  # a block without a tangent
        return []
    u, y = figures.signals(e)
    size = max(abs(found.value) for found in over)

    def told(level: float) -> str:
        offset = 0.0 if len(e.estimation.u_offset) > 1 else float(e.estimation.u_offset[0])
        return number(u.factor * (level + offset), 3)

    def at(level: float) -> str:
        return f"gain at {u.name} = {told(level)} {u.unit}".rstrip()

    name, shown = at(float(np.mean(e.estimation.u))), middle
    best = max(range(LEVELS), key=lambda k: (_surely(over[k]), abs(over[k].value)))
    if all(abs(found.value - middle.value) <= _SAME * size for found in over):
        name = "gain"
    elif abs(middle.value) <= _SAME * size:
        name, shown = f"largest {at(float(levels[best]))}", over[best]
    elif _known(mean := _mean(e, low, high)) and (not _known(middle) or middle.lower <= mean.value <= middle.upper):
        name, shown = f"mean gain, {u.name} {told(low)} to {told(high)} {u.unit}".rstrip(), mean
    q = y.per(u)
    if not _known(shown):
        return [(name, number(q.factor * shown.value), sections.NOT_KNOWN, q.unit)]
    value, *ends = estimate(*(q.factor * x for x in (shown.value, shown.lower, shown.upper)))
    return [(name, value, " to ".join(ends), q.unit)]


def _known(found: Interval) -> bool:
    """Whether the interval leaves no doubt of the sign, as a rule: else the record does not say what the gain is."""
    return bool(found.upper - found.lower <= 2.0 * abs(found.value))


def _surely(found: Interval) -> float:
    """What the size of a gain is at least; below 0 where its sign is open."""
    return abs(found.value) - 0.5 * (found.upper - found.lower)


def _at(e: Evaluation, level: float) -> Interval:
    """The gain at one level; without an interval where the record has no information."""
    info = bands(e).info
    if info is not None:
        return intervals.gain(info, level)
    assert isinstance(e.fit, Fit)  # it is linear
    return Interval(tangent(e.fit.model, e.fit.theta, level).gain, np.nan, -np.inf, np.inf)


def _mean(e: Evaluation, low: float, high: float) -> Interval:
    """The mean gain between two levels: the slope of the straight line between two states of rest."""
    info = bands(e).info
    if info is None or not high > low:
        return Interval(np.nan, np.nan, -np.inf, np.inf)
    y, gradient = steady_curve(info.chain, info.theta, np.array([low, high]))
    return intervals.interval(info, (y[1] - y[0]) / (high - low), (gradient[1] - gradient[0]) / (high - low))
