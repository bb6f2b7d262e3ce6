"""The leg in three dimensions, as recorded: a figure to turn, with a slider over time, and two views for paper."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import mujoco
import numpy as np

from sysid.base import style
from sysid.base.style import styled
from sysid.drawing.plotly import GRID, Plotly, base_layout
from sysid.drawing.traces import PAPER
from sysid.report.page import Picture
from twin.parameters import Parameters
from twin.plant.leg import robot
from twin.view.stills import leg_points, on_stand

if TYPE_CHECKING:
    from matplotlib.axes import Axes

FRAMES = 101  # poses over the record
AXES = ("forward", "outward", "up")
COLOURS = (style.INK, style.MODEL)
# As near as all three names of axes stay inside the picture.
CAMERA = {"eye": {"x": 2.7, "y": 2.05, "z": 0.8}, "center": {"x": 0.0, "y": 0.05, "z": -0.27}}
FLAT = 0.01  # [m] across: less is a line
CROWDED = 0.2  # [m] of an axis, below which five numbers would cover each other
WIDTHS = (14, 6)  # of the links [px]: where two legs agree, both are seen
Course = Mapping[str, np.ndarray]  # angle (N,) [rad] by joint


@dataclass(frozen=True)
class Poses:
    """Positions [m] from the shoulder's axis, (frames, points, 3): forward, outward, up.

    `links`: shoulder, hip, knee, foot. `rods`: both ends of the thigh's and of the shank's actuator.
    """

    links: np.ndarray
    rods: np.ndarray


def poses(angles: Course, parameters: Parameters | None = None) -> Poses:
    """The leg at these joint angles (frames,) [rad] by MuJoCo's kinematics; joints without angles are at mid stroke."""
    p = parameters or Parameters()
    model = robot(p)
    data = mujoco.MjData(model)
    links, rods = list[np.ndarray](), list[np.ndarray]()
    for k in range(len(next(iter(angles.values())))):
        data.qpos[:] = on_stand(model, p, {joint: float(course[k]) for joint, course in angles.items()})
        mujoco.mj_kinematics(model, data)
        points, ends = leg_points(data)
        links.append(points - points[0])
        rods.append(ends - points[0])
    return Poses(np.array(links), np.array(rods))


def picture(name: str, t: np.ndarray, sides: Mapping[str, Course], parameters: Parameters | None = None) -> Picture:
    """The figure of one or two legs over times t (N,) [s]: `sides` are the joint angles (N,) [rad] by name."""
    samples = np.unique(np.linspace(0, len(t) - 1, min(FRAMES, len(t))).round().astype(int))
    courses = {side: {joint: _fill_gaps(y)[samples] for joint, y in course.items()} for side, course in sides.items()}
    legs = {side: poses(course, parameters) for side, course in courses.items()}
    names = " and ".join(side if side.startswith("the ") else f"the {side}" for side in sides)
    caption = (
        f"The leg as {names} {'move' if len(sides) > 1 else 'moves'} it, at {len(samples)} moments of the record; "
        "joints without a record are at mid stroke. Positions in metres from the shoulder's axis; the thin line is the "
        "way of the foot. Drag to turn it, move the slider for another moment. A picture without a slider has the two "
        "poses that lie farthest apart, one of them pale."
    )
    return Picture(name, style.png(draw(legs), few=True), caption, figure(t[samples], legs, courses))


def _fill_gaps(y: np.ndarray) -> np.ndarray:
    """The course without gaps."""
    is_finite = np.isfinite(y)
    return y if is_finite.all() else np.interp(np.arange(len(y)), np.flatnonzero(is_finite), y[is_finite])


def figure(t: np.ndarray, legs: Mapping[str, Poses], courses: Mapping[str, Course]) -> Plotly:
    """The legs at times t (frames,) [s] as a figure of plotly, with a slider whose text gives time and angles."""
    paths = [_path(side, legs_poses, COLOURS[k]) for k, (side, legs_poses) in enumerate(legs.items())]
    moving = [_traces(legs, 0), *(_traces(legs, k) for k in range(len(t)))]
    numbers = list(range(len(paths), len(paths) + len(moving[0])))
    frames = [{"name": str(k), "data": traces, "traces": numbers} for k, traces in enumerate(moving[1:])]
    points = np.concatenate([np.concatenate([p.links, p.rods], axis=1).reshape(-1, 3) for p in legs.values()])
    labels = [_label(float(t[k]), courses, k) for k in range(len(t))]
    return {"data": [*paths, *moving[0]], "layout": _layout(points, labels), "frames": frames}


def _traces(legs: Mapping[str, Poses], k: int) -> list[dict[str, Any]]:
    """Links and actuators of each leg in frame k."""
    traces = list[dict[str, Any]]()
    for n, (side, leg_poses) in enumerate(legs.items()):
        links, rods = leg_poses.links[k], leg_poses.rods[k]
        gap = np.full((1, 3), np.nan)
        rod_points = np.concatenate([rods[:2], gap, rods[2:]])
        look = {"type": "scatter3d", "mode": "lines+markers", "legendgroup": side}
        traces += [
            look
            | _points(links)
            | {
                "name": side,
                "line": {"color": COLOURS[n], "width": WIDTHS[n]},
                "marker": {"size": [6, 6, 6, 9], "color": COLOURS[n]},
                "text": ["shoulder", "hip", "knee", "foot"],
                "hovertemplate": f"{side}, %{{text}}<br>forward %{{x:.3f}} m, outward %{{y:.3f}} m, up %{{z:.3f}} m"
                "<extra></extra>",
            },
            look
            | _points(rod_points)
            | {
                "name": f"{side}, actuators",
                "line": {"color": style.INPUT if n == 0 else COLOURS[n], "width": 6},
                "marker": {"size": 3, "color": style.SECOND},
                "hoverinfo": "skip",
            },
        ]
    return traces


def _path(side: str, leg_poses: Poses, colour: str) -> dict[str, Any]:
    """The way of the foot."""
    line = {"color": colour, "width": 2}
    return {"type": "scatter3d", "mode": "lines", **_points(leg_poses.links[:, 3]), "name": f"{side}: foot"} | {
        "line": line,
        "legendgroup": side,
        "showlegend": False,
        "hoverinfo": "skip",
    }


def _points(places: np.ndarray) -> dict[str, list[float | None]]:
    """Coordinates to a tenth of a millimetre."""
    return {axis: [None if np.isnan(v) else round(float(v), 4) for v in places[:, k]] for k, axis in enumerate("xyz")}


def _label(t: float, courses: Mapping[str, Course], k: int) -> str:
    """Time and angles of a frame."""
    texts = [
        f"{side}: " + ", ".join(f"{joint} {np.degrees(course[joint][k]):.1f}°" for joint in course)
        for side, course in courses.items()
    ]
    return f"{t:.4g} s; {'; '.join(texts)}"


def _layout(points: np.ndarray, labels: list[str]) -> Plotly:
    """Axes, buttons and the slider of the figure that moves."""
    low, high = points.min(axis=0) - 0.04, points.max(axis=0) + 0.04
    axes = {
        f"{axis}axis": {
            "title": {"text": f"{name} [m]"},
            "range": [float(a), float(b)],
            "gridcolor": GRID,
            "backgroundcolor": PAPER,
            "zeroline": False,
            "nticks": 5 if b - a > CROWDED else 2,
        }
        for axis, name, a, b in zip("xyz", AXES, low, high, strict=True)
    }
    immediate = {"mode": "immediate", "transition": {"duration": 0}}
    redraw = immediate | {"frame": {"duration": 0, "redraw": True}}
    steps = [{"label": label, "method": "animate", "args": [[str(k)], redraw]} for k, label in enumerate(labels)]
    run = {"frame": {"duration": 60, "redraw": True}, "fromcurrent": True, "transition": {"duration": 0}}
    buttons = [
        {"label": "play", "method": "animate", "args": [None, run]},
        {"label": "stop", "method": "animate", "args": [[None], immediate]},
    ]
    side = {"x": 0, "xanchor": "left"}
    return base_layout(520) | {
        "scene": axes | {"aspectmode": "data", "camera": CAMERA},
        "margin": {"l": 8, "r": 8, "t": 30, "b": 8},
        "legend": {"orientation": "h", "x": 1, "xanchor": "right", "y": 1.0, "bgcolor": PAPER},
        "updatemenus": [
            {"type": "buttons", "direction": "right", "buttons": buttons, **side, "y": 1.0, "yanchor": "bottom"}
        ],
        "sliders": [
            {
                "steps": steps,
                **side,
                "len": 1.0,
                "pad": {"t": 6, "b": 6},
                "ticklen": 0,
                "minorticklen": 0,
                "tickcolor": PAPER,
                "font": {"size": 1, "color": PAPER},
                "currentvalue": {"xanchor": "left", "font": {"size": 12, "color": style.INK}},
            }
        ],
    }


@styled
def draw(legs: Mapping[str, Poses]) -> list[Axes]:
    """The two poses of each leg that lie farthest apart, and the way of its foot: from the side, and from above.

    A view from above is left out where the leg stays in one plane and it would show a line.
    """
    forward = np.concatenate([leg_poses.links[..., 0].ravel() for leg_poses in legs.values()])
    views = [("(a) from the side", (1, 2)), ("(b) from above", (1, 0))]
    if np.ptp(forward) < FLAT:
        views = [("from the side", (1, 2))]
    axes = style.panels(None, 1, len(views), height=3.4)
    for ax, (title, (i, j)) in zip(axes, views, strict=True):
        for n, (side, leg_poses) in enumerate(legs.items()):
            foot = leg_poses.links[:, 3]
            first = int(np.argmax(np.linalg.norm(foot - foot[0], axis=1)))
            last = int(np.argmax(np.linalg.norm(foot - foot[first], axis=1)))
            for k, alpha, label in ((first, 1.0, side), (last, 0.4, None)):
                x, y = leg_poses.links[k][:, i], leg_poses.links[k][:, j]
                ax.plot(x, y, "o-", color=COLOURS[n], linewidth=3, markersize=4, alpha=alpha, label=label)
            ax.plot(foot[:, i], foot[:, j], color=COLOURS[n], linewidth=0.8)
        ax.set(title=title, xlabel=f"{AXES[i]} [m]", ylabel=f"{AXES[j]} [m]")
        ax.set_aspect("equal", adjustable="datalim")
    style.legend(axes[0])
    return axes
