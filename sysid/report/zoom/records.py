"""A record over time: inputs over outputs with one time axis; as recorded, or split into the two parts of a fit."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from sysid.base import style
from sysid.base.units import Quantity
from sysid.base.units import shown as quantity_of
from sysid.data.preprocess import retrend
from sysid.data.record import IOData
from sysid.report.zoom import _parts as parts_of
from sysid.report.zoom._parts import Figure, Row, Trace

TIME = "time [s]"


def record(data: IOData) -> Figure:
    """Inputs u (N, nu) and outputs y (N, ny) as recorded: offsets that were removed are added again.

    Experiments stand one after another, with a line between them.
    """
    return _figure([(data, "", True)], whole=True)


def parts(estimation: IOData, validation: IOData) -> Figure:
    """The two parts of a record, one after the other; constants that were removed are added again."""
    return _figure([(retrend(estimation), "estimation", True), (retrend(validation), "validation", False)])


def lines(t: np.ndarray, signals: Mapping[str, np.ndarray], name: str, unit: str = "", title: str = "") -> Figure:
    """Signals (N,) of one kind over time t (N,) [s] in one panel, by name; `name` and `unit` label the axis."""
    quantity = quantity_of(name, unit)
    colours = (style.INK, *parts_of.COLOURS)
    traces = [
        parts_of.line(t, parts_of.times(y, quantity.factor), each, colour, quantity.unit, legend=len(signals) > 1)
        for (each, y), colour in zip(signals.items(), colours * len(signals), strict=False)
    ]
    return parts_of.stacked(traces, [Row(quantity.label, title, 1.3)], TIME)


def _figure(shown: list[tuple[IOData, str, bool]], whole: bool = False) -> Figure:
    first = shown[0][0]
    signals = [*parts_of.inputs(first), *parts_of.outputs(first)]
    nu = first.u.shape[1]
    traces, shapes, start = list[Trace](), list[Figure](), 0.0
    for data, name, known in shown:
        for k, quantity in enumerate(signals):
            colour = style.INPUT if (k < nu if whole else not known) else style.INK
            traces.append(_line(data, k, quantity, start, name or quantity.name, colour, whole, bool(name) and k == 0))
        shapes += parts_of.borders(data, start)
        start += data.N * data.Ts
        if data is not shown[-1][0]:
            shapes.append(parts_of.upright(start - 0.5 * data.Ts, "solid"))
    rows = [Row(quantity.label, "input" if k < nu else "output") for k, quantity in enumerate(signals)]
    figure = parts_of.stacked(traces, rows, TIME)
    figure["layout"]["shapes"] += shapes
    return figure


def _line(
    data: IOData, k: int, quantity: Quantity, start: float, name: str, colour: str, whole: bool, legend: bool
) -> Trace:
    nu = data.u.shape[1]
    values = data.u[:, k] if k < nu else data.y[:, k - nu]
    if whole:
        values = values + (data.u_offset[k] if k < nu else data.y_offset[k - nu])
    values = parts_of.times(values, quantity.factor)
    options = {"row": k, "lengths": data.lengths, "steps": k < nu, "legend": legend}
    return parts_of.line(start + data.t, values, name, colour, quantity.unit, **options)


@dataclass(frozen=True)
class Panel:
    """Values (N,) in the stored unit of `quantity`, with a title; `steps` for a value that is held between samples."""

    quantity: Quantity
    values: np.ndarray
    title: str = ""
    colour: str = style.INK
    steps: bool = False


def stack(t: np.ndarray, panels: Sequence[Panel], marked: np.ndarray | None = None, mark: str = "filled") -> Figure:
    """Any signals over one time axis t (N,) [s], one panel each; samples `marked` (N,) get a dot named `mark`."""
    traces = list[Trace]()
    for k, panel in enumerate(panels):
        values, unit = parts_of.times(panel.values, panel.quantity.factor), panel.quantity.unit
        name = panel.quantity.name
        traces.append(parts_of.line(t, values, name, panel.colour, unit, k, steps=panel.steps, legend=False))
        if marked is not None and marked.any():
            dots = parts_of.line(t[marked], values[marked], mark, style.MODEL, unit, k, legend=k == 0)
            traces.append(dots | {"mode": "markers", "marker": {"color": style.MODEL, "size": 5}})
    return parts_of.stacked(traces, [Row(panel.quantity.label, panel.title) for panel in panels], TIME)
