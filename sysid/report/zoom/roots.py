"""Poles and zeros in the z-plane; the hover tells what each means for the motion."""

from collections.abc import Mapping, Sequence

import numpy as np

from sysid.base import style
from sysid.base.units import number, pole
from sysid.report.zoom import _parts as parts
from sysid.report.zoom._parts import Figure, Trace
from sysid.uncertainty.intervals import Interval, Root

NEAR = 0.08  # half the height of the view about z = 1, where slow poles crowd
REACH = 1.15  # half the width of the view of the unit circle
MARKS = ("cross-thin-open", "triangle-up-open", "triangle-down-open")


def poles_zeros(
    poles: Sequence[Root | complex] | np.ndarray,
    zeros: Sequence[Root | complex] | np.ndarray = (),
    Ts: float = 1.0,
    references: Mapping[str, np.ndarray] | None = None,
) -> Figure:
    """Poles (crosses) with their regions and zeros (rings); `references` are other poles, by name.

    The hover gives natural frequency [rad/s], damping and time constant [s] for the sampling time Ts [s], with
    standard deviations of roots that have them.
    """
    traces: list[Trace] = [_circle()]
    for roots, name, symbol, colour in (
        (poles, "pole", "x-thin-open", style.MODEL),
        (zeros, "zero", "circle-open", style.INPUT),
    ):
        traces += _regions(roots, colour, name)
        traces += _marks(roots, name, symbol, colour, Ts)
    for (name, values), symbol in zip((references or {}).items(), MARKS, strict=False):
        traces += _marks(np.atleast_1d(values), name, symbol, style.INK, Ts)
    layout = parts.base("real part [1]", "imaginary part [1]", height=460)
    far = max([1.0, *(abs(_value(r)) for r in [*poles, *zeros])])
    reach = REACH * far  # no root is outside
    layout["xaxis"] |= {"range": [-reach, reach], "constrain": "domain"}
    layout["yaxis"] |= {"range": [-reach, reach], "scaleanchor": "x"}
    _views(layout, reach, [_value(r) for r in [*poles, *zeros]])
    return {"data": traces, "layout": layout}


def _views(layout: Figure, reach: float, every: Sequence[complex]) -> None:
    """Buttons: the unit circle, and the slow poles where there are some."""
    if not any(abs(z.imag) < NEAR and abs(z.real - 1 + 0.5 * NEAR) < NEAR for z in every):
        return
    views = (
        ("unit circle", (-reach, reach), (-reach, reach)),
        ("near z = 1", (1 - 1.5 * NEAR, 1 + 0.5 * NEAR), (-NEAR, NEAR)),
    )
    buttons = [
        {"label": name, "method": "relayout", "args": [{"xaxis.range": list(x), "yaxis.range": list(y)}]}
        for name, x, y in views
    ]
    place = {"x": 0, "xanchor": "left", "y": 1.0, "yanchor": "bottom", "pad": {"b": 4}}
    layout["updatemenus"] = [{"type": "buttons", "direction": "right", "buttons": buttons, **place}]


def _circle() -> Trace:
    angle = np.linspace(0.0, 2.0 * np.pi, 181)
    line = {"color": style.SECOND, "width": 1}
    return _shape(np.cos(angle), np.sin(angle), "unit circle") | {"line": line, "showlegend": False}


def _shape(x: np.ndarray, y: np.ndarray, name: str) -> Trace:
    shape = {"type": "scatter", "mode": "lines", "x": x.tolist(), "y": y.tolist(), "name": name}
    return shape | {"hoverinfo": "skip", "showlegend": False}


def _regions(roots: Sequence[Root | complex] | np.ndarray, colour: str, name: str) -> list[Trace]:
    """An ellipse for a complex root, a bar for a real one; nothing where the record does not determine it."""
    found = []
    angle = np.linspace(0.0, 2.0 * np.pi, 61)
    for root in (r for r in roots if isinstance(r, Root)):
        a, b, tilt = root.ellipse()
        if not np.isfinite(a) or a == 0.0:
            continue
        z = root.value + np.exp(1j * tilt) * (a * np.cos(angle) + 1j * b * np.sin(angle))
        look = {"line": {"color": colour, "width": 1 if b else 5}, "opacity": 0.45}
        area = {"fill": "toself", "fillcolor": parts.BAND} if b else {}
        found.append(_shape(z.real, z.imag, f"{100 * root.level:g} % region") | look | area | {"legendgroup": name})
    return found


def _marks(roots: Sequence[Root | complex] | np.ndarray, name: str, symbol: str, colour: str, Ts: float) -> list[Trace]:
    if not len(roots):
        return []
    z = np.array([_value(r) for r in roots])
    return [
        {
            "type": "scatter",
            "mode": "markers",
            "x": z.real.tolist(),
            "y": z.imag.tolist(),
            "name": name,
            "legendgroup": name,
            "marker": {"symbol": symbol, "size": 11, "color": colour, "line": {"width": 2, "color": colour}},
            "hovertext": [_meaning(r, name, Ts) for r in roots],
            "hoverinfo": "text",
        }
    ]


def _meaning(root: Root | complex, name: str, Ts: float) -> str:
    z = _value(root)
    sign = "" if abs(z.imag) < 5e-5 else f" {'−' if z.imag < 0 else '+'} {abs(z.imag):.4f}i"
    lines = [f"<b>{name}</b> z = {pole(complex(z.real))}{sign}", f"|z| = {number(abs(z), 5)}"]
    known = isinstance(root, Root)
    if z != 0 and abs(z) != 1.0:
        s = np.log(complex(z)) / Ts
        frequency, damping, lag = abs(s), -s.real / abs(s), -Ts / np.log(abs(z))
        lines += [
            f"natural frequency {number(frequency, 4)} rad/s{_spread(root.frequency) if known else ''}",
            f"damping ratio {number(damping, 3)}{_spread(root.damping) if known else ''}",
            f"time constant {number(lag, 4)} s{_spread(root.time_constant) if known else ''}" if lag > 0 else "grows",
        ]
    if isinstance(root, Root):
        lines.append(f"standard deviation of z {number(root.std, 2)}" if np.isfinite(root.std) else "no interval")
        lines += [root.note] if root.note else []
    return "<br>".join(lines)


def _spread(interval: Interval) -> str:
    return f" ± {number(interval.std, 2)} (std)" if np.isfinite(interval.std) else ""


def _value(root: Root | complex) -> complex:
    return root.value if isinstance(root, Root) else complex(root)
