"""Whether a free run leaves the data, and the axis on which data and run are both seen.

No figure cuts off a run. A run that stays near the data gets a linear axis that holds all of it; one that leaves them
far gets an axis that is linear over the data and logarithmic beyond.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from sysid.base.units import Quantity, number

if TYPE_CHECKING:
    from matplotlib.axes import Axes

FAR = 3.0  # widths of the data's range from its middle, beyond which a run has left the data
AIR = 0.05  # of what is shown, above and below


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
        away = np.where(finite, np.abs(model - 0.5 * (low + high)), np.inf)
    beyond = away > FAR * ((high - low) or 1.0)
    if not beyond.any():
        return None
    known = np.where(finite, away, -1.0)
    lost = None if finite.all() else int(np.argmin(finite))
    return Departure(int(np.argmax(beyond)), float(model[int(np.argmax(known))]), lost)


def frame(*lines: np.ndarray) -> tuple[float, float]:
    """Limits of a linear axis that holds every finite value of the lines, with air."""
    low = min(float(np.min(each, where=np.isfinite(each), initial=np.inf)) for each in lines)
    high = max(float(np.max(each, where=np.isfinite(each), initial=-np.inf)) for each in lines)
    if not low <= high:
        return -1.0, 1.0
    width = (high - low) or 1.0
    return low - AIR * width, high + AIR * width


def frame_all(ax: Axes, measured: np.ndarray, model: np.ndarray) -> None:
    """Set a vertical axis that shows both lines (N,), in the units of the axis, from end to end."""
    low, high = frame(measured)
    if departure(measured, model) is None:
        ax.set_ylim(frame(measured, model))
        return
    middle, half = 0.5 * (low + high), 0.5 * (high - low)
    ax.set_yscale("function", functions=(lambda y: _squeeze(y, middle, half), lambda s: _stretch(s, middle, half)))
    bottom, top = frame(measured, _clipped(model))
    ends = _squeeze(np.array([min(bottom, low), max(top, high)]), middle, half)
    ax.set_ylim(*_stretch(ends + np.array([-0.2, 0.2]), middle, half))
    ax.set_yticks(*_ticks(low, high, *ax.get_ylim()))


def _clipped(model: np.ndarray) -> np.ndarray:
    """Values that an axis can carry; what is larger stands at its end."""
    return np.clip(model, -1e290, 1e290)


_LINEAR = 4.0  # height of half the data's range, in decades of what lies beyond it


def _squeeze(y: np.ndarray, middle: float, half: float) -> np.ndarray:
    """Linear over the data's range, logarithmic beyond."""
    s = (np.asarray(y, dtype=float) - middle) / half
    size = np.abs(s)
    return _LINEAR * np.where(size <= 1.0, s, np.sign(s) * (1.0 + np.log10(np.maximum(size, 1.0)) / _LINEAR))


def _stretch(s: np.ndarray, middle: float, half: float) -> np.ndarray:
    """The inverse of `_squeeze`."""
    s = np.asarray(s, dtype=float) / _LINEAR
    size = np.abs(s)
    beyond = np.power(10.0, np.minimum(_LINEAR * np.maximum(size - 1.0, 0.0), 300.0))
    return middle + half * np.where(size <= 1.0, s, np.sign(s) * beyond)


def _ticks(low: float, high: float, bottom: float, top: float) -> tuple[list[float], list[str]]:
    """Round numbers over the data, and a few powers of ten beyond."""
    from matplotlib.ticker import MaxNLocator

    inner = [float(v) for v in MaxNLocator(3).tick_values(low, high) if low <= v <= high]
    outer: list[float] = []
    for sign, end in ((-1.0, -bottom), (1.0, top)):
        first = np.ceil(np.log10(max(abs(low), abs(high)))) + 1.0
        last = np.floor(np.log10(end)) if end > 0 else -np.inf
        if last >= first:
            step = max(1.0, np.ceil((last - first + 1.0) / 4.0))
            outer += [sign * 10.0**k for k in np.arange(last, first - 0.5, -step)]
    ticks = sorted([*inner, *outer])
    return ticks, [f"{t:.0e}".replace("e+", "e").replace("-", "−") if t in outer else f"{t:g}" for t in ticks]
