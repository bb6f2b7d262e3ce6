"""A figure of a report: its section, its condition, its drawing function and its caption."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal

from sysid.base import style
from sysid.base.units import Quantity, shown
from sysid.report.page import Picture
from sysid.workflow.results import Evaluation

if TYPE_CHECKING:
    from matplotlib.axes import Axes

SectionTitle = Literal["Data", "Model output", "Model", "Residual tests"]
VALIDATION_TIME = "time in the validation data [s]"


def _always(evaluation: Evaluation) -> bool:
    return True


@dataclass(frozen=True)
class ReportFigure:
    """One figure of the report of `qpal identify`, made from an evaluation; other reports may use it.

    `draw` returns its axes and may take options from another report. The axes of a figure name their units, unless it
    shows only `pure` numbers. `zoom` gives the same as a figure of plotly, where there is one.
    """

    section: SectionTitle
    draw: Callable[..., Axes | Sequence[Axes]]
    caption: Callable[[Evaluation], str]
    applies: Callable[[Evaluation], bool] = _always
    pure: bool = False
    zoom: Callable[[Evaluation], dict[str, Any]] | None = None

    def picture(self, name: str, evaluation: Evaluation, lead: str = "", **options: Any) -> Picture | None:
        """The figure with its caption after `lead`; None if it does not apply to this model or record."""
        if not self.applies(evaluation):
            return None
        zoom = None if self.zoom is None or options else self.zoom(evaluation)
        return Picture(name, style.png(self.draw(evaluation, **options)), f"{lead}{self.caption(evaluation)}", zoom)


def signals(evaluation: Evaluation) -> tuple[Quantity, Quantity]:
    """Display of input and output."""
    data = evaluation.estimation
    return shown(data.u_name, data.u_unit), shown(data.y_name, data.y_unit)
