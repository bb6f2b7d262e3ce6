"""One look for every figure, and the one place where a figure becomes a PNG."""

from __future__ import annotations

import io
from collections.abc import Callable, Sequence
from functools import wraps
from itertools import pairwise
from typing import TYPE_CHECKING, Any, ParamSpec, TypeVar

import numpy as np

from sysid.base.errors import InputError

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

P = ParamSpec("P")
R = TypeVar("R")

INK = "#1f2933"  # measured data, text
MODEL = "#c2410c"  # the model's free run
INPUT = "#2f6f8f"
SECOND = "#7a8794"  # bounds, references, the part that is not looked at
BOUND = "#dbe7ee"  # the area within which nothing is to be seen

RC: Any = {
    "font.family": "sans-serif",
    "font.sans-serif": ["DejaVu Sans"],  # travels with matplotlib: the same letters on every machine
    "font.size": 9.0,
    "axes.titlesize": 9.5,
    "axes.titlelocation": "left",
    "axes.titleweight": "bold",
    "axes.titlecolor": INK,
    "axes.labelcolor": INK,
    "axes.edgecolor": "#9aa5b1",
    "axes.linewidth": 0.8,
    "axes.grid": True,
    "axes.axisbelow": True,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "grid.color": "#e4e7eb",
    "grid.linewidth": 0.7,
    "xtick.color": "#52606d",
    "ytick.color": "#52606d",
    "legend.frameon": False,
    "legend.fontsize": 8.5,
    "lines.linewidth": 1.3,
    "lines.solid_capstyle": "round",
    "figure.facecolor": "white",
    "agg.path.chunksize": 20000,
}
WIDTH = 8.0  # [inch]
DPI = 125
POINTS = 4000  # a line gets at most about this many: more than the picture has pixels


def styled(draw: Callable[P, R]) -> Callable[P, R]:
    """Runs a function that draws a figure in the house style, and leaves matplotlib's own settings as they were."""

    @wraps(draw)
    def drawn(*args: P.args, **kwargs: P.kwargs) -> R:
        from matplotlib import rc_context

        with rc_context(RC):
            return draw(*args, **kwargs)

    return drawn


def sheet(rows: int = 1, columns: int = 1, height: float = 2.6, sharex: bool = False) -> tuple[Figure, np.ndarray]:
    """An empty figure and its axes (rows, columns); for use inside a `styled` function."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(WIDTH, height), layout="constrained")
    return figure, figure.subplots(rows, columns, sharex=sharex, squeeze=False)


def panels(
    axes: Axes | Sequence[Axes] | None, rows: int = 1, columns: int = 1, height: float = 2.6, sharex: bool = False
) -> list[Axes]:
    """The given axes, or those of a new sheet, row by row; raises InputError where not as many as panels are given."""
    if axes is None:
        return list(sheet(rows, columns, height, sharex)[1].ravel())
    given = list(axes) if isinstance(axes, Sequence | np.ndarray) else [axes]
    if len(given) != rows * columns:
        raise InputError(f"{len(given)} axes are given and there are {rows * columns} panels; give one for each")
    return given


def png(drawn: Figure | Axes | Sequence[Axes]) -> bytes:
    """A figure, or the one in which these axes stand, as PNG."""
    from matplotlib import rc_context
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    figure: Any = drawn[0] if isinstance(drawn, Sequence) else drawn
    if not hasattr(figure, "savefig"):
        figure = figure.figure
    buffer = io.BytesIO()
    with rc_context(RC):
        FigureCanvasAgg(figure)
        figure.savefig(buffer, format="png", dpi=DPI)
    return buffer.getvalue()


def image_png(rgb: np.ndarray) -> bytes:
    """An image (height, width, 3) of uint8 as PNG."""
    from matplotlib.image import imsave

    buffer = io.BytesIO()
    imsave(buffer, rgb, format="png")
    return buffer.getvalue()


def line(axes: Axes, x: np.ndarray, y: np.ndarray, steps: bool = False, **kwargs) -> None:
    """A line with no more points than can be seen: for long records the extremes of each bin, so no peak is lost."""
    x, y = thin(np.asarray(x), np.asarray(y))
    axes.plot(x, y, drawstyle="steps-post" if steps else "default", **kwargs)


def thin(x: np.ndarray, y: np.ndarray, points: int = POINTS) -> tuple[np.ndarray, np.ndarray]:
    """x and y (n,) reduced to the smallest and largest finite y of each of points / 2 bins; a short line as it is.

    A bin with a value that is not finite keeps the first of these too, so that a gap stays a gap.
    """
    n = len(x)
    if n <= points:
        return x, y
    edges = np.linspace(0, n, points // 2 + 1).astype(int)
    lost = ~np.isfinite(y)
    low, high = np.where(lost, np.inf, y), np.where(lost, -np.inf, y)
    keep = [(a + np.argmin(low[a:b]), a + np.argmax(high[a:b])) for a, b in pairwise(edges)]
    gaps = [a + np.argmax(lost[a:b]) for a, b in pairwise(edges) if lost[a:b].any()] if lost.any() else []
    chosen = np.unique([*np.ravel(keep), *gaps]).astype(int)
    return x[chosen], y[chosen]


def legend(axes: Axes, **kwargs) -> None:
    """A legend above the axes on the right, where it covers no data."""
    axes.legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=4, borderaxespad=0.1, handlelength=1.6, **kwargs)
