"""Figures of a fit, each drawn from finished numbers: hand in what `responses`, `intervals`, `curves`, `bands` gave.

Every function takes an Axes (or, where it needs several, makes a Figure of its own when none is given) and returns it.
Shaded areas are the bands' level, by default 95 %. Matplotlib is imported inside, so that fits need no drawing library.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from sysid.data.record import IOData
from sysid.diagnosis.higher_order import HigherOrderTests
from sysid.diagnosis.residuals import ResidualTests
from sysid.uncertainty.bands import OutputBand
from sysid.uncertainty.curves import Curve
from sysid.uncertainty.intervals import Band, Root
from sysid.uncertainty.responses import FrequencyResponse
from sysid.validation.compare import Comparison

if TYPE_CHECKING:
    from matplotlib.axes import Axes

MEASURED, MODEL, INPUT, QUIET = "#1f2933", "#c2410c", "#2f6f8f", "#7a8794"
_CYCLE = (MODEL, INPUT, "#2e7d4f", "#8a5a9e", "#b8860b", QUIET)


def step(band: Band, axes: Axes | None = None, y_unit: str = "", u_unit: str = "") -> Axes:
    """Step response of the tangent. Look at where it settles (the gain) and how wide the band is there."""
    return _response(band, "step response of the tangent", axes, y_unit, u_unit)


def impulse(band: Band, axes: Axes | None = None, y_unit: str = "", u_unit: str = "") -> Axes:
    """Answer of the tangent to one sample of 1. Look at the delay: the samples before it are exactly 0."""
    return _response(band, "response of the tangent to a pulse of one sample", axes, y_unit, u_unit)


def bode(response: FrequencyResponse, axes: Sequence[Axes] | None = None) -> Sequence[Axes]:
    """Magnitude and phase of the tangent. Look at where the band widens: there the record held little power."""
    if axes is None:
        axes = _figure(2, 5.2, sharex=True)
    magnitude, phase = response.magnitude, response.phase
    shaded = _finite(magnitude.lower) & _finite(magnitude.upper)
    for a, b in zip(axes, (magnitude, phase), strict=True):
        a.plot(b.x, b.value, color=MODEL, label="tangent")
        a.fill_between(b.x, b.lower, b.upper, where=shaded, color=MODEL, alpha=0.25, lw=0, label=_level(b.level))
        _remark(a, b.note)
    _label(axes[0], "frequency response of the tangent", ylabel="magnitude", xscale="log", yscale="log")
    _label(axes[1], "", xlabel="frequency [rad/s]", ylabel="phase [deg]", xscale="log")
    # A band that is wide at the edge of what was excited must not squeeze the curve into a line.
    size = magnitude.value[magnitude.value > 0]
    axes[0].set_ylim(0.3 * size.min(), 3.0 * size.max())
    lo, hi = float(phase.value.min()), float(phase.value.max())
    axes[1].set_ylim(lo - 0.2 * (hi - lo) - 10.0, hi + 0.2 * (hi - lo) + 10.0)
    axes[0].legend(frameon=False)
    return axes


def pole_zero(
    poles: Sequence[Root], zeros: Sequence[Root] = (), axes: Axes | None = None, zoom: int | None = None
) -> Axes:
    """Poles (crosses) and zeros (rings) in the z-plane with the regions that hold them with the level's probability.

    Look at whether a region meets the unit circle (stability not certain) and whether a pole's and a zero's overlap
    (the pair may cancel, an order less would do). `zoom`, a pole's number from 0, shows its neighbourhood alone.
    """
    from matplotlib.patches import Ellipse

    axes = _axes(axes, (5.2, 5.0))
    angle = np.linspace(0.0, 2.0 * np.pi, 400)
    axes.plot(np.cos(angle), np.sin(angle), color=QUIET, lw=0.9, zorder=0)
    axes.axhline(0.0, color=QUIET, lw=0.5, zorder=0)
    axes.axvline(0.0, color=QUIET, lw=0.5, zorder=0)
    for roots, marker, colour, name in ((poles, "x", MODEL, "pole"), (zeros, "o", INPUT, "zero")):
        for k, r in enumerate(roots):
            label = name if k == 0 else None
            axes.plot(r.value.real, r.value.imag, marker, color=colour, mfc="none", ms=8, mew=1.6, label=label)
            a, b, tilt = r.ellipse()
            if not np.isfinite(a):
                continue
            if b == 0.0:
                axes.plot([r.value.real - a, r.value.real + a], [0.0, 0.0], color=colour, lw=4, alpha=0.35)
            else:
                patch = Ellipse(
                    (r.value.real, r.value.imag), 2 * a, 2 * b, angle=np.degrees(tilt), color=colour, alpha=0.3, lw=0
                )
                axes.add_patch(patch)
    level = poles[0].level if poles else 0.95
    _label(axes, f"poles and zeros, {100 * level:g} % regions", xlabel="real part", ylabel="imaginary part")
    axes.set_aspect("equal", adjustable="datalim" if zoom is None else "box")
    if zoom is not None:
        centre, size = poles[zoom].value, poles[zoom].ellipse()[0]
        reach = 3.0 * size if 0.0 < size < 1.0 else 0.1
        axes.set_xlim(centre.real - reach, centre.real + reach)
        axes.set_ylim(centre.imag - reach, centre.imag + reach)
        axes.tick_params(axis="x", rotation=30)
    axes.legend(frameon=False)
    return axes


def static_curve(curve: Curve, axes: Axes | None = None) -> Axes:
    """One static map with its band. Look at where the band opens: the record seldom went there.

    In the normalised scale the dashed diagonal is no nonlinearity at all; in a map's own scale there is none.
    """
    axes = _axes(axes, (4.6, 4.0))
    b = curve.band
    axes.plot(b.x, b.value, color=MODEL, label=f"{curve.role} map")
    _shade(axes, b)
    if curve.scale == "normalised":
        ends = np.array([b.x[0], b.x[-1]])
        axes.plot(ends, ends, "--", color=QUIET, lw=1, label="no nonlinearity")
    inner = "signal after the map" if curve.role != "output" else "y"
    outer = "u" if curve.role == "input" else "signal before the map"
    _label(
        axes,
        f"{curve.role} map, {curve.scale} scale",
        xlabel=_unit(outer, curve.x_unit),
        ylabel=_unit(inner, curve.y_unit),
    )
    axes.legend(frameon=False)
    return axes


def steady_state(band: Band, axes: Axes | None = None, u_unit: str = "", y_unit: str = "") -> Axes:
    """Steady-state output over constant inputs: what the whole chain does at rest, free of any gauge."""
    axes = _axes(axes, (4.6, 4.0))
    axes.plot(band.x, band.value, color=MODEL, label="steady state")
    _shade(axes, band)
    _label(axes, "steady state", xlabel=_unit("u", u_unit), ylabel=_unit("y", y_unit))
    axes.legend(frameon=False)
    return axes


def simulated(band: OutputBand, data: IOData | None = None, axes: Axes | None = None) -> Axes:
    """Free run with its band, over the measured output. Look for stretches where the data leave the band for long."""
    axes = _axes(axes, (8.0, 3.2))
    if data is not None:
        axes.plot(data.t, data.y[:, 0], color=MEASURED, lw=0.8, alpha=0.8, label="measured")
    axes.plot(band.t, band.y, color=MODEL, lw=1.2, label="free run")
    shaded = _finite(band.lower) & _finite(band.upper)
    kind = f"Monte Carlo, {band.draws - band.dropped} draws" if band.draws else "linear"
    axes.fill_between(
        band.t, band.lower, band.upper, where=shaded, color=MODEL, alpha=0.3, lw=0,
        label=f"{_level(band.level)} ({kind})",
    )  # fmt: skip
    _remark(axes, band.note)
    name = data.y_name if data is not None else "y"
    _label(axes, "simulated output", xlabel="time [s]", ylabel=_unit(name, band.unit), xlim=(band.t[0], band.t[-1]))
    axes.legend(frameon=False, ncols=3, loc="lower right", bbox_to_anchor=(1.0, 1.0), borderaxespad=0.1)
    return axes


def comparison(table: Comparison, axes: Axes | None = None) -> Axes:
    """Free-run fit of each model, best on top, with d beside it. Look for a small model as good as a large one."""
    rows = table.rows[::-1]
    axes = _axes(axes, (7.0, 0.9 + 0.42 * len(rows)))
    shown = [max(r.fit, 0.0) if np.isfinite(r.fit) else 0.0 for r in rows]
    axes.barh(range(len(rows)), shown, color=[MODEL if r.rank == 1 else INPUT for r in rows], height=0.6)
    for k, r in enumerate(rows):
        text = f"{r.fit:.2f} %, d {r.criteria.d}" if np.isfinite(r.fit) else "diverges"
        axes.text(shown[k] + 1.0, k, text + ("" if r.converged else ", not converged"), va="center", fontsize=8.5)
    axes.set_yticks(range(len(rows)), [r.label for r in rows])
    _label(axes, f"free run on {table.scored} samples", xlabel="fit [%]", xlim=(0.0, 130.0))
    axes.set_xticks(range(0, 101, 20))
    return axes


def residual_tests(tests: ResidualTests, axes: Sequence[Axes] | None = None) -> Sequence[Axes]:
    """Whiteness and independence. Bars outside the bound at small positive lags: dynamics or a delay is missing."""
    if axes is None:
        axes = _figure(2, 4.6)
    _lags(axes[0], tests.lags[1:], tests.autocorrelation[1:], tests.whiteness_bound, tests.level)
    _lags(axes[1], tests.cross_lags, tests.cross_correlation, tests.independence_bound, tests.level)
    verdict = ("white" if tests.white else "not white", "independent" if tests.independent else "not independent")
    _label(axes[0], f"residuals with themselves: {verdict[0]}", ylabel="correlation")
    _label(axes[1], f"residuals with the input: {verdict[1]}", ylabel="correlation", xlabel="lag [samples]")
    return axes


def higher_order_tests(tests: HigherOrderTests, axes: Sequence[Axes] | None = None) -> Sequence[Axes]:
    """Three correlations that a complete model leaves at zero. Bars outside: something is missing, see `advice`."""
    if axes is None:
        axes = _figure(len(tests.tests), 6.4, sharex=True)
    for a, t in zip(axes, tests.tests, strict=True):
        _lags(a, t.lags, t.correlation, t.bound, t.level)
        _label(a, f"{t.name}: {'passed' if t.passed else 'failed'}", ylabel="correlation")
    axes[-1].set(xlabel="lag [samples]")
    return axes


def _response(band: Band, title: str, axes: Axes | None, y_unit: str, u_unit: str) -> Axes:
    axes = _axes(axes, (6.0, 3.4))
    # The value stands from its sample to the next one.
    axes.step(band.x, band.value, where="post", color=MODEL, label="tangent")
    _shade(axes, band, step="post")
    per = f"{y_unit or '1'} per {u_unit or '1'}" if y_unit or u_unit else ""
    axes.axhline(0.0, color=QUIET, lw=0.5, zorder=0)
    _label(axes, title, xlabel="time [s]", ylabel=_unit("output", per))
    axes.legend(frameon=False)
    return axes


def _shade(axes: Axes, band: Band, **kwargs: Any) -> None:
    shaded = _finite(band.lower) & _finite(band.upper)
    axes.fill_between(
        band.x, band.lower, band.upper, where=shaded, color=MODEL, alpha=0.25, lw=0, label=_level(band.level), **kwargs
    )
    _remark(axes, band.note)


def _lags(axes: Axes, lags: np.ndarray, r: np.ndarray, bound: float, level: float) -> None:
    limit = bound if np.isfinite(bound) else 0.0
    axes.axhspan(-limit, limit, color=QUIET, alpha=0.2, lw=0, label=f"{100 * level:g} % bound of one lag")
    outside = np.abs(r) > bound
    for chosen, colour in ((~outside, INPUT), (outside, MODEL)):
        if chosen.any():
            axes.vlines(lags[chosen], 0.0, r[chosen], color=colour, lw=1.6)
            axes.plot(lags[chosen], r[chosen], "o", color=colour, ms=3.2)
    axes.axhline(0.0, color=QUIET, lw=0.6)
    top = 1.25 * max(float(np.abs(r).max(initial=0.0)), limit, 1e-9)
    axes.set_ylim(-top, top)
    axes.legend(frameon=False, loc="lower right", bbox_to_anchor=(1.0, 1.0), borderaxespad=0.1)


def _label(axes: Axes, title: str, **properties: Any) -> None:
    axes.set_title(title, loc="left", fontsize=9.5, fontweight="bold", color=MEASURED)
    axes.set(**properties)
    axes.spines[["top", "right"]].set_visible(False)


def _finite(x: np.ndarray) -> np.ndarray:
    return np.isfinite(x)


def _level(level: float) -> str:
    return f"{100 * level:g} % band"


def _unit(name: str, unit: str) -> str:
    return f"{name} [{unit}]" if unit else name


def _remark(axes: Axes, note: str) -> None:
    if note:
        axes.text(0.01, 0.02, note, transform=axes.transAxes, fontsize=7.5, color=QUIET, wrap=True)


def _axes(axes: Axes | None, size: tuple[float, float]) -> Axes:
    if axes is not None:
        return axes
    from matplotlib.figure import Figure

    return Figure(figsize=size, layout="constrained").subplots()


def _figure(rows: int, height: float, sharex: bool = False) -> Sequence[Axes]:
    from matplotlib.figure import Figure

    return list(Figure(figsize=(7.0, height), layout="constrained").subplots(rows, 1, sharex=sharex))
