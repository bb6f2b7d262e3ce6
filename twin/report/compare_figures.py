"""The figures of `qpal compare`; they draw finished numbers."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from sysid.base import style
from sysid.base.log_axes import log_axis
from sysid.base.style import styled
from sysid.data.record import IOData
from sysid.report import zoom
from twin.compare.comparison import LOG, Comparison
from twin.compare.departure import Spectrum
from twin.compare.effects import TABLE
from twin.compare.verdict import Verdict

if TYPE_CHECKING:
    from matplotlib.axes import Axes

DEG = 180.0 / np.pi


def names(result: Comparison) -> tuple[str, str]:
    """Legend names of the log and of the other side."""
    return "log", result.label if result.kind != LOG else f"second log, {result.label}"


@styled
def overlay(result: Comparison) -> list[Axes]:
    """Both angles, their difference with the noise band, and the input."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(style.WIDTH, 5.6), layout="constrained")
    top, middle, bottom = figure.subplots(3, 1, sharex=True, height_ratios=(2.2, 1.4, 1.0))
    t, (log_name, twin_name) = result.t, names(result)
    style.line(top, t, DEG * result.y, color=style.INK, linewidth=1.9, label=log_name)
    style.line(top, t, DEG * result.other, color=style.MODEL, linewidth=1.0, label=twin_name)
    top.set(ylabel="angle [deg]", title="(a) angles")
    style.legend(top)
    band = 2.0 * DEG * result.noise
    middle.axhspan(-band, band, color=style.BOUND, lw=0, zorder=0, label="twice the noise of the log")
    style.line(middle, t, DEG * result.error, color=style.SECOND, linewidth=0.9, label=f"log less {twin_name}")
    middle.set(ylabel="error [deg]", title="(b) error")
    style.legend(middle)
    style.line(bottom, t, result.u, steps=True, color=style.INPUT, linewidth=0.9)
    bottom.set(xlabel="time [s]", ylabel="input [V]", title="(c) input")
    bottom.margins(x=0.005)
    return [top, middle, bottom]


def zoom_overlay(result: Comparison) -> zoom.Figure:
    """The same to zoom: angles, error with the noise band, and input over one time axis."""
    data = IOData(result.u, result.y, result.Ts, "voltage", "angle", "V", "rad")
    figure = zoom.runs(data, {names(result)[1]: result.other}, measured=names(result)[0])
    band = {"type": "rect", "xref": "paper", "x0": 0, "x1": 1, "yref": "y2", "layer": "below", "line": {"width": 0}}
    edge = 2.0 * DEG * result.noise
    figure["layout"]["shapes"].append(band | {"y0": -edge, "y1": edge, "fillcolor": zoom.BOUND})
    return figure


@styled
def regimes(result: Comparison) -> list[Axes]:
    """RMS of the error by regime, and what share of the record and of the error each regime is."""
    errors_axes, shares_axes = style.panels(None, 1, 2, height=2.6)
    places = np.arange(len(result.regimes))
    words = [regime.name for regime in result.regimes]
    errors_axes.barh(places, [DEG * regime.rms for regime in result.regimes], 0.6, color=style.MODEL)
    errors_axes.axvline(DEG * result.noise, color=style.INK, linewidth=0.9, linestyle="--", label="noise of the log")
    errors_axes.set(title="(a) error", xlabel="RMS of the error [deg]")
    shares_axes.barh(places - 0.18, [100 * r.share for r in result.regimes], 0.34, color=style.SECOND, label="record")
    shares_axes.barh(
        places + 0.18, [100 * r.of_error for r in result.regimes], 0.34, color=style.MODEL, label="squared error"
    )
    shares_axes.set(title="(b) shares", xlabel="share [%]")
    for axes in (errors_axes, shares_axes):
        axes.set_yticks(places, words)
        axes.invert_yaxis()
        style.legend(axes)
    return [errors_axes, shares_axes]


@styled
def effects(verdict: Verdict) -> Axes:
    """The share that each effect explains alone, best first; without a departure, the error that each one leaves."""
    (axes,) = style.panels(None, height=0.9 + 0.3 * len(verdict.alone))
    places = np.arange(len(verdict.alone))
    axes.set_yticks(places, [TABLE[share.effect].words for share in verdict.alone])
    if verdict.chance:  # shares of what is not there would make bars of any length
        errors = [DEG * share.rms for share in verdict.alone]
        axes.barh(places, errors, 0.6, color="none", edgecolor=style.MODEL, linewidth=1.0, label="one effect moved")
        axes.axvline(DEG * verdict.rms, color=style.INK, linewidth=0.9, linestyle="--", label="nothing moved")
        axes.set(xlabel="RMS of the error that is left [deg]", title="each effect moved alone")
        axes.invert_yaxis()
        style.legend(axes)
        return axes
    verdict_effects = {share.effect for share in verdict.named}
    labelled: set[str] = set()
    for place, share in enumerate(verdict.alone):
        kind = "named by the verdict" if share.effect in verdict_effects else "not named"
        axes.barh(
            place,
            100 * share.share,
            0.6,
            color=style.MODEL if share.effect in verdict_effects else "none",
            edgecolor=style.MODEL,
            linewidth=1.0,
            label=None if kind in labelled else kind,
        )
        labelled.add(kind)
    axes.set(xlabel="departure that vanishes [%]", xlim=(0, 102), title="each effect moved alone")
    axes.invert_yaxis()
    style.legend(axes)
    return axes


@styled
def spectra(result: Comparison) -> list[Axes]:
    """Magnitude and phase of both sides with their bands."""
    axes_pair = style.panels(None, 2, height=4.8, sharex=True)
    top = min(_highest_known(spectrum) for spectrum in result.spectra)
    sizes: list[np.ndarray] = []
    phases: list[np.ndarray] = []
    for spectrum, colour, name in zip(result.spectra, (style.INK, style.MODEL), names(result), strict=True):
        shown = spectrum.frequency <= top
        f = spectrum.frequency[shown]
        for axes, band, values in ((axes_pair[0], spectrum.magnitude, sizes), (axes_pair[1], spectrum.phase, phases)):
            value, low, high = (DEG * part[shown] for part in band)
            axes.plot(f, value, color=colour, linewidth=1.2, label=name)
            is_known = np.isfinite(low) & np.isfinite(high)
            axes.fill_between(f, low, high, where=is_known, color=colour, alpha=0.18, lw=0, label=f"95 %, {name}")
            values.append(value)
    size, turns = np.concatenate(sizes), np.concatenate(phases)
    log_axis(axes_pair[0])
    log_axis(axes_pair[1], "x")
    axes_pair[0].set(ylabel="magnitude [deg/V]", title="frequency response")
    axes_pair[0].set_ylim(0.3 * size[size > 0].min(), 3.0 * size.max())
    axes_pair[1].set(xlabel="frequency [Hz]", ylabel="phase [deg]")
    axes_pair[1].set_ylim(turns.min() - 60.0, turns.max() + 60.0)
    style.legend(axes_pair[0])
    return axes_pair


def _highest_known(spectrum: Spectrum) -> float:
    """The last frequency at which the response is larger than its uncertainty; the last of all if there is none."""
    indices = np.flatnonzero(spectrum.radius < np.abs(spectrum.G))
    return float(spectrum.frequency[indices[-1] if len(indices) else -1])
