"""Figures of an actuated joint: its physical values, and its parts beside what is usual."""

from collections.abc import Sequence
from dataclasses import replace

from sysid.base import style
from sysid.base.quantities import display_quantity, estimate, number
from sysid.drawing.figure import Axis, Figure, Item, Panel, Ranges, Rule
from sysid.joint.parts import PartEvidence
from sysid.joint.values import JointValue, distinct_values
from sysid.plots.usual import Row, usual_figure
from sysid.report.sections import WORDS

PARTS = {
    "stick": "extra friction at rest, up",
    "stick_down": "extra friction at rest, down",
    "loss": "friction by load",
    "jam": "jam at an end stop",
    "sag": "sagging supply",
    "dead": "dead band",
    "width": "backlash",
}
PARTS_SAY = (
    "What to see: an interval away from 0 is a part that the record shows; a short one at 0, a part that is absent. "
    "One that fills the area of usual sizes tells no more than was known before. The words beside the names are the "
    "verdict: 20 to 1 for the part, 20 to 1 against it, or neither (not determined)."
)
SHORT = {
    "speed_per_volt": "speed per volt",
    "speed_full_drive": "speed at full drive",
    "breakaway_up": "break-away voltage up",
    "breakaway_down": "break-away voltage down",
    "coulomb_up": "friction, moving up",
    "coulomb_down": "friction, moving down",
    "moving_friction_up": "friction, moving up",
    "moving_friction_down": "friction, moving down",
    "end_low": "lower end stop",
    "end_high": "upper end stop",
    "time_constant": "time constant",
    "lag_and_delay": "lag + delay",
}
COLUMNS = 2  # more beside each other leave no room for the names


def values_figure(values: Sequence[JointValue]) -> Figure:
    """A panel for values of one unit and size; a bar is the 95 % interval, an open grey point is not determined."""
    panels = [_values_panel(unit, group) for (unit, _), group in _groups(values).items()]
    rows = -(-len(panels) // COLUMNS)
    longest = max(len(panel.y.names) for panel in panels)
    columns = -(-len(panels) // rows)
    return Figure(panels, columns, shared=False, height=0.4 + rows * (0.9 + 0.28 * longest), legend="below")


def parts_figure(parts: Sequence[PartEvidence]) -> Figure:
    """The parts of a joint beside what is usual, with what the record shows of each in the hover."""
    texts = []
    for part in parts:
        found, usual = (f"{number(a, 4)} ± {number(b, 2)}" for a, b in part.normals)
        texts.append(f"<b>{part.words}</b>: {part.verdict}<br>{found} {part.unit}; usual {usual} {part.unit}")
    return usual_figure(rows(parts), texts)


def rows(parts: Sequence[PartEvidence]) -> list[Row]:
    """The parts as rows of that figure."""
    return [(PARTS.get(p.name.split(".")[-1], p.words), p.normals[1], p.normals[0], p.verdict) for p in parts]


def _groups(values: Sequence[JointValue]) -> dict[tuple[str, bool], list[JointValue]]:
    """The values that share an axis, by unit; a backlash, a hundredth of the way between the ends, has its own."""
    groups: dict[tuple[str, bool], list[JointValue]] = {}
    for v in distinct_values(values):
        groups.setdefault((display_quantity(v.name, v.unit).unit, v.name == "backlash"), []).append(v)
    return groups


def _values_panel(unit: str, values: Sequence[JointValue]) -> Panel:
    """The values of one unit, those that the record determines and those that it does not."""
    items, factors = list[Item](), [display_quantity(v.name, v.unit).factor for v in values]
    for has_interval in (True, False):
        places = [k for k, v in enumerate(values) if (v.low is not None and v.high is not None) == has_interval]
        if not places:
            continue
        x, low, high = (
            [factors[k] * (getattr(values[k], name) or 0.0) for k in places] for name in ("value", "low", "high")
        )
        label = "value, 95 % interval" if has_interval else "not determined"
        points = Ranges(places, x, label=label, texts=[_meaning(values[k]) for k in places])
        if has_interval:
            items.append(replace(points, low=low, high=high))
        else:  # it may be anywhere along its row
            items += [replace(points, colour=style.SECOND), *(Rule(k, upright=False, dash="dot") for k in places)]
    names = [f"{SHORT.get(v.name, v.name.replace('_', ' '))}{'' if v.low is not None else ' (?)'}" for v in values]
    limits = None
    if all(v.low is None for v in values):  # near a number alone, the axis would make it look exact
        reach = 2.0 * max(abs(f * v.value) for f, v in zip(factors, values, strict=True)) or 1.0
        limits = (-reach if any(v.value < 0.0 for v in values) else 0.0), reach
    return Panel(items, Axis(names=names), Axis(f"value [{unit or 1}]", limits=limits))


def _meaning(v: JointValue) -> str:
    """The value in full, for a hover."""
    quantity = display_quantity(v.name, v.unit)
    unit, factor = quantity.unit, quantity.factor
    name = f"<b>{WORDS.get(v.name, v.name)}</b>"
    if v.low is None or v.high is None:
        found = f"{name}<br>{number(v.value * factor, 4)} {unit}".rstrip()
        return f"{found}<br>not determined: {v.why or 'this record does not show it'}"
    value, low, high = estimate(*(factor * x for x in (v.value, v.low, v.high)))
    return f"{f'{name}<br>{value} {unit}'.rstrip()}<br>95 % interval {low} to {high} {unit}".rstrip()
