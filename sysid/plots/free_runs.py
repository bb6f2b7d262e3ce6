"""Free runs beside the measured output: of one model over both parts, or of several models over one record."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import cycle
from typing import TYPE_CHECKING

import numpy as np

from sysid.base import style
from sysid.base.checks import checked
from sysid.base.errors import InputError
from sysid.base.quantities import Quantity, display_quantity, percent
from sysid.data.preprocess import retrend
from sysid.data.record import IOData
from sysid.drawing.axes import draw
from sysid.drawing.departure import departure, frame
from sysid.drawing.figure import TIME, Axis, Band, Figure, Item, Line, Panel, Span, borders, scaled
from sysid.plots.records import channels, first
from sysid.plots.responses import in_small
from sysid.uncertainty.bands import OutputBand

if TYPE_CHECKING:
    from matplotlib.axes import Axes

MEASURED = "measured"


@dataclass(frozen=True)
class Run:
    """A model's output y (N,) on the scale of `data`, its fit [%] and its name."""

    data: IOData
    y: np.ndarray
    fit: float
    title: str = ""
    what: str = "free run"

    @property
    def label(self) -> str:
        """Legend text: name and fit."""
        return f"{self.what}, fit {percent(self.fit)}"

    def recorded(self) -> Run:
        """The same as the output was recorded: the constant that was removed before the fit is added again."""
        return replace(self, data=retrend(self.data), y=self.y + self.data.y_offset[0])


@checked(deferred=("axes",))
def free_run(
    estimation: Run, validation: Run, one_step: Run | None = None, axes: Sequence[Axes] | None = None
) -> list[Axes]:
    """Measured output and the model's free run over both parts, and the error of the validation part.

    A model with a one-step-ahead prediction gets a separate panel for it.
    """
    return draw(parts_of_run_figure(estimation, validation, one_step), axes)


@checked(deferred=("axes",))
def free_runs(
    runs: Sequence[Run], axes: Sequence[Axes] | None = None, seconds: float | None = None, time: str = TIME
) -> list[Axes]:
    """Measured output and free run of each model, one panel each, over the first `seconds` [s] or all samples.

    `time` labels the axis.
    """
    return draw(free_runs_figure(runs, seconds, time), axes)


@checked(deferred=("axes", "run", "fits"))
def fitted(
    data: IOData, run: np.ndarray, fits: Sequence[float], axes: Sequence[Axes] | None = None, skipped: int = 0
) -> list[Axes]:
    """Measured output and free run (N,) or (N, ny), and below it the error of each output.

    `fits` (ny,) are in %; the first `skipped` samples of each experiment give the initial state and are shaded. Where a
    run leaves the data far, the axis is linear over the data and logarithmic beyond.
    """
    ny = data.y.shape[1]
    if len(fits) != ny:
        raise InputError(f"fits has {len(fits)} values for {ny} output(s); give one for each")
    runs, data = as_outputs(data, run) + data.y_offset, retrend(data)
    starts = (data.Ts * np.cumsum([0, *data.lengths])[:-1]).tolist()
    initial_spans = [Span(start, start + skipped * data.Ts) for start in starts if skipped]
    panels = list[Panel]()
    y, number = output(data), [f" {j + 1}" if ny > 1 else "" for j in range(ny)]
    for j in range(ny):
        run_axes = over_panel(
            data.t, data.y[:, j], {f"free run, fit {percent(fits[j])}": runs[:, j]}, y, f"output{number[j]}"
        )
        error_axes = error_panel(data.t, data.y[:, j], runs[:, j], y, f"error{number[j]}", "measured minus free run")
        panels += [replace(run_axes, weight=1.4), error_axes]
    return draw(Figure(panels, height=0.6 + 3.4 * ny, marks=initial_spans), axes)


@checked(deferred=("axes",))
def simulated(band: OutputBand, data: IOData | None = None, axes: Axes | None = None) -> Axes:
    """Free run with its band and the measured output. Long segments of data outside the band show model errors."""
    y = display_quantity(data.y_name if data is not None else "y", band.unit)
    run, lower, upper = (scaled(values, y.factor) for values in (band.y, band.lower, band.upper))
    kind = f"Monte Carlo, {band.draws - band.dropped} draws" if band.draws else "linear"
    items: list[Item] = [
        Line(band.t, run, "free run"),
        Band(band.t, lower, upper, f"{100 * band.level:g} % band ({kind})"),
    ]
    near = None
    if data is not None:
        measured = data.y[:, 0] * y.factor
        items.insert(0, Line(data.t, measured, MEASURED, style.INK))
        if departure(measured, np.concatenate([lower, run, upper])) is not None:
            near = frame(measured)
    x = Axis(TIME, limits=(float(band.t[0]), float(band.t[-1])))
    panel = Panel(items, Axis.of(y, near=near), x, "simulated output", note=in_small(band.note))
    return draw(Figure([panel], height=3.2), axes)[0]


@checked(deferred=("axes", "run"))
def close_ups(data: IOData, run: np.ndarray, axes: Sequence[Axes] | None = None, time: str = TIME) -> list[Axes]:
    """The first whole upper and lower peak of the measured output, with the free run (N,) over it.

    `time` labels the axis.
    """
    return draw(close_ups_figure(data, run, time), axes)


def parts_of_run_figure(estimation: Run, validation: Run, one_step: Run | None = None) -> Figure:
    """The free run over each part, the validation error, and the one-step-ahead prediction where there is one."""
    panels = [
        run_panel(replace(estimation, title="estimation part")),
        run_panel(replace(validation, title="validation data, not used in the fit")),
        error_panel(
            validation.data.t,
            validation.data.y[:, 0],
            validation.y,
            output(validation.data),
            "validation error, measured minus free run",
        ),
    ]
    if panels[-1].y.near is None:  # the error stands against the range of the output
        measured = validation.data.y[:, 0] * output(validation.data).factor
        limits = frame(np.concatenate([measured - measured.mean(), panels[-1].lines()[0].y]))
        panels[-1] = replace(panels[-1], y=replace(panels[-1].y, limits=limits))
    if one_step is not None:
        prediction = replace(one_step, title="one step ahead, NOT a free run", what="one step ahead")
        panels.append(run_panel(prediction, colour=style.INPUT))
    panels = [replace(p, x=Axis.time(TIME if p is panels[-1] else "")) for p in panels]
    return Figure(panels, shared=False, height=1.8 * len(panels), lettered=True)


def free_runs_figure(
    runs: Sequence[Run],
    seconds: float | None = None,
    time: str = TIME,
    colours: Sequence[str] = (style.MODEL,),
) -> Figure:
    """Measured output and free run of each model in a panel, in `colours` by turns."""
    shown = zip(runs, cycle(colours), strict=False)
    panels = [run_panel(run, first(run.data, seconds), time, colour) for run, colour in shown]
    return Figure(panels, height=0.5 + 1.9 * len(runs))


def close_ups_figure(data: IOData, run: np.ndarray, time: str = TIME) -> Figure:
    """The first upper and lower peak beside each other."""
    data, run = retrend(data), as_outputs(data, run)[:, 0] + data.y_offset[0]
    y, width, panels = output(data), _peak_width(data.y[:, 0]), list[Panel]()
    for title, sign in (("upper peak", 1.0), ("lower peak", -1.0)):
        centre = _first_peak(sign * data.y[:, 0])
        part = slice(max(0, centre - width), min(data.N, centre + width + 1))
        panel = over_panel(data.t[part], data.y[part, 0], {"free run": run[part]}, y, title)
        measured, model = panel.lines()
        items = [replace(measured, dots=True, key=bool(panels)), replace(model, key=bool(panels))]
        panels.append(replace(panel, items=items, x=Axis.time(time)))
    return Figure(panels, 2, shared=False, height=2.8, lettered=True)


def run_panel(run: Run, n: int | None = None, time: str = TIME, colour: str = style.MODEL) -> Panel:
    """Measured and model output as recorded, over the first n samples, by default all."""
    run = run.recorded()
    data, y = run.data, output(run.data)
    panel = over_panel(data.t, data.y[:, 0], {run.label: run.y}, y, run.title, colours=(colour,))
    short = [replace(line, x=line.x[:n], y=line.y[:n]) for line in panel.lines()]
    return replace(panel, items=short, x=Axis.time(time))


def over_panel(
    t: np.ndarray,
    measured: np.ndarray,
    models: Mapping[str, np.ndarray],
    y: Quantity,
    title: str = "",
    lengths: Sequence[int] = (),
    colours: Sequence[str] = style.COLOURS,
    measured_name: str = MEASURED,
) -> Panel:
    """A measured output (N,) and the runs (N,) of models over it; where one leaves it far, the axis is near it."""
    colours = [colours[k % len(colours)] for k in range(len(models))]
    items = [Line(t, scaled(measured, y.factor), measured_name, style.INK, lengths=lengths)]
    items += [
        Line(t, scaled(run, y.factor), name, colour, lengths=lengths)
        for (name, run), colour in zip(models.items(), colours, strict=True)
    ]
    away = any(departure(measured, run) is not None for run in models.values())
    near = frame(scaled(measured, y.factor)) if away else None
    return Panel(items, Axis.of(y, near=near), Axis.time(), title, 1.5)


def error_panel(
    t: np.ndarray,
    measured: np.ndarray,
    run: np.ndarray,
    y: Quantity,
    title: str,
    label: str = "error",
) -> Panel:
    """Measured output minus a run (N,)."""
    with np.errstate(invalid="ignore", over="ignore"):
        error = scaled(measured - run, y.factor)
    return Panel(
        [Line(t, error, label, style.SECOND, 0.9, key=False)], _error_axis(measured, [run], y), Axis.time(), title
    )


def _error_axis(measured: np.ndarray, runs: Sequence[np.ndarray], y: Quantity, alone: bool = True) -> Axis:
    """The axis of errors, with the name of an output that is not `alone`; where a run leaves the data far, it opens on
    as much as the data's own range.
    """
    error = replace(y, name="error" if alone else y.name)
    if all(departure(measured, run) is None for run in runs):
        return Axis.of(error)
    low, high = frame(scaled(measured, y.factor))
    return Axis.of(error, near=(0.5 * (low - high), 0.5 * (high - low)))


def runs_figure(
    data: IOData,
    models: Mapping[str, np.ndarray],
    measured: str = MEASURED,
    colours: Sequence[str] = style.COLOURS,
) -> Figure:
    """The outputs (N,) or (N, ny) of several models over one record, by name, with the errors and the inputs below.

    `measured` is the name of the record in the legend.
    """
    models = {name: as_outputs(data, run) + data.y_offset for name, run in models.items()}
    data = retrend(data)
    run_panels, error_panels, input_panels, sentences = list[Panel](), list[Panel](), list[Panel](), list[str]()
    model_name = next(iter(models)).partition(", fit")[0] if len(models) == 1 else "model"
    for c in channels(data):
        if c.is_input:
            line = Line(data.t, c.of(data), c.quantity.name, style.INPUT, steps=True, lengths=data.lengths, key=False)
            input_panels.append(Panel([line], Axis.of(c.quantity), Axis.time(), c.title, 0.6))
            continue
        y, runs = data.y[:, c.k], {name: run[:, c.k] for name, run in models.items()}
        observed = np.where(data.observed[:, c.k], y, np.nan)
        run_panels.append(over_panel(data.t, observed, runs, c.quantity, c.title, data.lengths, colours, measured))
        errors = [
            Line(data.t, scaled(y - run, c.quantity.factor), name, colour, 1.0, lengths=data.lengths, key=False)
            for (name, run), colour in zip(
                runs.items(), [line.colour for line in run_panels[-1].lines()[1:]], strict=True
            )
        ]
        axis = _error_axis(y, list(runs.values()), c.quantity, data.y.shape[1] == 1)
        error_panels.append(Panel(errors, axis, Axis.time(), f"error, {measured} minus {model_name}", 0.8))
        sentences += _departures(y, runs, data.Ts, c.quantity)
    panels, marks = [*run_panels, *error_panels, *input_panels], borders(data.lengths, data.Ts)
    return Figure(panels, height=0.9 + 1.6 * sum(p.weight for p in panels), lettered=True, marks=marks, said=sentences)


def _departures(measured: np.ndarray, runs: Mapping[str, np.ndarray], Ts: float, y: Quantity) -> list[str]:
    """A sentence for each run that leaves the data far."""
    departures = {name.partition(", fit")[0]: departure(measured, run) for name, run in runs.items()}
    return [away_run.sentence(name, Ts, y) for name, away_run in departures.items() if away_run is not None]


def output(data: IOData) -> Quantity:
    """Display of the output of a record."""
    return display_quantity(data.y_name, data.y_unit)


def as_outputs(data: IOData, run: np.ndarray) -> np.ndarray:
    """A free run in the shape of the output (N, ny); raises InputError for another number of samples."""
    if np.size(run) != data.y.size:
        raise InputError(f"run has {np.size(run)} values over an output of {data.y.size}; give one for each of them")
    return np.reshape(np.asarray(run, dtype=float), data.y.shape)


def _first_peak(y: np.ndarray) -> int:
    """Middle of the first segment in which y is in the top 15 % of its range, or in a larger part where there is none.

    A segment at an end of the record shows only a fall or a rise; it counts where there is no other.
    """
    for share in (0.15, 0.3, 0.45):
        high = np.concatenate([[False], y >= y.max() - share * np.ptp(y), [False]])
        starts, stops = np.flatnonzero(np.diff(high.astype(int)) == 1), np.flatnonzero(np.diff(high.astype(int)) == -1)
        complete = np.flatnonzero((starts > 0) & (stops < len(y)))
        if len(complete):
            break
    k = int(complete[0]) if len(complete) else 0
    return int(starts[k] + stops[k]) // 2


def _peak_width(y: np.ndarray) -> int:
    """Half window [samples] of a peak: the limited mean distance between crossings of the middle."""
    middle = 0.5 * (y.max() + y.min())
    crossings = max(int(np.sum(np.diff(y > middle) != 0)), 1)
    return int(np.clip(len(y) / crossings * 0.6, 15, max(15, len(y) // 4)))
