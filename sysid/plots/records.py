"""A record over time: as recorded, split into estimation and validation data, or any signals over one time axis."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from sysid.base import style
from sysid.base.checks import checked
from sysid.base.quantities import Quantity, Units, display_quantity, unit_of_channel
from sysid.data.preprocess import retrend
from sysid.data.record import IOData
from sysid.drawing.axes import draw
from sysid.drawing.figure import Axis, Figure, Item, Line, Panel, Points, Rule, borders, scaled

if TYPE_CHECKING:
    from matplotlib.axes import Axes

FILLED = "filled"


@checked(deferred=("axes",))
def record(data: IOData, axes: Sequence[Axes] | None = None, seconds: float | None = None) -> list[Axes]:
    """Inputs over outputs as recorded, with removed means restored, for the first `seconds` [s] or all samples.

    A panel for each channel; a dotted line is the border of two experiments.
    """
    return draw(record_figure(data, seconds), axes)


@checked(deferred=("axes",))
def parts(estimation: IOData, validation: IOData, axes: Sequence[Axes] | None = None) -> list[Axes]:
    """Input over output with the two parts marked; constants that were removed are added again."""
    return draw(parts_figure(estimation, validation), axes)


def record_figure(data: IOData, seconds: float | None = None) -> Figure:
    """A panel for each input and output, as recorded."""
    n = first(data, seconds)
    original, lengths = retrend(data), _lengths(data, n)
    panels = [
        Panel(
            [_line(original, c, 0.0, c.quantity.name, c.colour, lengths, key=False)],
            Axis.of(c.quantity),
            Axis.time(),
            c.title,
        )
        for c in channels(data)
    ]
    marks = [rule for rule in borders(data.lengths, data.Ts) if rule.at < n * data.Ts]
    return Figure(panels, height=0.8 + 1.4 * len(panels), lettered=True, marks=marks)


def parts_figure(estimation: IOData, validation: IOData | None) -> Figure:
    """A panel for each channel, the estimation part before the validation part, if there is one."""
    start, marks = estimation.N * estimation.Ts, borders(estimation.lengths, estimation.Ts)
    halves = [(retrend(estimation), 0.0, "estimation", style.INK)]
    if validation is not None:
        marks += [Rule(start - 0.5 * estimation.Ts), *borders(validation.lengths, validation.Ts, start)]
        halves += [(retrend(validation), start, "validation", style.INPUT)]
    panels = [
        Panel(
            [_line(data, c, t0, name, colour, data.lengths) for data, t0, name, colour in halves],
            Axis.of(c.quantity),
            Axis.time(),
            c.title,
        )
        for c in channels(estimation)
    ]
    return Figure(panels, height=3.6 + 1.4 * (len(panels) - 2), lettered=True, marks=marks)


def lines_figure(
    t: np.ndarray, signals: Mapping[str, np.ndarray], name: str, unit: str = "", title: str = ""
) -> Figure:
    """Signals (N,) of one kind over time t (N,) [s] in one panel, by name; `name` and `unit` label the axis."""
    quantity, colours = display_quantity(name, unit), (style.INK, *style.COLOURS)
    items = [
        Line(t, scaled(y, quantity.factor), label, colours[k % len(colours)], key=len(signals) > 1)
        for k, (label, y) in enumerate(signals.items())
    ]
    return Figure([Panel(items, Axis.of(quantity), Axis.time(), title, 1.3)])


@dataclass(frozen=True)
class Signal:
    """Values (N,) in the stored unit of `quantity`, with a title; `steps` for a value that is held between samples."""

    quantity: Quantity
    values: np.ndarray
    title: str = ""
    colour: str = style.INK
    steps: bool = False


def stack_figure(
    t: np.ndarray, signals: Sequence[Signal], dotted: np.ndarray | None = None, mark: str = FILLED
) -> Figure:
    """Any signals over one time axis t (N,) [s], one panel each; samples `marked` (N,) get a dot named `mark`."""
    panels = list[Panel]()
    for signal in signals:
        values = scaled(signal.values, signal.quantity.factor)
        items: list[Item] = [Line(t, values, signal.quantity.name, signal.colour, steps=signal.steps, key=False)]
        if dotted is not None and dotted.any():
            items.append(Points(t[dotted], values[dotted], mark))
        panels.append(Panel(items, Axis.of(signal.quantity), Axis.time(), signal.title))
    return Figure(panels, height=0.6 + 1.5 * len(panels), lettered=True)


@dataclass(frozen=True)
class Channel:
    """An input or an output of a record: its place `k`, how it is shown, and its title in a figure."""

    is_input: bool
    k: int
    quantity: Quantity
    title: str

    @property
    def colour(self) -> str:
        """That of an input, or of what was measured."""
        return style.INPUT if self.is_input else style.INK

    def of(self, data: IOData) -> np.ndarray:
        """Its samples (N,) in display units."""
        return scaled((data.u if self.is_input else data.y)[:, self.k], self.quantity.factor)


def channels(data: IOData) -> list[Channel]:
    """Every input, then every output."""
    return [
        Channel(is_input, k, quantity, title + (f" {k + 1}" if n > 1 else ""))
        for is_input, title, name, unit, n in (
            (True, "input", data.u_name, data.u_unit, data.u.shape[1]),
            (False, "output", data.y_name, data.y_unit, data.y.shape[1]),
        )
        for k, quantity in enumerate(_quantities(name, unit, n))
    ]


def first(data: IOData, seconds: float | None) -> int:
    """Number of samples in the first `seconds` [s]: at least two; all if None."""
    return data.N if seconds is None or seconds >= data.N * data.Ts else max(2, round(seconds / data.Ts))


def _lengths(data: IOData, n: int) -> list[int]:
    """The lengths of the experiments among the first n samples."""
    ends = np.minimum(np.cumsum([0, *data.lengths]), n)
    return [int(length) for length in np.diff(ends) if length]


def _line(
    data: IOData, channel: Channel, start: float, name: str, colour: str, lengths: Sequence[int], key: bool = True
) -> Line:
    """A channel over time, from `start` [s], over as many samples as `lengths` has."""
    n = sum(lengths)
    t, y = start + data.t[:n], channel.of(data)[:n]
    return Line(t, y, name, colour, steps=channel.is_input, lengths=lengths, key=key)


def _quantities(name: str | Sequence[str], unit: str | Sequence[str], n: int) -> list[Quantity]:
    """One quantity for each of n channels; a single name is numbered, a list in one string is taken apart."""
    names, units = (_split_text(text, n) for text in (name, unit))
    if n > 1 and len(set(names)) == 1:
        names = [f"{names[0]}{k + 1}" for k in range(n)]
    return [display_quantity(*pair) for pair in zip(names, units, strict=True)]


def _split_text(text: str | Sequence[str], n: int) -> list[str]:
    if n == 1 and isinstance(text, str):  # as it is: a unit may know that of its file
        return [text]
    if isinstance(text, Units):
        return [unit_of_channel(text, k) for k in range(n)]
    parts = [part.strip() for part in text.split(",")] if isinstance(text, str) else list(text)
    return parts if len(parts) == n else [text if isinstance(text, str) else ", ".join(text)] * n
