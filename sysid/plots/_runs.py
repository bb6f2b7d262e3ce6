"""A model's output over a record, drawn in the same way in all figures."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from sysid.base import style
from sysid.base.errors import InputError
from sysid.base.units import Quantity, percent, shown
from sysid.data.preprocess import retrend
from sysid.data.record import IOData
from sysid.plots._departure import frame_all

if TYPE_CHECKING:
    from matplotlib.axes import Axes


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


def output(data: IOData) -> Quantity:
    """Display of the output of a record."""
    return shown(data.y_name, data.y_unit)


def draw(ax: Axes, run: Run, n: int | None = None, colour: str = style.MODEL) -> None:
    """Measured and model output as recorded, over the first n samples, by default all, with a legend above."""
    run = run.recorded()
    data, y = run.data, output(run.data)
    style.line(ax, data.t[:n], data.y[:n, 0] * y.factor, color=style.INK, label="measured")
    style.line(ax, data.t[:n], run.y[:n] * y.factor, color=colour, label=run.label)
    ax.set(title=run.title, ylabel=y.label)
    frame_all(ax, data.y[:, 0] * y.factor, run.y * y.factor)
    ax.margins(x=0.005)
    style.legend(ax)


def first(data: IOData, seconds: float | None) -> int:
    """Number of samples in the first `seconds` [s]: at least two; all if None."""
    return data.N if seconds is None or seconds >= data.N * data.Ts else max(2, round(seconds / data.Ts))


def over(data: IOData, run: np.ndarray) -> np.ndarray:
    """A free run in the shape of the output (N, ny); raises InputError for another number of samples."""
    if np.size(run) != data.y.size:
        raise InputError(f"run has {np.size(run)} values over an output of {data.y.size}; give one for each of them")
    return np.reshape(run, data.y.shape)
