"""Physical values of an actuated joint with their intervals, and the parts that its growth tried."""

from collections.abc import Sequence

import numpy as np

from sysid.base import style
from sysid.base.log_axes import power
from sysid.base.units import number, shown
from sysid.joint.growth import Growth
from sysid.joint.rounds import MARGIN
from sysid.joint.values import JointValue
from sysid.report.joint_words import PARTS, groups, short
from sysid.report.sections import WORDS
from sysid.report.zoom import _parts as parts
from sysid.report.zoom._parts import DASHED, FRAME, Figure, Trace

ROW, GAP = 30, 0.14  # height of a value [px]; between panels


def values(found: Sequence[JointValue]) -> Figure:
    """One panel for values of one unit and size; a bar is the 95 % interval, an open point is not determined."""
    by_axis = groups(found)
    most = [len(each) for each in by_axis.values()]
    height = 130 + ROW * sum(most) + 52 * len(by_axis)
    free = 1.0 - GAP * (len(by_axis) - 1)
    layout, traces, top = parts.base("", height=height), list[Trace](), 1.0
    for k, ((unit, _), each) in enumerate(by_axis.items()):
        suffix, bottom = "" if k == 0 else str(k + 1), top - free * len(each) / sum(most)
        names = [short(v) for v in each]
        label = f"value [{unit}]" if unit else "value [1]"
        layout[f"xaxis{suffix}"] = parts.side(label, anchor=f"y{suffix}", domain=[0, 1])
        layout[f"yaxis{suffix}"] = parts.side("", anchor=f"x{suffix}", domain=[max(bottom, 0.0), top])
        layout[f"yaxis{suffix}"] |= {"autorange": "reversed", "type": "category", "categoryarray": names}
        for determined in (True, False):
            mine = [v for v in each if (v.low is not None and v.high is not None) == determined]
            if mine:
                traces.append(_points(mine, determined) | {"xaxis": f"x{suffix}", "yaxis": f"y{suffix}"})
        top = bottom - GAP
    seen = set[str]()
    for trace in traces:
        trace["showlegend"] = trace["name"] not in seen
        seen.add(trace["name"])
    return {"data": traces, "layout": layout}


def _points(mine: Sequence[JointValue], determined: bool) -> Trace:
    factors = [shown(v.name, v.unit).factor for v in mine]
    at = [v.value * f for v, f in zip(mine, factors, strict=True)]
    trace: Trace = {
        "type": "scatter",
        "mode": "markers",
        "x": at,
        "y": [short(v) for v in mine],
        "name": "value, 95 % interval" if determined else "not determined",
        "legendgroup": str(determined),
        "marker": {"color": style.MODEL, "size": 9, "symbol": "circle" if determined else "circle-open"},
        "hovertext": [_meaning(v) for v in mine],
        "hoverinfo": "text",
    }
    if determined:
        above = [(v.high - v.value) * f for v, f in zip(mine, factors, strict=True) if v.high is not None]
        below = [(v.value - v.low) * f for v, f in zip(mine, factors, strict=True) if v.low is not None]
        sides = {"array": above, "arrayminus": below}
        trace["error_x"] = {
            "type": "data",
            "symmetric": False,
            "thickness": 2,
            "width": 4,
            "color": style.MODEL,
        } | sides
    return trace


def _meaning(v: JointValue) -> str:
    as_shown = shown(v.name, v.unit)
    unit, factor = as_shown.unit, as_shown.factor
    words = f"<b>{WORDS.get(v.name, v.name)}</b><br>{number(v.value * factor, 4)} {unit}".rstrip()
    if v.low is None or v.high is None:
        return f"{words}<br>not determined: {v.why or 'this record does not show it'}"
    return f"{words}<br>95 % interval {number(v.low * factor, 4)} to {number(v.high * factor, 4)} {unit}".rstrip()


def growth(found: Growth) -> Figure:
    """Parts tried, round by round: the fall of BIC, on an axis that is logarithmic beyond 10."""
    layout = parts.base("fall of BIC, logarithmic beyond 10 [1]", height=130 + 26 * len(found.steps))
    names, lengths, texts = list[str](), list[float](), list[str]()
    colours, hatches = list[str](), list[str]()  # as `plots.earned` draws them
    for step in found.steps:
        stayed = found.stayed(step)
        names.append(f"round {step.round + 1}: {PARTS.get(step.part, step.part)}")
        lengths.append(_squeezed(step.earned))
        colours.append(style.MODEL if step.kept else parts.PAPER)
        hatches.append("/" if step.kept and not stayed else "")
        fate = "kept" if stayed else "kept, later without it" if step.kept else "not kept"
        unseen = f"<br>error on unseen parts × {step.unseen:.3f}" if np.isfinite(step.unseen) else ""
        texts.append(f"<b>{names[-1]}</b>: {fate}<br>BIC falls by {number(step.earned, 4)} to {step.bic:.0f}{unseen}")
    bars = {"type": "bar", "orientation": "h", "x": lengths, "y": names, "hovertext": texts, "hoverinfo": "text"}
    hatch = {"shape": hatches, "fgcolor": style.MODEL, "bgcolor": parts.PAPER, "size": 6}
    marker = {"color": colours, "line": {"color": style.MODEL, "width": 1.2}, "pattern": hatch}
    look = {"marker": marker, "name": "parts", "showlegend": False}
    layout["yaxis"] = parts.side("") | {"type": "category", "autorange": "reversed"}
    # The dashed line has a number of its own: without one it is read on a linear axis, at another value.
    low, high = min([*lengths, 0.0]), max([*lengths, _squeezed(MARGIN)])
    span = [low - 0.08 * (high - low), high + 0.08 * (high - low)]
    ticks = [0.0, MARGIN, *(sign * 10.0**k for k in range(1, 8) for sign in (-1.0, 1.0))]
    shown_ticks = sorted(t for t in ticks if span[0] <= _squeezed(t) <= span[1])
    layout["xaxis"] |= {"range": span}
    layout["xaxis"] |= {"tickvals": [_squeezed(t) for t in shown_ticks], "ticktext": [power(t) for t in shown_ticks]}
    layout["shapes"] = [
        {"type": "line", "yref": "paper", "y0": 0, "y1": 1, "x0": _squeezed(x), "x1": _squeezed(x), "line": line}
        for x, line in ((0.0, {"color": FRAME, "width": 1}), (MARGIN, DASHED))
    ]
    return {"data": [bars | look], "layout": layout}


def _squeezed(earned: float) -> float:
    """Linear up to 10, logarithmic beyond."""
    size = abs(earned) / 10.0
    return float(np.sign(earned) * (size if size <= 1.0 else 1.0 + np.log10(size)))
