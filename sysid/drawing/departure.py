"""Whether a free run leaves the data, and the axis on which data and run are both seen.

No figure cuts off a run. A run that stays near the data gets a linear axis that holds all of it; one that leaves them
far gets an axis that is linear over the data and logarithmic beyond, or opens on the data.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from sysid.base import style
from sysid.base.quantities import Quantity, number
from sysid.base.style import power

if TYPE_CHECKING:
    from matplotlib.axes import Axes

FAR = 3.0  # widths of the data's range from its middle, beyond which a run has left the data; chosen by hand
AIR = 0.05  # of what is shown, above and below
LARGEST = 1e290  # value that an axis can carry; what is larger stands at its end


@dataclass(frozen=True)
class Departure:
    """A run that left the data: `sample` where it first did, `extreme` its value farthest from them, and the first
    sample that is not finite, None if all are."""

    sample: int
    extreme: float
    lost: int | None

    def sentence(self, subject: str, Ts: float, y: Quantity) -> str:
        """What happened, in display units, for a caption."""
        with np.errstate(over="ignore"):
            value = np.float64(self.extreme) * y.factor
        reach = f"{number(float(value), 2)} {y.unit}".rstrip()
        lost = "" if self.lost is None else f" From {self.lost * Ts:.4g} s on it is no finite number."
        return f"The {subject} leaves the data {self.sample * Ts:.4g} s after the start and reaches {reach}.{lost}"


def departure(measured: np.ndarray, model: np.ndarray) -> Departure | None:
    """Whether a run (N,) goes farther than FAR widths of the measured output (N,) from its middle; None if not."""
    low, high = float(np.nanmin(measured)), float(np.nanmax(measured))
    finite = np.isfinite(model)
    with np.errstate(invalid="ignore", over="ignore"):
        distance = np.where(finite, np.abs(model - 0.5 * (low + high)), np.inf)
    beyond = distance > FAR * ((high - low) or 1.0)
    if not beyond.any():
        return None
    finite_distance = np.where(finite, distance, -1.0)
    first_lost = None if finite.all() else int(np.argmin(finite))
    return Departure(int(np.argmax(beyond)), float(model[int(np.argmax(finite_distance))]), first_lost)


def frame(values: np.ndarray) -> tuple[float, float]:
    """Limits of a linear axis that holds every finite value, with air."""
    low, high = _ends(values)
    if not low <= high:
        return -1.0, 1.0
    width = (high - low) or 1.0
    return low - AIR * width, high + AIR * width


def _ends(*lines: np.ndarray) -> tuple[float, float]:
    """The smallest and largest finite value of the lines; infinite where there is none."""
    low = min(float(np.min(values, where=np.isfinite(values), initial=np.inf)) for values in lines)
    high = max(float(np.max(values, where=np.isfinite(values), initial=-np.inf)) for values in lines)
    return low, high


def spread_axis(ax: Axes, near: tuple[float, float], *lines: np.ndarray) -> None:
    """Set a vertical axis that shows the lines from end to end: linear over `near`, logarithmic beyond."""
    low, high = near
    bottom, top = _ends(*(np.clip(line, -LARGEST, LARGEST) for line in lines))
    scale = _Scale.for_data(low, high, bottom, top)
    ax.set_yscale("function", functions=(scale.squeeze, scale.stretch))
    ends = scale.squeeze(np.array([min(bottom, low), max(top, high)]))
    ax.set_ylim(*scale.stretch(ends + np.array([-1.0, 1.0]) * 0.03 * np.ptp(ends)))
    ax.set_yticks(*_ticks(low, high, bottom, top))
    note = "the axis is linear over the data and logarithmic beyond"
    ax.text(0.01, 0.96, note, transform=ax.transAxes, va="top", fontsize=7.5, color=style.SECOND)


@dataclass(frozen=True)
class _Scale:
    """Linear within `half` of `middle`, logarithmic beyond, where a decade is one `share` of the linear half."""

    middle: float
    half: float
    share: float

    @classmethod
    def for_data(cls, low: float, high: float, bottom: float, top: float) -> _Scale:
        """The data from low to high get half of the height if the run leaves them on one side, a third on two."""
        middle, half = 0.5 * (low + high), 0.5 * (high - low)
        decades = float(np.log10(max(abs(top - middle), abs(bottom - middle)) / half))
        return cls(middle, half, 2.0 / max(decades, 2.0))

    def squeeze(self, y: np.ndarray) -> np.ndarray:
        """From values to places on the axis."""
        s = (np.asarray(y, dtype=float) - self.middle) / self.half
        size = np.abs(s)
        return np.where(size <= 1.0, s, np.sign(s) * (1.0 + self.share * np.log10(np.maximum(size, 1.0))))

    def stretch(self, s: np.ndarray) -> np.ndarray:
        """The inverse."""
        s = np.asarray(s, dtype=float)
        size = np.abs(s)
        decades = np.minimum(np.maximum(size - 1.0, 0.0) / self.share, 300.0)
        return self.middle + self.half * np.where(size <= 1.0, s, np.sign(s) * np.power(10.0, decades))


def _ticks(low: float, high: float, bottom: float, top: float) -> tuple[list[float], list[str]]:
    """Round numbers over the data, and a few powers of ten beyond."""
    from matplotlib.ticker import MaxNLocator

    inner = [float(v) for v in MaxNLocator(3).tick_values(low, high) if low <= v <= high]
    outer: list[float] = []
    for sign, end in ((-1.0, -bottom), (1.0, top)):
        first = np.ceil(np.log10(max(abs(low), abs(high)))) + 1.0
        last = np.floor(np.log10(end)) if end > 0 else -np.inf
        if last >= first:
            step = max(1.0, np.ceil((last - first + 1.0) / 3.0))
            outer += [sign * 10.0**k for k in np.arange(last, first - 0.5, -step)]
    ticks = sorted([*inner, *outer])
    return ticks, [power(t) for t in ticks]
