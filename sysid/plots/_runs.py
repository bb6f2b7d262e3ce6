"""A model's output over a record, drawn alike wherever it is shown."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from sysid.base import style
from sysid.base.units import Quantity, percent, shown
from sysid.data.record import IOData

if TYPE_CHECKING:
    from matplotlib.axes import Axes


@dataclass(frozen=True)
class Run:
    """What a model gives over a record: output y (N,) on the scale of `data`, its fit [%], and what it is called."""

    data: IOData
    y: np.ndarray
    fit: float
    title: str = ""
    what: str = "free run"

    @property
    def label(self) -> str:
        """For a legend: what it is and how well it fits."""
        return f"{self.what}, fit {percent(self.fit)}"


def output(data: IOData) -> Quantity:
    """How the output of a record is shown."""
    return shown(data.y_name, data.y_unit)


def draw(ax: Axes, run: Run, n: int | None = None, colour: str = style.MODEL) -> None:
    """Measured output and the model's over the first n samples, by default over all; a legend above."""
    data, y = run.data, output(run.data)
    style.line(ax, data.t[:n], data.y[:n, 0] * y.factor, color=style.INK, label="measured")
    style.line(ax, data.t[:n], run.y[:n] * y.factor, color=colour, label=run.label)
    ax.set(title=run.title, ylabel=y.label, ylim=frame(data.y[:, 0] * y.factor, run.y * y.factor))
    ax.margins(x=0.005)
    style.legend(ax)


def frame(measured: np.ndarray, model: np.ndarray) -> tuple[float, float]:
    """Ends of a vertical axis: a model that runs away leaves the frame instead of flattening the data."""
    low, high = float(np.nanmin(measured)), float(np.nanmax(measured))
    width = high - low or 1.0
    pad, air = 0.35 * width, 0.1175 * width
    bottom, top = min(low, float(np.nanmin(model))), max(high, float(np.nanmax(model)))
    return max(low - pad, bottom - air), min(high + pad, top + air)


def first(data: IOData, seconds: float | None) -> int:
    """How many samples the first `seconds` [s] hold: two at least, all where it is None."""
    return data.N if seconds is None else min(data.N, max(2, round(seconds / data.Ts)))
