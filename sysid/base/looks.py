"""Figures under our own settings: matplotlib's defaults with the house style over them, whatever a user's own are.

A `matplotlibrc` with usetex, other fonts or another backend, or a variable such as MPLBACKEND with odd content, is for
the user's own figures. It must not change ours, and no result may be lost because a picture could not be drawn.

A report makes many figures and turns each into a PNG at once; pyplot would keep all of them open. So a figure belongs
to pyplot only inside `for_a_person`, which `data.plot()` and its like use. A notebook shows the figure that a cell
returns, and would show one of pyplot's a second time; there, and in a script without pyplot, it is a figure of its own.
"""

from __future__ import annotations

import io
import os
import sys
import warnings
from collections.abc import Iterator
from contextlib import contextmanager, nullcontext, suppress
from contextvars import ContextVar
from functools import cache
from importlib.util import find_spec
from pathlib import Path
from threading import RLock
from typing import TYPE_CHECKING, Any

from sysid.base.titles import make_room

if TYPE_CHECKING:
    from matplotlib.figure import Figure

RC: Any = {
    "font.family": "sans-serif",
    "font.sans-serif": ["DejaVu Sans"],  # travels with matplotlib: the same letters on every machine
    "font.size": 9.0,
    "text.parse_math": False,  # a channel may be called $_{: names are shown as they are
    "axes.titlesize": 9.5,
    "axes.titlelocation": "left",
    "axes.titleweight": "bold",
    "axes.titlecolor": "#1f2933",
    "axes.labelcolor": "#1f2933",
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
# What is no look: how windows behave stays as the user has set it.
_KEPT: tuple[str, ...] = (
    "backend",
    "interactive",
    "toolbar",
    "timezone",
    "savefig.directory",
    "figure.max_open_warning",
    "date.",
)
_KEPT += ("webagg.", "tk.", "macosx.", "keymap.", "figure.raise_window", "docstring.")
# Families with letters that DejaVu Sans lacks; the first that are installed lend theirs.
_LENDERS = (
    "Noto Sans CJK JP",
    "Noto Sans CJK SC",
    "Noto Sans JP",
    "Noto Sans SC",
    "Source Han Sans",
    "WenQuanYi Micro Hei",
    "WenQuanYi Zen Hei",
    "Microsoft YaHei",
    "SimHei",
    "PingFang SC",
    "Hiragino Sans",
    "MS Gothic",
    "IPAGothic",
    "Malgun Gothic",
    "Apple SD Gothic Neo",
    "NanumGothic",
    "Arial Unicode MS",
)
DPI = 125
_ASKED = ContextVar("asked for by a person", default=False)
LARGEST = 1 << 20  # [byte] of a matplotlibrc
_LOCK = RLock()  # matplotlib's settings belong to the whole process


@contextmanager
def house_look() -> Iterator[None]:
    """Within it matplotlib draws in the house style; afterwards the user's settings stand as they were.

    A letter that no installed font has becomes a box, and a crowded figure stays crowded, without a warning: a report
    has the names beside its figures.
    """
    load()
    from matplotlib import rc_context, rcParams

    settings: Any = rcParams
    with _LOCK, rc_context(), warnings.catch_warnings():
        dict.update(settings, _look())  # every value has been checked, once
        for words in (r"Glyph .* missing from", "constrained_layout not applied"):
            warnings.filterwarnings("ignore", words, UserWarning)
        yield


def load() -> None:
    """Imports matplotlib, with a user's own settings where they can be read and without them where they cannot."""
    if "matplotlib" in sys.modules:
        return
    backend = os.environ.pop("MPLBACKEND", None)  # an odd one would end the import
    try:
        with nullcontext() if _readable() else _without_settings():
            import matplotlib
    finally:
        if backend is not None:
            os.environ["MPLBACKEND"] = backend
    if backend:
        with suppress(ValueError):
            matplotlib.rcParams["backend"] = backend


@cache
def _look() -> dict[str, Any]:
    from matplotlib import rcParamsDefault

    found: Any = rcParamsDefault.copy()
    found.update({**RC, "font.sans-serif": [*RC["font.sans-serif"], *_lenders()]})
    # `dict.items`: asking for the backend by its name would choose one
    return {name: value for name, value in dict.items(found) if not name.startswith(_KEPT)}


def _lenders() -> list[str]:
    from matplotlib.font_manager import fontManager

    there = {font.name for font in fontManager.ttflist}
    return [name for name in _LENDERS if name in there]


def _readable() -> bool:
    """Whether every file of settings that matplotlib might take is short text: not a pipe, a device or another code."""
    named = os.environ.get("MATPLOTLIBRC", "")
    folders = [os.environ.get("MPLCONFIGDIR", ""), os.path.expanduser("~/.matplotlib")]
    folders += [f"{os.environ.get('XDG_CONFIG_HOME') or os.path.expanduser('~/.config')}/matplotlib"]
    for path in map(Path, ("matplotlibrc", named, *(f"{folder}/matplotlibrc" for folder in (named, *folders)))):
        try:
            if path.is_dir() or not path.exists():
                continue
            if not path.is_file() or path.stat().st_size > LARGEST:
                return False
            path.read_text(encoding="utf-8")
        except (OSError, ValueError):
            return False
    return True


@contextmanager
def _without_settings() -> Iterator[None]:
    """Within it, matplotlib finds the settings that it came with: it looks into the working folder first."""
    spec = find_spec("matplotlib")
    here = os.getcwd()
    try:
        if spec is not None:
            os.chdir(Path((spec.submodule_search_locations or [""])[0]) / "mpl-data")
        yield
    finally:
        os.chdir(here)


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
