"""Poles and zeros in the z-plane, with their confidence regions if known; a hover tells what each means."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from sysid.base import style
from sysid.base.checks import checked
from sysid.base.errors import InputError
from sysid.base.poles import ON_CIRCLE, time_constant
from sysid.base.quantities import number, pole
from sysid.drawing.axes import draw
from sysid.drawing.figure import Axis, Figure, Item, Line, Mark, Panel, Points, Region, Rule, View
from sysid.drawing.plotly import as_text
from sysid.uncertainty.intervals import Interval, Root

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Roots = Sequence[Root | complex] | np.ndarray
NEAR = 0.08  # half the height of the view about z = 1, where slow poles crowd
REACH = 1.15  # half the width of the view of the unit circle
OTHERS: tuple[Mark, ...] = ("plus", "up", "down")  # of roots for comparison


@checked(deferred=("axes", "poles", "zeros", "references"))
def pole_zero(
    poles: Roots,
    zeros: Roots = (),
    axes: Axes | None = None,
    zoom: int | None = None,
    references: Mapping[str, np.ndarray] | None = None,
) -> Axes:
    """Poles (crosses) and zeros (rings) in the z-plane, with confidence regions if intervals are given.

    If a region meets the unit circle, stability is not certain. If the regions of a pole and a zero overlap, they may
    cancel, and a lower order may suffice. `zoom`, the index of a pole from 0, shows only its neighbourhood;
    `references` are other poles for comparison, by name.
    """
    figure = roots_figure(poles, zeros, references)
    (panel,) = figure.panels
    view = replace(panel.views[0], title=_title(poles))
    if zoom is not None:
        if not 0 <= zoom < len(poles):
            raise InputError(f"zoom is {zoom} and there are {len(poles)} poles; give the index of one, from 0")
        centre, size = _value(poles[zoom]), _ellipse(poles[zoom])[0]
        reach = 3.0 * size if 0.0 < size < 1.0 else 0.1
        view = View(view.title, _interval(centre.real, reach), _interval(centre.imag, reach))
    return draw(replace(figure, panels=[replace(panel, views=[view])], height=5.0, legend="panels"), axes)[0]


@checked(deferred=("axes", "poles", "zeros", "references"))
def pole_zero_map(
    poles: Roots,
    zeros: Roots = (),
    axes: Sequence[Axes] | None = None,
    references: Mapping[str, np.ndarray] | None = None,
) -> list[Axes]:
    """`pole_zero` with a second panel near z = 1 if there are slow poles or zeros; else without it."""
    return draw(roots_figure(poles, zeros, references), axes)


def roots_figure(
    poles: Roots, zeros: Roots = (), references: Mapping[str, np.ndarray] | None = None, Ts: float | None = None
) -> Figure:
    """Poles (crosses) with their regions, zeros (rings), and other roots by name.

    With the sampling time Ts [s] a hover gives natural frequency [rad/s], damping and time constant [s], with standard
    deviations of roots that have them.
    """
    angle = np.linspace(0.0, 2.0 * np.pi, 361)
    items: list[Item] = [Line(np.cos(angle), np.sin(angle), colour=style.SECOND, width=1.0)]
    items += [Rule(0.0, upright, width=0.5) for upright in (False, True)]
    groups: list[tuple[str, Roots, Mark, str]] = [
        ("pole", poles, "cross", style.MODEL),
        ("zero", zeros, "ring", style.INPUT),
    ]
    reference_roots = [(name, np.atleast_1d(values)) for name, values in (references or {}).items()]
    groups += [(name, values, mark, style.INK) for (name, values), mark in zip(reference_roots, OTHERS, strict=False)]
    for name, roots, mark, colour in groups:
        z = np.array([_value(root) for root in roots], dtype=complex)
        texts = [] if Ts is None else [_meaning(root, name, Ts) for root in roots]
        items += [*_regions(roots, colour), Points(z.real, z.imag, name, colour, mark, texts)]
    every = np.array([_value(root) for _, roots, *_ in groups for root in roots] or [0j])
    reach = REACH * max(1.0, float(np.abs(every).max()))
    x, y = (Axis(f"{part} part [1]", whole=_interval(0.0, reach)) for part in ("real", "imaginary"))
    panel = Panel(items, y, x, equal=True, views=_views(every))
    return Figure([panel], shared=False, height=3.6, lettered=True, legend="above")


def _views(every: np.ndarray) -> list[View]:
    """The unit circle, with the number of roots outside of the frame, and the slow roots where there are some."""
    count = int(np.sum(np.maximum(np.abs(every.real), np.abs(every.imag)) > REACH))
    frame = _interval(0.0, REACH)
    views = [View("unit circle", frame, frame, f"{count} beyond the frame" if count else "")]
    if np.any((np.abs(every.imag) < NEAR) & (np.abs(every.real - (1 - 0.5 * NEAR)) < NEAR)):
        views.append(View("near z = 1: slow poles", (1 - 1.5 * NEAR, 1 + 0.5 * NEAR), (-NEAR, NEAR)))
    return views


def _regions(roots: Roots, colour: str) -> list[Region]:
    """An ellipse for a complex root, a bar for a real root; nothing where the record does not determine it."""
    regions = []
    for root in (r for r in roots if isinstance(r, Root)):
        a, b, tilt = root.ellipse()
        if np.isfinite(a) and a != 0.0:
            name = f"{100 * root.level:g} % region"
            regions.append(Region(root.value.real, root.value.imag, a, b, tilt, name, colour))
    return regions


def _meaning(root: Root | complex, name: str, Ts: float) -> str:
    """What a root means for the motion, for a hover."""
    z = _value(root)
    sign = "" if abs(z.imag) < 5e-5 else f" {'−' if z.imag < 0 else '+'} {abs(z.imag):.4f}i"
    lines = [f"<b>{as_text(name)}</b> z = {pole(complex(z.real))}{sign}", f"|z| = {number(abs(z), 5)}"]
    estimate = root if isinstance(root, Root) else None
    if z != 0 and abs(z - 1.0) > ON_CIRCLE:
        s = np.log(complex(z)) / Ts
        frequency, damping, lag = abs(s), -s.real / abs(s), time_constant(abs(z), Ts)
        lines += [
            f"natural frequency {number(frequency, 4)} rad/s{_spread(estimate.frequency) if estimate else ''}",
            f"damping ratio {number(damping, 3)}{_spread(estimate.damping) if estimate else ''}",
            f"time constant {number(lag, 4)} s{_spread(estimate.time_constant) if estimate else ''}"
            if np.isfinite(lag)
            else "does not decay",
        ]
    if estimate is not None:
        lines.append(
            f"standard deviation of z {number(estimate.std, 2)}" if np.isfinite(estimate.std) else "no interval"
        )
        lines += [estimate.note] if estimate.note else []
    return "<br>".join(lines)


def _spread(interval: Interval) -> str:
    return f" ± {number(interval.std, 2)} (std)" if np.isfinite(interval.std) else ""


def _title(poles: Roots) -> str:
    levels = [r.level for r in poles if isinstance(r, Root)]
    return f"poles and zeros, {100 * levels[0]:g} % regions" if levels else "poles and zeros"


def _value(root: Root | complex) -> complex:
    return root.value if isinstance(root, Root) else complex(root)


def _ellipse(root: Root | complex) -> tuple[float, float, float]:
    return root.ellipse() if isinstance(root, Root) else (0.0, 0.0, 0.0)


def _interval(centre: float, reach: float) -> tuple[float, float]:
    return centre - reach, centre + reach
