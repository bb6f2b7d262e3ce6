"""The figures of `qpal compare`, from finished numbers."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from sysid.base import style
from sysid.base.style import styled
from sysid.data.record import IOData
from sysid.drawing.figure import Axis, Band, Bars, Figure, Item, Line, Panel, Rule, Span
from sysid.plots.free_runs import runs_figure
from twin.compare.comparison import LOG, Comparison
from twin.compare.departure import Spectrum
from twin.compare.structures import CAUSES
from twin.compare.verdict import WORTH, Share, Verdict

if TYPE_CHECKING:
    from matplotlib.axes import Axes

DEG = 180.0 / np.pi


def names(result: Comparison) -> tuple[str, str]:
    """Legend names of the log and of the other side."""
    return "log", result.label if result.kind != LOG else f"second log, {result.label}"


def overlay_figure(result: Comparison) -> Figure:
    """Both angles, their difference over the noise of the log, and the input."""
    log_name, twin_name = names(result)
    data = IOData(result.u, result.y, result.Ts, "input", "angle", "V", "rad")
    figure = runs_figure(data, {twin_name: result.other}, log_name)
    angles, error, voltage = figure.panels
    edge = 2.0 * DEG * result.noise
    noise = Span(-edge, edge, upright=False, label="twice the noise of the log")
    return replace(figure, panels=[angles, replace(error, items=[noise, *error.items]), voltage])


def regimes_figure(result: Comparison) -> Figure:
    """RMS of the error by regime, and what share of the record and of the error each regime is."""
    words = Axis(names=[regime.name for regime in result.regimes])
    noise = Rule(DEG * result.noise, dash="dash", label="noise of the log", colour=style.INK, width=0.9)
    errors = Bars([DEG * regime.rms for regime in result.regimes], "RMS", (style.INPUT,))
    record = Bars([100 * r.share for r in result.regimes], "record", (style.SECOND,), width=0.34, shift=-0.18)
    squares = Bars([100 * r.of_error for r in result.regimes], "squared error", width=0.34, shift=0.18)
    panels = [
        Panel([errors, noise], words, Axis("RMS of the error [deg]"), "error"),
        Panel([record, squares], words, Axis("share [%]"), "shares"),
    ]
    return Figure(panels, columns=2, shared=False, lettered=True)


def telling(verdict: Verdict) -> list[Share]:
    """The effects that explain at least `WORTH` of the departure when moved alone, and those of the verdict."""
    names = {share.effect for share in verdict.named}
    return [share for share in verdict.alone if share.share >= WORTH or share.effect in names]


@styled
def effects(verdict: Verdict) -> Axes:
    """The share that each effect explains alone, best first, of those that explain something."""
    shares = telling(verdict)
    (axes,) = style.panels(None, height=0.9 + 0.3 * len(shares))
    axes.set_yticks(range(len(shares)), [CAUSES[share.effect].words for share in shares])
    named = "named by the verdict" if verdict.known else "nearest, not named"
    verdict_effects = {share.effect for share in verdict.named}
    kinds: set[str] = set()
    for place, share in enumerate(shares):
        kind = named if share.effect in verdict_effects else "others"
        axes.barh(
            place,
            100 * share.share,
            0.6,
            color=style.MODEL if share.effect in verdict_effects else "none",
            edgecolor=style.MODEL,
            linewidth=1.0,
            label=None if kind in kinds else kind,
        )
        kinds.add(kind)
    axes.set(xlabel="departure that vanishes [%]", xlim=(0, 102), title="moved alone")
    axes.invert_yaxis()
    style.legend(axes)
    return axes


def spectra_figure(result: Comparison) -> Figure:
    """Magnitude and phase of both sides with their bands."""
    assert result.spectra is not None
    top = min(_highest_known(spectrum) for spectrum in result.spectra)
    magnitudes, phases = list[Item](), list[Item]()
    for spectrum, colour, name in zip(result.spectra, (style.INK, style.MODEL), names(result), strict=True):
        is_known = spectrum.frequency <= top
        f = spectrum.frequency[is_known]
        for items, band in ((magnitudes, spectrum.magnitude), (phases, spectrum.phase)):
            value, low, high = (DEG * part[is_known] for part in band)
            key = items is magnitudes
            items += [Line(f, value, name, colour, 1.2, key=key), Band(f, low, high, f"95 %, {name}", colour, key=key)]
    size, turns = (np.concatenate([i.y for i in items if isinstance(i, Line)]) for items in (magnitudes, phases))
    magnitude_limits = 0.3 * float(size[size > 0].min()), 3.0 * float(size.max())
    frequency = Axis("frequency [Hz]", "frequency", "Hz", log=True)
    magnitude = Axis("magnitude [deg/V]", "magnitude", "deg/V", log=True, limits=magnitude_limits)
    phase = Axis("phase [deg]", "phase", "deg", limits=(float(turns.min()) - 60.0, float(turns.max()) + 60.0))
    panels = [Panel(magnitudes, magnitude, frequency, "frequency response"), Panel(phases, phase, frequency)]
    return Figure(panels, height=4.8)


def _highest_known(spectrum: Spectrum) -> float:
    """The last frequency before the first at which the response may be zero: noise turns every phase beyond.

    What may be zero below the first known one does not count; the last of all frequencies if none is known.
    """
    known = spectrum.known
    first = int(np.argmax(known))
    return float(spectrum.frequency[first + int(np.argmin(np.append(known[first:], False))) - 1])
