"""Free runs and measured output: one model over both parts of a record, or several models over one part."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

from sysid.base import style
from sysid.base.checks import checked
from sysid.base.style import styled
from sysid.plots._departure import frame_all
from sysid.plots._runs import Run, draw, first, output

if TYPE_CHECKING:
    from matplotlib.axes import Axes


@checked(own=("axes",))
@styled
def free_run(
    estimation: Run, validation: Run, one_step: Run | None = None, axes: Sequence[Axes] | None = None
) -> list[Axes]:
    """Measured output and the model's free run over both parts, and the error of the validation part.

    A model with a one-step-ahead prediction gets a separate panel for it.
    """
    rows = style.panels(axes, 3 if one_step is None else 4, height=5.4 if one_step is None else 7.2)
    draw(rows[0], replace(estimation, title="(a) estimation part"))
    draw(rows[1], replace(validation, title="(b) validation data, not used in the fit"))
    y = output(validation.data)
    error = (validation.data.y[:, 0] - validation.y) * y.factor
    style.line(rows[2], validation.data.t, error, color=style.SECOND, linewidth=0.9)
    rows[2].set(title="(c) validation error, measured minus free run", ylabel=y.label)
    measured = validation.data.y[:, 0] * y.factor
    frame_all(rows[2], measured - measured.mean(), error)
    rows[2].margins(x=0.005)
    if one_step is not None:
        title = "(d) one step ahead, NOT a free run"
        draw(rows[3], replace(one_step, title=title, what="one step ahead"), colour=style.INPUT)
    rows[-1].set(xlabel="time [s]")
    return rows


@checked(own=("axes",))
@styled
def free_runs(
    runs: Sequence[Run], axes: Sequence[Axes] | None = None, seconds: float | None = None, time: str = "time [s]"
) -> list[Axes]:
    """Measured output and free run of each model, one panel each, over the first `seconds` [s] or all samples.

    `time` labels the axis.
    """
    rows = style.panels(axes, len(runs), height=0.5 + 1.9 * len(runs), sharex=True)
    for ax, run in zip(rows, runs, strict=True):
        draw(ax, run, first(run.data, seconds))
    rows[-1].set(xlabel=time)
    return rows
