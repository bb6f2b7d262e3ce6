"""A frequency response that was measured, and the model that was fitted to it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from sysid.base import style
from sysid.base.checks import checked
from sysid.base.quantities import Quantity, display_quantity
from sysid.drawing.axes import draw
from sysid.drawing.figure import Axis, Figure, Item, Line, Panel, Points, Rule
from sysid.estimation.frequency_fit import ResponseFit
from sysid.plots.responses import curve_items, phase_axis
from sysid.uncertainty.responses import of_response_fit

if TYPE_CHECKING:
    from matplotlib.axes import Axes


@checked(deferred=("axes",))
def response_fit(result: ResponseFit, axes: Sequence[Axes] | None = None) -> list[Axes]:
    """Measured response and fitted model with its band, magnitude over phase, and the errors below."""
    return draw(response_fit_figure(result), axes)


def response_fit_figure(result: ResponseFit) -> Figure:
    """Data and model with its band, magnitude over phase, and below the errors in their deviations."""
    data, model = result.data, of_response_fit(result)
    gain = display_quantity("magnitude", data.y_unit).per(display_quantity("", data.u_unit))
    size = np.abs(data.response) * gain.factor
    # Phases of the data beside those of the model, whatever the turns between the rows.
    own = np.degrees(np.angle(result.response(data.w)[0]))
    turns = np.interp(np.log(data.w), np.log(model.phase.x), model.phase.value) - own
    apart = np.degrees(np.angle(data.response)) - own
    phase = own + 360.0 * np.round(turns / 360.0) + (apart + 180.0) % 360.0 - 180.0
    x = Axis("frequency [rad/s]", "frequency", "rad/s", log=True)
    shown = size[size > 0.0]
    y = Axis(gain.label, gain.name, gain.unit, log=True, limits=(0.5 * float(shown.min()), 2.0 * float(shown.max())))
    dots: list[Item] = [Points(data.w, size, "data", style.INK)]
    errors: list[Item] = [
        Line(data.w, result.misfit.real, "real part", style.MODEL, dots=True),
        Line(data.w, result.misfit.imag, "imaginary part", style.INPUT, dots=True),
        Rule(0.0, upright=False, width=0.5),
    ]
    panels = [
        Panel([*curve_items(model.magnitude, "model", 1.0, gain.factor), *dots], y, x, weight=1.3),
        Panel(
            [
                *curve_items(model.phase, "model", 1.0, 1.0, key=False),
                Points(data.w, phase, "data", style.INK, key=False),
            ],
            phase_axis(np.append(model.phase.value, phase)),
            x,
        ),
        Panel(errors, Axis.of(Quantity("error / deviation", "")), x, weight=0.9),
    ]
    return Figure(panels, height=6.2)
