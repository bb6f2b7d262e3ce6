"""What a figure shows, as data: panels with their axes and what stands in them.

A figure is described once and drawn twice: `sysid.drawing.axes` draws it with matplotlib, `sysid.drawing.plotly` makes
the figure that zooms. All numbers are in the units in which people read them. Colours are those of `sysid.base.style`.
An item with a `label` is named in the legend unless `key` is False; lines of one name are hidden together.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields, is_dataclass, replace
from typing import Any, Literal

import numpy as np

from sysid.base import style
from sysid.base.errors import readable
from sysid.base.quantities import Quantity

TIME = "time [s]"
DOTTED = 200  # samples, beyond which dots would only make a line fat
Limits = tuple[float, float]


@dataclass(frozen=True)
class Axis:
    """One axis: its label with the unit, and the name and the unit alone for a hover.

    `log` is logarithmic. `limits` are the first limits, which must not cut off anything for good: a zoomable figure
    shows `whole` instead, where that is given. `near` is the range of the data where a run leaves them far: a picture
    is linear over it and logarithmic beyond, a zoomable figure opens on it. `ticks` are the places of numbers; `names`
    stand at the places 0, 1, ... from the top. A `tight` one ends where the data end.
    """

    label: str = ""
    name: str = ""
    unit: str = ""
    log: bool = False
    limits: Limits | None = None
    whole: Limits | None = None
    near: Limits | None = None
    ticks: Sequence[float] = ()
    names: Sequence[str] = ()
    tight: bool = False

    @classmethod
    def of(cls, quantity: Quantity, limits: Limits | None = None, near: Limits | None = None) -> Axis:
        """The axis of a quantity."""
        return cls(quantity.label, quantity.name, quantity.unit, limits=limits, near=near)

    @classmethod
    def time(cls, label: str = TIME) -> Axis:
        """The axis of time [s]."""
        return cls(label, tight=True)


@dataclass(frozen=True)
class Line:
    """y (n,) over x (n,), `lengths` samples each in experiments of their own, a gap where y is not finite.

    `steps` holds a value until the next sample, `dots` marks the samples; `half` (n,) is the half width of the 95 %
    interval, for the hover. A long line keeps its extremes alone.
    """

    x: np.ndarray
    y: np.ndarray
    label: str = ""
    colour: str = style.MODEL
    width: float = 1.3
    steps: bool = False
    dash: bool = False
    dots: bool = False
    lengths: Sequence[int] = ()
    half: np.ndarray | None = None
    key: bool = True


@dataclass(frozen=True)
class Band:
    """The area between `lower` and `upper` (n,) over x (n,), where both are finite."""

    x: np.ndarray
    lower: np.ndarray
    upper: np.ndarray
    label: str = ""
    colour: str = style.MODEL
    steps: bool = False
    key: bool = True


Mark = Literal["dot", "cross", "ring", "plus", "up", "down"]


@dataclass(frozen=True)
class Points:
    """Marks at x, y (n,), with a text (n,) each for the hover."""

    x: np.ndarray
    y: np.ndarray
    label: str = ""
    colour: str = style.MODEL
    mark: Mark = "dot"
    texts: Sequence[str] = ()
    key: bool = True


@dataclass(frozen=True)
class Region:
    """An ellipse about x, y with the semi-axes a and b, of which the first is turned by `tilt` [rad]; a bar for b 0."""

    x: float
    y: float
    a: float
    b: float
    tilt: float
    label: str = ""
    colour: str = style.MODEL


@dataclass(frozen=True)
class Stems:
    """A bar from 0 to y at each x (n,); those that `stand_out` (n,) are told apart by colour."""

    x: np.ndarray
    y: np.ndarray
    bound: float
    stand_out: np.ndarray


@dataclass(frozen=True)
class Bars:
    """Horizontal bars at the names of the vertical axis.

    `notes` stand beside the bars, `texts` in the hover; `shift` moves the bars down by a part of their distance.
    """

    lengths: Sequence[float]
    label: str = ""
    colours: Sequence[str] = (style.MODEL,)
    notes: Sequence[str] = ()
    texts: Sequence[str] = ()
    width: float = 0.6
    shift: float = 0.0
    key: bool = True

    def rows(self) -> list[tuple[float, str]]:
        """Length and colour of each bar; the last colour of a short list counts for the rest."""
        n = len(self.lengths)
        return list(zip(self.lengths, [*self.colours, *[self.colours[-1]] * (n - len(self.colours))], strict=True))


@dataclass(frozen=True)
class Histogram:
    """`counts` (n,) between `edges` (n + 1,)."""

    edges: np.ndarray
    counts: np.ndarray
    colour: str = style.INPUT


@dataclass(frozen=True)
class Ranges:
    """A point `x` (n,) at some `places` of a vertical axis of names, with its range; without one the point is open."""

    places: Sequence[int]
    x: Sequence[float]
    low: Sequence[float] | None = None
    high: Sequence[float] | None = None
    label: str = ""
    texts: Sequence[str] = ()
    colour: str = style.MODEL


@dataclass(frozen=True)
class Rule:
    """A straight line across a panel or the figure, `upright` or level; of the figure with words on both `sides`."""

    at: float
    upright: bool = True
    dash: Literal["solid", "dot", "dash"] = "solid"
    label: str = ""
    colour: str = style.SECOND
    width: float = 0.8
    sides: tuple[str, str] | None = None


@dataclass(frozen=True)
class Span:
    """An area across a panel or the figure, `upright` or level; a colour other than that of bounds shines through."""

    low: float
    high: float
    upright: bool = True
    label: str = ""
    colour: str = style.BOUND


Item = Line | Band | Points | Region | Stems | Bars | Histogram | Ranges | Rule | Span


@dataclass(frozen=True)
class View:
    """Limits of one of several parts of a panel: a picture has a panel for each, a zoomable figure a button."""

    title: str
    x: Limits
    y: Limits
    note: str = ""


@dataclass(frozen=True)
class Panel:
    """Items in their order over two axes, with a title; `weight` is the share of the height.

    `note` stands in the panel in small letters. With `equal` both axes have one scale.
    """

    items: Sequence[Item]
    y: Axis
    x: Axis = Axis()
    title: str = ""
    weight: float = 1.0
    note: str = ""
    equal: bool = False
    views: Sequence[View] = ()

    def lines(self) -> list[Line]:
        """The lines among the items."""
        return [item for item in self.items if isinstance(item, Line)]


@dataclass(frozen=True)
class Figure:
    """Panels, row by row in `columns`; over one horizontal axis, that of the last one, where it is `shared`.

    `height` [inch] is that of a picture, whose titles are `lettered` (a), (b), ... `marks` go through all panels, and
    `said` are sentences for the caption. The legend of a picture stands over each panel, or once "above" or
    "below" all.
    """

    panels: Sequence[Panel]
    columns: int = 1
    shared: bool = True
    height: float = 2.6
    lettered: bool = False
    marks: Sequence[Rule | Span] = ()
    said: Sequence[str] = ()
    legend: Literal["panels", "above", "below"] = "panels"


def with_text(thing: Any, shown: Callable[[str], str], name: str = "") -> Any:
    """A description with every text in it as `shown` gives it; names of channels and of models come from files.

    Texts of a hover have marks of their own, and sentences go to the caption: both are only made `readable`.
    """
    if isinstance(thing, str):
        return readable(thing) if name in ("texts", "said") else shown(thing)
    if isinstance(thing, list | tuple):
        return type(thing)(with_text(entry, shown, name) for entry in thing) if _has_text(thing) else thing
    if is_dataclass(thing) and not isinstance(thing, type):
        return replace(thing, **{f.name: with_text(getattr(thing, f.name), shown, f.name) for f in fields(thing)})
    return thing


def _has_text(entries: Sequence[Any]) -> bool:
    return any(isinstance(entry, str) or is_dataclass(entry) for entry in entries)


def borders(lengths: Sequence[int], Ts: float, start: float = 0.0) -> list[Rule]:
    """Dotted lines between the experiments of a record that begins at `start` [s]."""
    return [Rule(start + (float(n) - 0.5) * Ts, dash="dot") for n in np.cumsum(lengths)[:-1]]


def has_area(lower: np.ndarray, upper: np.ndarray) -> bool:
    """Whether something is to be seen between two curves (n,): samples that stand alone or have no width are not."""
    visible = np.isfinite(lower) & np.isfinite(upper)
    visible[visible] = upper[visible] > lower[visible]
    return bool((visible[1:] & visible[:-1]).any())


def scaled(values: np.ndarray, factor: float) -> np.ndarray:
    """Values in display units; what a diverging run makes too large for a number is infinite, without a warning."""
    with np.errstate(over="ignore", invalid="ignore"):
        return np.asarray(values, dtype=float) * factor
