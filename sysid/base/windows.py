"""Figures that a person asked for: pyplot's where it is loaded, and pictures in a notebook.

A report makes many figures and turns each into a PNG at once; pyplot would keep all of them open. So a figure belongs
to pyplot only inside `for_a_person`, which `data.plot()` and its like use. A notebook shows the figure that a cell
returns, and would show one of pyplot's a second time; there, and in a script without pyplot, it is a figure of its own.
"""

from __future__ import annotations

import io
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from functools import cache
from typing import TYPE_CHECKING, Any

from sysid.base.looks import house_look, load
from sysid.base.titles import make_room

if TYPE_CHECKING:
    from matplotlib.figure import Figure

DPI = 125
_ASKED = ContextVar("asked for by a person", default=False)


@contextmanager
def for_a_person() -> Iterator[None]:
    """Within it, new figures are pyplot's where pyplot is loaded, so that `plt.show()` finds them."""
    token = _ASKED.set(True)
    try:
        yield
    finally:
        _ASKED.reset(token)


def new_figure(**options: Any) -> Figure:
    """An empty figure; `options` are matplotlib's."""
    load()
    from matplotlib import figure

    if not _ASKED.get():
        return figure.Figure(**options)
    pyplot = sys.modules.get("matplotlib.pyplot")
    if pyplot is None or "inline" in pyplot.get_backend().lower():
        return _sheet()(**options)
    made: Figure = pyplot.figure(FigureClass=_sheet(), **options)
    return made


@cache
def _sheet() -> type[Figure]:
    """A Figure that a notebook shows without pyplot; made on first use, for matplotlib is imported by what draws."""
    from matplotlib.figure import Figure

    def picture(self: Figure) -> bytes:
        buffer = io.BytesIO()
        with house_look():
            make_room(self)
            self.savefig(buffer, format="png", dpi=DPI)  # through the canvas that it has: a window stays one
        return buffer.getvalue()

    body = {"_repr_png_": picture, "__module__": __name__, "__doc__": "A figure that shows itself in a notebook."}
    return type("Sheet", (Figure,), body)


def __getattr__(name: str) -> Any:
    """`Sheet` by its name, so that a figure can be pickled."""
    if name == "Sheet":
        return _sheet()
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
