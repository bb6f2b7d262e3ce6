"""Poles and zeros of the linear block."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from sysid.base.units import poles
from sysid.plots import pole_zero_map
from sysid.report import zoom
from sysid.report.figures._figure import ReportFigure
from sysid.workflow.results import Evaluation

if TYPE_CHECKING:
    from matplotlib.axes import Axes


def draw(e: Evaluation, references: Mapping[str, np.ndarray] | None = None) -> Sequence[Axes]:
    """Poles, with confidence regions if available, and zeros; `references` are other poles by name."""
    return pole_zero_map(e.roots or e.poles, e.zeros, references=references)


def caption(e: Evaluation) -> str:
    """Whether the model is stable."""
    inside = "all poles are inside the unit circle; the model is stable"
    if not e.stable:
        inside = (
            f"{int(np.sum(np.abs(e.poles) >= 1))} pole(s) are on or outside the unit circle; the model is not stable"
        )
    return f"Poles and zeros of the linear block: {inside} (poles {poles(e.poles)})."


def applies(e: Evaluation) -> bool:
    """If there is a linear block."""
    return e.linear


def zoomed(e: Evaluation) -> zoom.Figure:
    """The same to zoom."""
    return zoom.poles_zeros(e.roots or e.poles, e.zeros, e.fit.Ts)


FIGURE = ReportFigure("Model", draw, caption, applies, pure=True, zoom=zoomed)
