"""One look for every figure, the logarithmic axes, and the one place where a figure becomes a PNG.

Numbers on a logarithmic axis are plain text. Matplotlib writes powers of ten as formulas, and figures of ours show no
formula: a channel may be called $_{.
"""

from __future__ import annotations

import io
import re
from collections.abc import Callable, Sequence
from functools import cache, wraps
from itertools import pairwise
from typing import TYPE_CHECKING, Any, ParamSpec, TypeVar

import numpy as np

from sysid.base.errors import InputError
from sysid.base.looks import DPI, house_look, new_figure
from sysid.base.titles import legend_above, make_room

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
COLOURS = (MODEL, INPUT, "#2f855a", "#805ad5", "#b7791f", "#d53f8c")  # of several models or channels

WIDTH = 8.0  # [inch]
_UNNAMED = re.compile(r"_child\d+$|_nolegend_$|_container\d+$|_nolabel_$|_collection\d+$|_line\d+$")  # matplotlib's own
LONGEST = 120  # letters of a line of a label
POINTS = 4000  # a line gets at most about this many: more than the picture has pixels


def styled(draw: Callable[P, R]) -> Callable[P, R]:
    """Runs a function that draws a figure in the house style, and leaves matplotlib's own settings as they were."""

    @wraps(draw)
    def drawn(*args: P.args, **kwargs: P.kwargs) -> R:
        with house_look():
            return draw(*args, **kwargs)

    return drawn


def sheet(
    rows: int = 1,
    columns: int = 1,
    height: float = 2.6,
    sharex: bool = False,
    ratios: Sequence[float] | None = None,
) -> tuple[Figure, np.ndarray]:
    """An empty figure and its axes (rows, columns) with `ratios` of their heights; for use inside `styled`."""
    figure = new_figure(figsize=(WIDTH, height), layout="constrained")
    return figure, figure.subplots(rows, columns, sharex=sharex, squeeze=False, height_ratios=ratios)


def panels(
    axes: Axes | Sequence[Axes] | None,
    rows: int = 1,
    columns: int = 1,
    height: float = 2.6,
    sharex: bool = False,
    ratios: Sequence[float] | None = None,
    count: int | None = None,
) -> list[Axes]:
    """The given axes, or those of a new sheet, row by row, `count` of them where that is given.

    Raises InputError where not as many as panels are given.
    """
    count = rows * columns if count is None else count
    if count < 1:
        raise InputError("nothing is given to draw; give at least one curve or run")
    if axes is None:
        sheets = list(sheet(rows, columns, height, sharex, ratios)[1].ravel())
        for spare in sheets[count:]:
            spare.remove()
        return sheets[:count]
    given = list(axes) if isinstance(axes, Sequence | np.ndarray) else [axes]
    if len(given) != count:
        raise InputError(f"{len(given)} axes are given and there are {count} panels; give one for each")
    for each in given:
        if not hasattr(each, "get_figure"):
            raise InputError(f"an entry of axes is a {type(each).__name__}; give Axes of matplotlib, or leave axes out")
    return given


def png(drawn: Figure | Axes | Sequence[Axes], few: bool = False) -> bytes:
    """A figure, or the one in which these axes stand, as PNG; one of `few` colours in a third of the bytes."""
    with house_look():
        from matplotlib.backends.backend_agg import FigureCanvasAgg
        from PIL import Image

    figure: Any = drawn[0] if isinstance(drawn, Sequence) else drawn
    if not hasattr(figure, "savefig"):
        figure = figure.figure
    buffer = io.BytesIO()
    with house_look():
        _shorten(figure)
        canvas, dpi = FigureCanvasAgg(figure), figure.dpi
        make_room(figure)
        figure.set_dpi(DPI)
        try:
            canvas.draw()  # savefig would draw twice: once for the layout
            pixels = Image.fromarray(np.asarray(canvas.buffer_rgba()))
            pixels = pixels.convert("RGB").quantize(method=Image.Quantize.FASTOCTREE) if few else pixels  # 256
            pixels.save(buffer, format="png", dpi=(DPI, DPI))
        finally:
            figure.set_dpi(dpi)
    return buffer.getvalue()


def _shorten(figure: Any) -> None:
    """Labels that are too long for a figure lose their end: a channel may have a name of hundreds of letters."""
    for axes in figure.axes:
        legend = axes.get_legend()
        words = [axes.title, axes._left_title, axes._right_title, axes.xaxis.label, axes.yaxis.label]
        for text in [*words, *(legend.get_texts() if legend is not None else ())]:
            if max(map(len, text.get_text().split("\n"))) > LONGEST:
                text.set_text("\n".join(_short(line) for line in text.get_text().split("\n")))


def _short(words: str) -> str:
    return words if len(words) <= LONGEST else f"{words[: LONGEST - 1]}…"


def image_png(rgb: np.ndarray) -> bytes:
    """An image (height, width, 3) of uint8 as PNG."""
    buffer = io.BytesIO()
    with house_look():
        from matplotlib.image import imsave

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
    for artist in axes.get_children():
        name = str(artist.get_label())
        if name.startswith("_") and not _UNNAMED.match(name):  # a channel: matplotlib hides what begins so
            artist.set_label(f"\u200b{name}")
    handles, labels = axes.get_legend_handles_labels()
    once = dict(zip(reversed(labels), reversed(handles), strict=True))  # each name once, with its first handle
    names = list(dict.fromkeys(labels))
    legend_above(axes, [once[name] for name in names], names, **kwargs)


def log_axis(axes: Axes, which: str = "xy") -> None:
    """Makes the axes named in `which`, "x", "y" or "xy", logarithmic."""
    formatter = _formatter()
    for each, scaled in (("x", axes.set_xscale), ("y", axes.set_yscale)):
        if each not in which:
            continue
        scaled("log")
        axis = axes.xaxis if each == "x" else axes.yaxis
        axis.set_major_formatter(formatter())
        axis.set_minor_formatter(formatter(minor_thresholds=(1.0, 0.4)))


def power(value: float) -> str:
    """A number at a tick: 0.1, 20, 1000, and 1e5 or 2e−4 where zeros would have to be counted."""
    text = f"{value:g}"
    if value and not 1e-3 * (1 - 1e-9) <= abs(value) < 1e5:
        mantissa, exponent = f"{value:.3e}".split("e")
        text = f"{mantissa.rstrip('0').rstrip('.')}e{int(exponent)}"
    return text.replace("-", "−")


@cache
def _formatter() -> Any:
    from matplotlib.ticker import LogFormatter

    class Plain(LogFormatter):
        """Matplotlib chooses which ticks have a number, as it does for a formula."""

        def __call__(self, x, pos=None):
            return power(x) if super().__call__(x, pos) else ""

    return Plain
