"""Every kind of figure, each from finished numbers: one function a kind, used by every report."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from sysid.data.record import IOData
from sysid.diagnosis.residuals import ResidualTests
from sysid.report import style
from sysid.report.style import styled
from sysid.report.units import Quantity, percent, shown
from sysid.workflow.evaluation import Curve, Evaluation

if TYPE_CHECKING:
    from matplotlib.figure import Figure

ZOOM = 0.08  # half the height of the second pole-zero panel


@styled
def raw_data(data: IOData, seconds: float | None = None) -> Figure:
    """Input over output as recorded, of the first `seconds` [s] or of all."""
    n = data.N if seconds is None else min(data.N, max(2, round(seconds / data.Ts)))
    u, y = shown(data.u_name, data.u_unit), shown(data.y_name, data.y_unit)
    figure, axes = style.sheet(2, height=3.6, sharex=True)
    top, bottom = axes[:, 0]
    style.line(top, data.t[:n], (data.u[:n, 0] + data.u_offset[0]) * u.factor, steps=True, color=style.INPUT)
    style.line(bottom, data.t[:n], (data.y[:n, 0] + data.y_offset[0]) * y.factor, color=style.INK)
    top.set(title="(a) input", ylabel=u.label)
    bottom.set(title="(b) output", ylabel=y.label, xlabel="time [s]")
    return figure


@styled
def measurement_error(t: np.ndarray, measured: np.ndarray, true: np.ndarray) -> Figure:
    """Measured less true angle [rad], shown in degrees."""
    figure, axes = style.sheet(height=2.2)
    style.line(axes[0, 0], t, np.degrees(measured - true), color=style.SECOND, linewidth=0.8)
    axes[0, 0].set(xlabel="time [s]", ylabel="error [deg]", title="measured less true angle")
    return figure


@styled
def preprocessed(estimation: IOData, validation: IOData) -> Figure:
    """Input and output after preprocessing, with the two parts told apart."""
    u, y = shown(estimation.u_name, estimation.u_unit), shown(estimation.y_name, estimation.y_unit)
    figure, axes = style.sheet(2, height=3.6, sharex=True)
    start = 0.0
    for data, colour, name in ((estimation, style.INK, "estimation"), (validation, style.INPUT, "validation")):
        t = start + data.t
        style.line(axes[0, 0], t, data.u[:, 0] * u.factor, steps=True, color=colour, label=name)
        style.line(axes[1, 0], t, data.y[:, 0] * y.factor, color=colour)
        start = t[-1] + data.Ts
    axes[0, 0].set(title="(a) input", ylabel=u.label)
    axes[1, 0].set(title="(b) output", ylabel=y.label, xlabel="time [s]")
    style.legend(axes[0, 0])
    return figure


@styled
def free_run(evaluation: Evaluation) -> Figure:
    """Measured output and the model's free run over both parts, and the error of the validation part.

    A model that also runs one step ahead gets a panel of its own for that.
    """
    e, one = evaluation, evaluation.one_step
    y = shown(e.validation.y_name, e.validation.y_unit)
    parts = [
        ("estimation part", e.estimation, e.estimation_output, f"free run, fit {percent(e.estimation_fit)}"),
        (
            "validation part, never fitted to",
            e.validation,
            e.validation_output,
            f"free run, fit {percent(e.validation_fit)}",
        ),
    ]
    figure, axes = style.sheet(3 if one is None else 4, height=5.4 if one is None else 7.2)
    for k, (title, data, yhat, label) in enumerate(parts):
        _measured_and_model(axes[k, 0], data, yhat, y, label)
        axes[k, 0].set(title=f"({'ab'[k]}) {title}", ylabel=y.label)
        style.legend(axes[k, 0])
    ax = axes[2, 0]
    error = (e.validation.y[:, 0] - e.validation_output) * y.factor
    style.line(ax, e.validation.t, error, color=style.SECOND, linewidth=0.9)
    ax.set(title="(c) validation error, measured less free run", ylabel=y.label)
    if one is not None:
        ax, label = axes[3, 0], f"one step ahead, fit {percent(one.validation_fit)}"
        _measured_and_model(ax, e.validation, one.validation_output, y, label, colour=style.INPUT)
        ax.set(title="(d) one step ahead, NOT a free run", ylabel=y.label)
        style.legend(ax)
    axes[-1, 0].set(xlabel="time [s]")
    return figure


@styled
def comparison(evaluations: dict[str, Evaluation], seconds: float | None = None) -> Figure:
    """Measured validation output beside the free runs of several models, one panel with its title each."""
    first = next(iter(evaluations.values())).validation
    y = shown(first.y_name, first.y_unit)
    figure, axes = style.sheet(len(evaluations), height=0.5 + 1.9 * len(evaluations), sharex=True)
    for ax, (title, e) in zip(axes[:, 0], evaluations.items(), strict=True):
        n = first.N if seconds is None else min(first.N, max(2, round(seconds / first.Ts)))
        _measured_and_model(ax, e.validation, e.validation_output, y, f"free run, fit {percent(e.validation_fit)}", n)
        ax.set(title=title, ylabel=y.label)
        style.legend(ax)
    axes[-1, 0].set(xlabel="time in the validation part [s]")
    return figure


@styled
def close_ups(evaluation: Evaluation) -> Figure:
    """The first upper and the first lower peak of the measured validation output, with the free run over it."""
    data, yhat = evaluation.validation, evaluation.validation_output
    y = shown(data.y_name, data.y_unit)
    figure, axes = style.sheet(1, 2, height=2.8)
    width = _peak_width(data.y[:, 0])
    for ax, title, sign in ((axes[0, 0], "(a) upper peak", 1.0), (axes[0, 1], "(b) lower peak", -1.0)):
        centre = _first_peak(sign * data.y[:, 0])
        a, b = max(0, centre - width), min(data.N, centre + width + 1)
        dots = {"marker": ".", "markersize": 3} if b - a < 200 else {}  # more of them would only make the line fat
        ax.plot(data.t[a:b], data.y[a:b, 0] * y.factor, color=style.INK, label="measured", **dots)
        ax.plot(data.t[a:b], yhat[a:b] * y.factor, color=style.MODEL, label="free run")
        ax.set(title=title, xlabel="time in the validation part [s]", ylabel=y.label)
        ax.set_ylim(_frame(data.y[a:b, 0] * y.factor, yhat[a:b] * y.factor))
    style.legend(axes[0, 1])
    return figure


@styled
def residuals(tests: ResidualTests) -> Figure:
    """Autocorrelation of the validation residuals and their correlation with the input, with the bounds."""
    figure, axes = style.sheet(2, height=4.2)
    panels = (
        (axes[0, 0], tests.lags, tests.autocorrelation, tests.whiteness_bound, "(a) autocorrelation of the residuals"),
        (
            axes[1, 0],
            tests.cross_lags,
            tests.cross_correlation,
            tests.independence_bound,
            "(b) correlation of the residuals with the input",
        ),
    )
    for ax, lags, r, bound, title in panels:
        outside = np.abs(r) > bound
        if ax is axes[0, 0]:
            outside[lags == 0] = False  # correlation with itself at lag 0 is 1 by definition
        ax.axhspan(-bound, bound, color="#dbe7ee", zorder=0, label=f"{tests.level:.0%} bound")
        ax.vlines(lags, 0, r, color=np.where(outside, style.MODEL, style.INK), linewidth=1.2)
        ax.plot(lags[~outside], r[~outside], "o", color=style.INK, markersize=3)
        ax.plot(
            lags[outside], r[outside], "o", color=style.MODEL, markersize=3, label="outside" if any(outside) else None
        )
        ax.axhline(0, color=style.SECOND, linewidth=0.8)
        ax.set(title=title, ylabel="correlation")
        style.legend(ax)
    axes[1, 0].set(xlabel="lag [samples]")
    return figure


@styled
def pole_zero(poles: np.ndarray, zeros: np.ndarray, references: dict[str, np.ndarray] | None = None) -> Figure:
    """Poles and zeros of the linear block with the unit circle; `references` are other poles to compare with."""
    from matplotlib.ticker import MaxNLocator

    every = np.concatenate([poles, zeros, *(references or {}).values()])
    zoom = bool(np.any((np.abs(every.imag) < ZOOM) & (np.abs(every.real - (1 - 0.5 * ZOOM)) < ZOOM)))
    figure, axes = style.sheet(1, 2 if zoom else 1, height=3.6)
    angle = np.linspace(0, 2 * np.pi, 361)
    marks = iter(("+", "^", "v"))
    named = [("pole", poles, "x", style.MODEL), ("zero", zeros, "o", style.INPUT)]
    named += [(name, values, next(marks), style.INK) for name, values in (references or {}).items()]
    for ax in axes[0]:
        ax.plot(np.cos(angle), np.sin(angle), color=style.SECOND, linewidth=1.0)
        ax.axhline(0, color="#cbd2d9", linewidth=0.8)
        for name, values, mark, colour in named:
            if len(values):
                ax.plot(
                    np.real(values), np.imag(values), mark, color=colour, markersize=7, mfc="none", mew=1.5, label=name
                )
        ax.set(xlabel="real part", aspect="equal")
    left = axes[0, 0]
    reach = 1.15
    far = [z for _, values, _, _ in named for z in np.atleast_1d(values) if max(abs(z.real), abs(z.imag)) > reach]
    left.set(
        xlim=(-reach, reach),
        ylim=(-reach, reach),
        ylabel="imaginary part",
        title=f"{'(a) ' if zoom else ''}unit circle",
    )
    if far:
        left.text(0.02, 0.02, f"{len(far)} beyond the frame", transform=left.transAxes, fontsize=8, color=style.SECOND)
    if zoom:
        right = axes[0, 1]
        right.xaxis.set_major_locator(MaxNLocator(5))
        right.set(xlim=(1 - 1.5 * ZOOM, 1 + 0.5 * ZOOM), ylim=(-ZOOM, ZOOM), title="(b) near z = 1: slow poles")
    handles, labels = left.get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=5, frameon=False)
    return figure


@styled
def step_response(curve: Curve, u: Quantity, y: Quantity) -> Figure:
    """Step response of the tangent linear model."""
    figure, axes = style.sheet(1, height=2.6)
    ax = axes[0, 0]
    ax.plot(curve.x, curve.y * y.factor, drawstyle="steps-post", color=style.MODEL)
    unit = f" [{y.unit}]" if y.unit else ""
    ax.set(xlabel="time after the step [s]", ylabel=f"{y.name}{unit}", title=f"unit step of {u.label}")
    ax.margins(x=0.01)
    return figure


@styled
def static_maps(maps: dict[str, Curve]) -> Figure:
    """The static curves before and after the linear block, over the range that the data visited."""
    figure, axes = style.sheet(1, len(maps), height=2.8)
    inside = {
        "input": ("input u", "into the linear block"),
        "output": ("out of the linear block", "output y"),
        "driver": ("input u", "motor voltage"),
        "map": ("actuator's position [strokes]", "output y"),
        "sensor": ("behind play and linkage", "output y"),
    }
    for ax, (role, curve) in zip(axes[0], maps.items(), strict=True):
        ax.plot(curve.x, curve.y, color=style.MODEL)
        x, y = inside.get(role, ("into the map", "out of the map"))
        ax.set(title="linkage" if role == "map" else f"{role} map", xlabel=x, ylabel=y)
    return figure


def _measured_and_model(
    ax, data: IOData, yhat: np.ndarray, y: Quantity, label: str, n: int | None = None, colour=style.MODEL
) -> None:
    style.line(ax, data.t[:n], data.y[:n, 0] * y.factor, color=style.INK, label="measured")
    style.line(ax, data.t[:n], yhat[:n] * y.factor, color=colour, label=label)
    ax.set_ylim(_frame(data.y[:, 0] * y.factor, yhat * y.factor))
    ax.margins(x=0.005)


def _frame(measured: np.ndarray, model: np.ndarray) -> tuple[float, float]:
    """Ends of a vertical axis: a model that runs away leaves the frame instead of flattening the data."""
    low, high = float(measured.min()), float(measured.max())
    width = high - low or 1.0
    pad, air = 0.35 * width, 0.1175 * width
    bottom, top = min(low, float(np.nanmin(model))), max(high, float(np.nanmax(model)))
    return max(low - pad, bottom - air), min(high + pad, top + air)


def _first_peak(y: np.ndarray) -> int:
    """Middle of the first stretch in which y is in the top 15 % of its range."""
    high = y >= y.max() - 0.15 * np.ptp(y)
    start = int(np.argmax(high))
    after = np.flatnonzero(~high[start:])
    stop = start + (int(after[0]) if len(after) else len(y) - start)
    return (start + stop) // 2


def _peak_width(y: np.ndarray) -> int:
    """Half a window [samples] that holds a peak: the mean distance between crossings of the middle, within reason."""
    middle = 0.5 * (y.max() + y.min())
    crossings = max(int(np.sum(np.diff(y > middle) != 0)), 1)
    return int(np.clip(len(y) / crossings * 0.6, 15, max(15, len(y) // 4)))
