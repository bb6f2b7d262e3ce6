"""Zoomable figures as plain dictionaries of plotly, {"data": [...], "layout": {...}}, which plotly.js draws.

| call | what it shows |
| :-- | :-- |
| `record(data)` | inputs over outputs of an IOData, as recorded |
| `parts(estimation, validation)` | both parts of a record as a fit uses them |
| `free_run(evaluation)` | measured outputs, free run, errors and inputs over both parts |
| `one_step(evaluation)` | the same for the one-step-ahead prediction of a nonlinear ARX model |
| `runs(data, {name: y})` | measured outputs and the outputs (N,) or (N, ny) of several models, errors and inputs |
| `residual_tests(tests)` | correlations of residuals with themselves and with the input |
| `static_maps(curves)` | static maps with bands, from `sysid.uncertainty.curves` |
| `poles_zeros(poles, zeros, Ts)` | the z-plane; the hover gives natural frequency, damping and deviations |
| `bode(response)` | magnitude and phase with bands, from `sysid.uncertainty.responses.frequency` |
| `step(band)` | step response with its band |
| `values(values)` | physical values of an actuated joint with intervals |
| `growth(growth)` | parts that the growth of a joint tried |

`element(figure, name)` is the HTML of one figure, `script()` the text of plotly.js for a page, `DRAW` the script that
draws every such element in the page's colours. Radians are shown as degrees; a long line is thinned to its extremes;
`figure["layout"]["meta"]["said"]`, where it is, is a sentence that belongs into the caption.
"""

from sysid.report.embed import DRAW, element, script
from sysid.report.zoom._parts import Figure
from sysid.report.zoom.joint import growth, values
from sysid.report.zoom.maps import static_maps
from sysid.report.zoom.records import parts, record
from sysid.report.zoom.residuals import residual_tests
from sysid.report.zoom.responses import bode, step
from sysid.report.zoom.roots import poles_zeros
from sysid.report.zoom.runs import free_run, one_step, runs

__all__ = [
    "DRAW",
    "Figure",
    "bode",
    "element",
    "free_run",
    "growth",
    "one_step",
    "parts",
    "poles_zeros",
    "record",
    "residual_tests",
    "runs",
    "script",
    "static_maps",
    "step",
    "values",
]
