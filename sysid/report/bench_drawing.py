"""A bad cell of the benchmark drawn: input, measured output with the free run over it, and the error."""

from typing import Any

import numpy as np

from sysid.base import style
from sysid.bench.redraw import Redrawn

SHOWN = 600  # samples around the largest error: a long record would be a black band
_ABOVE: Any = {"loc": "lower right", "bbox_to_anchor": (1.0, 0.97), "ncols": 2, "borderaxespad": 0.0}


@style.styled
def draw(cell: Redrawn) -> bytes:
    """A PNG of the stretch around the largest error."""
    from matplotlib.figure import Figure

    error = np.where(np.isfinite(cell.run), cell.y - cell.run, np.nan)
    k = int(np.nanargmax(np.abs(error[cell.drop :]))) + cell.drop if np.isfinite(error[cell.drop :]).any() else 0
    start = max(0, min(k - SHOWN // 2, len(cell.y) - SHOWN))
    part = slice(start, start + SHOWN)
    t = np.arange(len(cell.y))[part] * cell.Ts
    unit = f" [{cell.unit}]" if cell.unit not in ("", "1") else ""
    figure = Figure(figsize=(style.WIDTH, 4.6), layout="constrained")
    top, middle, low = figure.subplots(3, 1, sharex=True, height_ratios=(1, 2.2, 1.2))
    top.plot(t, cell.u[part], color=style.INPUT)
    top.set_ylabel("input")
    middle.plot(t, cell.y[part], color=style.INK, label="measured")
    middle.plot(t, cell.run[part], color=style.MODEL, label=f"free run of {cell.method}")
    # A run that diverges must not flatten the measured output.
    middle.set_ylim(*_room(cell.y))
    middle.set_ylabel(f"output{unit}")
    middle.legend(**_ABOVE)
    low.plot(t, error[part], color=style.MODEL, label="measured less free run")
    if cell.clean is not None:
        low.plot(t, (cell.y - cell.clean)[part], color=style.SECOND, label="noise")
    low.set_ylabel(f"error{unit}")
    low.set_xlabel("time in the test [s]")
    low.legend(**_ABOVE)
    return style.png(middle)


def _room(y: np.ndarray) -> tuple[float, float]:
    low, high = float(np.nanmin(y)), float(np.nanmax(y))
    spare = 0.3 * (high - low) or 1.0
    return low - spare, high + spare
