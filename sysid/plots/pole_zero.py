"""Poles and zeros in the z-plane, with their confidence regions if known."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from sysid.base import style
from sysid.base.checks import checked
from sysid.base.errors import InputError
from sysid.base.style import styled
from sysid.uncertainty.intervals import Root

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Roots = Sequence[Root | complex] | np.ndarray
NEAR = 0.08  # half the height of the panel about z = 1, where slow poles crowd
REACH = 1.15  # half the width of the panel with the unit circle


@checked(own=("axes", "poles", "zeros", "references"))
@styled
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
    (ax,) = style.panels(axes, height=5.0)
    _draw(ax, poles, zeros, references or {})
    ax.set(title=_title(poles), xlabel="real part", ylabel="imaginary part")
    if zoom is None:
        _frame(ax, [*poles, *zeros, *_flat(references)])
    else:
        if not 0 <= zoom < len(poles):
            raise InputError(f"zoom is {zoom} and there are {len(poles)} poles; give the index of one, from 0")
        centre, size = _value(poles[zoom]), _ellipse(poles[zoom])[0]
        reach = 3.0 * size if 0.0 < size < 1.0 else 0.1
        ax.set(aspect="equal", xlim=_around(centre.real, reach), ylim=_around(centre.imag, reach))
        ax.tick_params(axis="x", rotation=30)
    style.legend(ax)
    return ax


@checked(own=("axes", "poles", "zeros", "references"))
@styled
def pole_zero_map(
    poles: Roots,
    zeros: Roots = (),
    axes: Sequence[Axes] | None = None,
    references: Mapping[str, np.ndarray] | None = None,
) -> list[Axes]:
    """`pole_zero` with a second panel near z = 1 if there are slow poles or zeros; else without it."""
    from matplotlib.ticker import MaxNLocator

    every = np.array([_value(r) for r in [*poles, *zeros, *_flat(references)]])
    slow = bool(np.any((np.abs(every.imag) < NEAR) & (np.abs(every.real - (1 - 0.5 * NEAR)) < NEAR)))
    both = style.panels(axes, 1, 2 if slow else 1, height=3.6)
    for ax in both:
        _draw(ax, poles, zeros, references or {})
        ax.set(xlabel="real part")
    _frame(both[0], every)
    both[0].set(ylabel="imaginary part", title=f"{'(a) ' if slow else ''}unit circle")
    if slow:
        both[1].xaxis.set_major_locator(MaxNLocator(5))
        both[1].set(aspect="equal", xlim=(1 - 1.5 * NEAR, 1 + 0.5 * NEAR), ylim=(-NEAR, NEAR))
        both[1].set(title="(b) near z = 1: slow poles")
    if axes is None:
        handles, labels = both[0].get_legend_handles_labels()
        both[0].get_figure().legend(handles, labels, loc="outside upper center", ncols=5)  # type: ignore[union-attr]
    else:
        style.legend(both[0])
    return both


def _draw(ax: Axes, poles: Roots, zeros: Roots, references: Mapping[str, np.ndarray]) -> None:
    angle = np.linspace(0.0, 2.0 * np.pi, 361)
    ax.plot(np.cos(angle), np.sin(angle), color=style.SECOND, linewidth=1.0, zorder=1)
    ax.axhline(0.0, color=style.SECOND, linewidth=0.5, zorder=1)
    ax.axvline(0.0, color=style.SECOND, linewidth=0.5, zorder=1)
    for roots, mark, colour, name in ((poles, "x", style.MODEL, "pole"), (zeros, "o", style.INPUT, "zero")):
        _mark(ax, np.array([_value(r) for r in roots]), mark, colour, name)
        for r in roots:
            _region(ax, r, colour)
    if ax.patches or any(line.get_alpha() for line in ax.lines):
        level = next(r.level for r in [*poles, *zeros] if isinstance(r, Root))
        ax.plot([], [], color=style.MODEL, lw=4, alpha=0.35, label=f"{100 * level:g} % region")
    for (name, values), mark in zip(references.items(), ("+", "^", "v"), strict=False):
        _mark(ax, np.atleast_1d(values), mark, style.INK, name)


def _mark(ax: Axes, z: np.ndarray, mark: str, colour: str, name: str) -> None:
    if len(z):
        ax.plot(z.real, z.imag, mark, color=colour, markersize=7, mfc="none", mew=1.5, label=name)


def _region(ax: Axes, root: Root | complex, colour: str) -> None:
    """An ellipse for a complex root, a bar for a real root; nothing if the record does not determine it."""
    from matplotlib.patches import Ellipse

    z, (a, b, tilt) = _value(root), _ellipse(root)
    if not np.isfinite(a) or a == 0.0:
        return
    if b == 0.0:
        ax.plot([z.real - a, z.real + a], [0.0, 0.0], color=colour, lw=4, alpha=0.35, solid_capstyle="butt")
    else:
        ax.add_patch(Ellipse((z.real, z.imag), 2 * a, 2 * b, angle=np.degrees(tilt), color=colour, alpha=0.3, lw=0))


def _frame(ax: Axes, roots: Roots) -> None:
    """The unit circle, and the number of roots outside the frame."""
    ax.set(aspect="equal", xlim=(-REACH, REACH), ylim=(-REACH, REACH))
    far = sum(max(abs(z.real), abs(z.imag)) > REACH for z in map(_value, roots))
    if far:
        ax.text(0.02, 0.02, f"{far} beyond the frame", transform=ax.transAxes, fontsize=8, color=style.SECOND)


def _title(poles: Roots) -> str:
    levels = [r.level for r in poles if isinstance(r, Root)]
    return f"poles and zeros, {100 * levels[0]:g} % regions" if levels else "poles and zeros"


def _value(root: Root | complex) -> complex:
    return root.value if isinstance(root, Root) else complex(root)


def _ellipse(root: Root | complex) -> tuple[float, float, float]:
    return root.ellipse() if isinstance(root, Root) else (0.0, 0.0, 0.0)


def _flat(references: Mapping[str, np.ndarray] | None) -> list[complex]:
    return [complex(z) for values in (references or {}).values() for z in np.atleast_1d(values)]


def _around(centre: float, reach: float) -> tuple[float, float]:
    return centre - reach, centre + reach
