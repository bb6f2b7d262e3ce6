"""A record over time: inputs over outputs with one time axis; as recorded, or split into the two parts of a fit."""

from sysid.base import style
from sysid.base.units import Quantity
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
    """The two parts of a record as a fit uses them, one after the other."""
    return _figure([(estimation, "estimation", True), (validation, "validation", False)])


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
