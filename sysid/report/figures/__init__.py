"""The figures of the report of `qpal identify`: one file and one line in `TABLE` each, shown in that order.

The name of a figure is its file name in figures/. `sysid.plots` draws figures that others also use. Nothing here
computes; the numbers come from an evaluation.
"""

from sysid.report.figures import (
    bode,
    close_up,
    data,
    free_run,
    growth,
    pole_zero,
    residuals,
    static_maps,
    step_response,
    values,
)
from sysid.report.figures._figure import VALIDATION_TIME, ReportFigure, SectionTitle, signals
from sysid.report.page import Picture
from sysid.workflow.results import Evaluation, single_channels

TABLE: dict[str, ReportFigure] = {
    "data": data.FIGURE,
    "free-run": free_run.FIGURE,
    "close-up": close_up.FIGURE,
    "pole-zero": pole_zero.FIGURE,
    "step-response": step_response.FIGURE,
    "bode": bode.FIGURE,
    "static-maps": static_maps.FIGURE,
    "values": values.FIGURE,
    "growth": growth.FIGURE,
    "residuals": residuals.FIGURE,
}


def pictures(section: SectionTitle, evaluation: Evaluation) -> list[Picture]:
    """The figures of one section for this evaluation."""
    chosen = [(name, figure) for name, figure in TABLE.items() if figure.section == section]
    each = single_channels(evaluation, section)  # one for each of several outputs
    found = (figure.picture(name + mark, one, lead) for name, figure in chosen for mark, lead, one in each)
    return [picture for picture in found if picture is not None]


__all__ = ["TABLE", "VALIDATION_TIME", "ReportFigure", "SectionTitle", "pictures", "signals"]
