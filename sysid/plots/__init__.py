"""The figures: what each kind shows is described in one file, with a line in `TABLE`. They compute no results.

Every function takes the data to show and, as `axes`, the Axes to draw into (a list for several panels); without `axes`
it makes a new figure. It returns the axes. Radians are shown as degrees. Shaded areas are intervals of the level in
the legend. Matplotlib is imported when something is drawn. The functions `..._figure` give the descriptions, which
`sysid.drawing` draws with matplotlib or plotly.
"""

from collections.abc import Callable
from typing import Any

from sysid.plots.comparison import comparison
from sysid.plots.free_runs import Run, close_ups, fitted, free_run, free_runs, simulated
from sysid.plots.frequency import response_fit
from sysid.plots.pole_zero import pole_zero, pole_zero_map
from sysid.plots.records import parts, record
from sysid.plots.residual_tests import higher_order_tests, residual_tests
from sysid.plots.responses import bode, impulse, steady_state, step
from sysid.plots.static_maps import static_curve, static_maps
from sysid.plots.usual import usual

TABLE: dict[str, Callable[..., Any]] = {
    "bode": bode,
    "close_ups": close_ups,
    "comparison": comparison,
    "fitted": fitted,
    "free_run": free_run,
    "free_runs": free_runs,
    "higher_order_tests": higher_order_tests,
    "impulse": impulse,
    "parts": parts,
    "pole_zero": pole_zero,
    "pole_zero_map": pole_zero_map,
    "record": record,
    "residual_tests": residual_tests,
    "response_fit": response_fit,
    "simulated": simulated,
    "static_curve": static_curve,
    "static_maps": static_maps,
    "steady_state": steady_state,
    "step": step,
    "usual": usual,
}

__all__ = [
    "TABLE",
    "Run",
    "bode",
    "close_ups",
    "comparison",
    "fitted",
    "free_run",
    "free_runs",
    "higher_order_tests",
    "impulse",
    "parts",
    "pole_zero",
    "pole_zero_map",
    "record",
    "residual_tests",
    "response_fit",
    "simulated",
    "static_curve",
    "static_maps",
    "steady_state",
    "step",
    "usual",
]
