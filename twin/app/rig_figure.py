"""The live figure of the rig: angle, voltage and supply over the last seconds."""

import numpy as np

from sysid.base import style
from sysid.drawing.figure import Axis, Figure, Item, Line, Panel, Points, Rule
from sysid.drawing.plotly import Plotly, plotly
from twin.app.figures import ready
from twin.app.rig import Seen
from twin.rig import wire

WINDOW, AHEAD = 20.0, 4.0  # [s] of the figure, of which so much is still to come
MOST = 800  # points of a line: it is drawn five times a second


def live(seen: Seen, full: int) -> Plotly:
    """What the joint does: its angle, or its reading of `full` counts where angles are not known yet, the input, and
    the supply."""
    rows = np.array(seen.rows, dtype=float) if seen.rows else np.array([[0.0, *[np.nan] * 4]])
    t, counts, duty, supply, limits = rows.T
    end = max(WINDOW, float(t[-1]) + AHEAD)
    first = int(np.searchsorted(t, end - WINDOW))
    thin = slice(first, None, (len(t) - first) // MOST + 1)
    t, counts, duty, limits, share = t[thin], counts[thin], duty[thin], limits[thin], 100.0 * supply[thin] / supply[0]
    clock = Axis("time [s]", limits=(end - WINDOW, end))
    c, plan = seen.calibration, seen.plan
    if c is not None and c.is_zeroed:
        place, over = np.rad2deg(c.angle(counts)), Axis("angle [deg]", "angle", "deg")
        ends = np.rad2deg([angle for angle in (c.soft_low, c.soft_high) if angle is not None])
        level, sized = c.volts(duty), Axis("voltage [V]", "voltage", "V", limits=_around(c.largest))
    else:
        place, over, ends = counts, Axis("reading [counts]", "reading", f"of {full} counts"), np.zeros(0)
        level, sized = 100.0 * duty / wire.FULL, Axis("duty [%]", "duty", "%", limits=_around(100.0))
    moving: list[Item] = [Rule(end, False, "dash", "" if k else "soft limit") for k, end in enumerate(ends.tolist())]
    moving.append(Line(t, place, "measured", style.INK, 1.6))
    if (cut := limits > 0).any():
        moving.append(Points(t[cut], place[cut], "motor cut at a limit"))
    played: list[Item] = [Line(t, level, "played", style.INPUT, 1.6, steps=True)]
    if plan is not None:
        times = np.arange(len(plan.u)) * plan.Ts
        near = np.flatnonzero((times >= end - WINDOW) & (times <= end))
        near = near[:: len(near) // MOST + 1]
        played.insert(0, Line(times[near], plan.u[near], "planned", style.SECOND, 1.0, steps=True))
    power: list[Item] = [Line(t, share, "supply", style.COLOURS[2], 1.6, key=False)]
    panels = [
        Panel(moving, over, clock, weight=1.2),
        Panel(played, sized, clock),
        Panel(
            power, Axis("supply [%]", "supply", "% of that at the beginning", limits=(0.0, 120.0)), clock, weight=0.6
        ),
    ]
    return ready(plotly(Figure(panels)))


def _around(largest: float) -> tuple[float, float]:
    return -1.1 * largest, 1.1 * largest
