"""Correlations of residuals with their bounds."""

import numpy as np

from sysid.base import style
from sysid.diagnosis.residuals import ResidualTests
from sysid.report.zoom import _parts as parts
from sysid.report.zoom._parts import Figure, Row, Trace

LABEL, LAG = "correlation [1]", "lag [samples]"
UPPER, LOWER = [0.58, 1.0], [0.0, 0.42]  # of the height: each panel has lags of its own below it


def residual_tests(tests: ResidualTests) -> Figure:
    """Residuals with themselves over with the input; lags outside the bound are orange."""
    white, independent = tests.verdicts
    rows = [
        Row(LABEL, f"residuals with themselves: {white}"),
        Row(LABEL, f"residuals with the input; {independent}"),
    ]
    # Lag 0 of the residuals with themselves is 1 by definition.
    figure = parts.stacked(
        [
            *_lags(tests.lags[1:], tests.autocorrelation[1:], tests.whiteness_bound, 0),
            *_lags(tests.cross_lags, tests.cross_correlation, tests.independence_bound, 1),
        ],
        rows,
        LAG,
    )
    layout, last = figure["layout"], float(tests.lags[-1]) + 0.5
    layout["height"] += 40
    layout["xaxis2"] = parts.side(LAG, anchor="y", range=[0.0, last])
    layout["yaxis"]["domain"], layout["yaxis2"]["domain"] = UPPER, LOWER
    layout["annotations"][1]["y"] = LOWER[1]
    for row, bound in enumerate((tests.whiteness_bound, tests.independence_bound)):
        if np.isfinite(bound):
            area = {"type": "rect", "xref": "paper", "x0": 0, "x1": 1, "yref": parts.axis(row), "layer": "below"}
            named = {"name": f"{100 * tests.level:g} % bound for one lag", "showlegend": row == 0}
            layout["shapes"].append(
                area | named | {"y0": -bound, "y1": bound, "fillcolor": parts.BOUND, "line": {"width": 0}}
            )
    layout |= {"bargap": 0.55, "barmode": "overlay", "hovermode": "closest"}
    layout.pop("hoversubplots")
    return figure


def _lags(lags: np.ndarray, r: np.ndarray, bound: float, row: int) -> list[Trace]:
    outside = np.abs(r) > bound
    return [
        {
            "type": "bar",
            "x": lags[chosen].tolist(),
            "y": parts.numbers(r[chosen]),
            "name": name,
            "legendgroup": name,
            "showlegend": row == 0,
            "marker": {"color": colour},
            "hovertemplate": f"lag %{{x}} samples<br>correlation %{{y:.3f}}<br>bound ±{bound:.3f}<extra></extra>",
            "xaxis": "x2" if row == 0 else "x",
            "yaxis": parts.axis(row),
        }
        for chosen, colour, name in (
            (~outside, style.INK, "inside"),
            (outside, style.MODEL, "outside"),
        )
    ]
