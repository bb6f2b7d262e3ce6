"""The page of `qpal models`: several saved models over one record."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from sysid.base import style
from sysid.base.files import versions
from sysid.base.quantities import display_quantity, number, percent
from sysid.base.style import styled
from sysid.plots import Run, free_runs
from sysid.report.page import Grid, Page, Picture, Section
from sysid.workflow.model_run import CLOSE, Models, comparable, criteria_of
from sysid.workflow.saved import one_output

if TYPE_CHECKING:
    from matplotlib.axes import Axes

SHOWN = 6  # models that get a line in the overlay, and a panel of their own
COLOURS = (style.MODEL, style.INPUT, "#5b8c3a", "#8b5fa8", "#b8860b", "#3f6fb5")


def page(result: Models) -> Page:
    """The whole report."""
    overlay = (
        "Measured output and the free runs of the models, best first. A free run uses only the input and the first "
        "outputs, which give its initial state and are not scored. Where all models leave the measurement together, "
        "they lack the same thing."
    )
    alone = "The same runs one by one. Look for the stretches where a model leaves the measurement."
    return Page(
        f"{len(result.runs)} models on {result.record.path.name}",
        f"{result.record.data.N} samples, Ts {result.record.data.Ts:g} s",
        sentences(result),
        [
            Section("Models", tables=tables(result), pictures=[Picture("overlay", style.png(draw(result)), overlay)]),
            Section("One by one", pictures=[Picture("one-by-one", style.png(draw_each(result)), alone)]),
        ],
        versions(),
    )


def sentences(result: Models) -> list[str]:
    """Which model is best, whether a smaller one does as well, and what to know of each."""
    best, smaller = result.best, result.smaller
    said = [f"{best.model.name} follows the record best: {percent(best.percent)} in free run."]
    if not best.percent > 0.0:
        said = [
            f"No model follows the record: none is better than the mean of the output; the least bad is "
            f"{best.model.name} with {percent(best.percent)} in free run."
        ]
    if smaller is not None:
        said.append(
            f"{smaller.model.name} is within {CLOSE:g} points of it ({percent(smaller.percent)}) with "
            f"{smaller.model.fit.criteria.d} parameters in place of {best.model.fit.criteria.d}: prefer it."
        )
    if not comparable(result):
        said.append(
            "FPE and AIC are not comparable here: they refer to records of other lengths, sampling times or units, or "
            "to errors of another kind."
        )
    if len(result.runs) > SHOWN:
        said.append(f"The figures show the best {SHOWN} of {len(result.runs)} models.")
    said += [f"Note: {note}." for note in result.notes]
    for run in result.runs:
        said += [f"Note on {run.model.name}: {note}." for note in run.notes if note not in result.notes]
    return said + ([best.next.sentence()] if best.next is not None else [])


def tables(result: Models) -> list[Grid]:
    """One row for each model, the best one first."""
    rows = []
    for run in result.runs:
        fit, was = run.model.fit, run.model.estimation
        rows.append(
            (
                "best" if run is result.best and run.percent > 0.0 else "",
                run.model.name,
                fit.model.structure.replace("_", " "),
                ",".join(map(str, run.model.as_dict()["orders"].values())) or "–",
                str(fit.criteria.d),
                f"{fit.Ts:g}",
                "–" if was is None else percent(was),
                percent(run.percent),
                number(fit.criteria.fpe),
                number(fit.criteria.aic),
                criteria_of(run),
            )
        )
    heads = (
        "",
        "model",
        "structure",
        "orders",
        "d",
        "Ts [s]",
        "estimation",
        "this record",
        "FPE",
        "AIC",
        "criteria of",
    )
    caption = "Fit of the free run; d is the number of free parameters; FPE and AIC are those of the estimation data"
    return [Grid(heads, rows, caption, text_columns=4, last_text=True)]


@styled
def draw(result: Models) -> Sequence[Axes]:
    """Measured output and all free runs, one panel for each output."""
    outputs = range(result.best.data.y.shape[1])
    rows = style.panels(None, len(outputs), height=0.8 + 3.0 * len(outputs), sharex=True)
    for j, ax in zip(outputs, rows, strict=True):
        e = one_output(result.best.data, j)
        y = display_quantity(e.y_name, e.y_unit)
        style.line(ax, e.t, e.y[:, 0] * y.factor, color=style.INK, linewidth=1.8, label="measured")
        for run, colour in zip(result.runs[:SHOWN], COLOURS, strict=False):
            name = f"{run.model.name}, {percent(run.percents[j])}"
            style.line(ax, run.data.t, run.output[:, j] * y.factor, color=colour, linewidth=1.0, label=name)
        ax.set(ylabel=y.label)
        ax.margins(x=0.005)
        ax.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=3, borderaxespad=0.1, handlelength=1.6)
    rows[-1].set(xlabel="time [s]")
    return rows


@styled
def draw_each(result: Models) -> Sequence[Axes]:
    """The first output with each free run in a panel of its own."""
    return free_runs(
        [Run(one_output(r.data, 0), r.output[:, 0], r.percents[0], r.model.name) for r in result.runs[:SHOWN]]
    )
