"""Close-ups of the first peaks of a record with a free-run simulation."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from sysid.base import style
from sysid.base.checks import checked
from sysid.base.style import styled
from sysid.data.preprocess import retrend
from sysid.data.record import IOData
from sysid.plots._departure import frame_all
from sysid.plots._runs import output, over

if TYPE_CHECKING:
    from matplotlib.axes import Axes


@checked(own=("axes", "run"))
@styled
def close_ups(data: IOData, run: np.ndarray, axes: Sequence[Axes] | None = None, time: str = "time [s]") -> list[Axes]:
    """The first whole upper and lower peak of the measured output, with the free run (N,) over it.

    `time` labels the axis.
    """
    data, run = retrend(data), over(data, run)[:, 0] + data.y_offset[0]
    y, width, both = output(data), _peak_width(data.y[:, 0]), style.panels(axes, 1, 2, height=2.8)
    for ax, title, sign in ((both[0], "(a) upper peak", 1.0), (both[1], "(b) lower peak", -1.0)):
        centre = _first_peak(sign * data.y[:, 0])
        a, b = max(0, centre - width), min(data.N, centre + width + 1)
        # More dots than that would only make the line fat.
        dots: dict[str, Any] = {"marker": ".", "markersize": 3} if b - a < 200 else {}
        ax.plot(data.t[a:b], data.y[a:b, 0] * y.factor, color=style.INK, label="measured", **dots)
        ax.plot(data.t[a:b], run[a:b] * y.factor, color=style.MODEL, label="free run")
        ax.set(title=title, xlabel=time, ylabel=y.label)
        frame_all(ax, data.y[a:b, 0] * y.factor, run[a:b] * y.factor)
    style.legend(both[1])
    return both


def _first_peak(y: np.ndarray) -> int:
    """Middle of the first segment in which y is in the top 15 % of its range.

    A segment at an end of the record shows only a fall or a rise; it counts where there is no other.
    """
    high = np.concatenate([[False], y >= y.max() - 0.15 * np.ptp(y), [False]])
    starts, stops = np.flatnonzero(np.diff(high.astype(int)) == 1), np.flatnonzero(np.diff(high.astype(int)) == -1)
    whole = np.flatnonzero((starts > 0) & (stops < len(y)))
    k = int(whole[0]) if len(whole) else 0
    return int(starts[k] + stops[k]) // 2


def _peak_width(y: np.ndarray) -> int:
    """Half window [samples] of a peak: the limited mean distance between crossings of the middle."""
    middle = 0.5 * (y.max() + y.min())
    crossings = max(int(np.sum(np.diff(y > middle) != 0)), 1)
    return int(np.clip(len(y) / crossings * 0.6, 15, max(15, len(y) // 4)))
