"""A replay as pictures: a strip along the record, numbered frames, a GIF; and pictures of a crawl. Needs no display."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import mujoco
import numpy as np

from sysid.base.errors import InputError
from sysid.base.style import INK, legend, line, styled
from twin.parameters import JOINTS, Parameters
from twin.plant.leg import LEGS, robot
from twin.view.replay import GHOST, Replay
from twin.view.stills import HEIGHT, WIDTH, draw, draw_robot, mid_stroke
from twin.view.traces import Traces, draw_error, draw_input, panel

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from PIL.Image import Image

    from twin.robot.crawl import Crawl

RATE, GIF_RATE = 20.0, 10.0  # [1/s] of wall time; a GIF counts in hundredths of a second
GIF = 480, 360  # pixels of a frame of a GIF: a small file, drawn in half the time of a larger one
MOST_FRAMES = 2000
BATCH = 50  # frames per drawing process: limits the memory in use
STRIP_COUNTS = (2, 12)  # fewest and most frames in a strip
STAND_HEIGHT = 0.323  # [m] height of the torso at which the feet just touch the floor at mid stroke
SIDES = (
    {"azimuth": 140.0, "elevation": -18.0},
    {"azimuth": 180.0, "elevation": -8.0},
    {"azimuth": 90.0, "elevation": -89.0, "distance": 1.7},
)
CRAWL_STILL, CRAWL_FRAME = (480, 360), (400, 300)  # [pixel]
FILM_FRAMES = 60  # of a crawl, about
FILM_SECONDS = 8.0  # that it lasts


@dataclass(frozen=True)
class Names:
    """Names of the solid leg and the ghost leg in a picture."""

    leg: str
    ghost: str | None = None


def frame_times(replay: Replay, speed: float, rate: float = RATE) -> np.ndarray:
    """Times [s] after the start of frames (n,) that show the replay at `speed` times real time, `rate` frames a second
    of wall time; raises InputError for too many frames."""
    n = int(np.floor(replay.length / speed * rate)) + 1
    if n > MOST_FRAMES:
        speed_needed = int(np.ceil(replay.length * rate / (MOST_FRAMES - 1)))
        raise InputError(
            f"{replay.length:g} s at speed {speed:g} are {n} frames of {rate:g} a second; at most {MOST_FRAMES} are "
            f"drawn: give --speed {speed_needed} or show a part with --start and --stop"
        )
    return np.arange(n) * speed / rate


def frames(
    replay: Replay,
    times: np.ndarray,
    names: Names,
    tell: Callable[[int], None] = lambda count: None,
    traces: Traces | None = None,
    size: tuple[int, int] = (WIDTH, HEIGHT),
) -> Iterator[Image]:
    """Captioned pictures of the replay at `times` (n,) [s]; `tell` receives the number of drawn pictures.

    With `traces` error and input stand below each picture, with a line at its time. Raises NoRenderer if this machine
    cannot draw.
    """
    trace_panel = None if traces is None else panel(traces, replay.start, replay.start + replay.length, size[0])
    for first in range(0, len(times), BATCH):
        part = times[first : first + BATCH]
        poses = np.array([replay.pose(time) for time in part])
        pictures = draw(replay.model, poses, [replay.camera()] * len(part), stand=True, size=size, film=True)
        for picture, time in zip(pictures, part, strict=True):
            image = _add_caption(picture, f"{replay.start + time:.1f} s", names)
            yield image if trace_panel is None else trace_panel.paste_below(image, replay.start + time)
        tell(first + len(part))


def save_frames(images: Iterator[Image], folder: Path) -> int:
    """Write frame-0001.png and so on into `folder`; returns their number."""
    n = 0
    for n, image in enumerate(images, 1):
        image.save(folder / f"frame-{n:04d}.png")
    return n


def save_gif(images: Iterator[Image], path: Path) -> None:
    """Write the frames as one GIF that starts again after its end."""
    palette_images = (image.quantize(128) for image in images)
    first = next(palette_images)
    first.save(path, "GIF", save_all=True, append_images=palette_images, duration=round(1000 / GIF_RATE), loop=0)


@styled
def strip(replay: Replay, names: Names, count: int, traces: Traces | None = None) -> Figure:
    """`count` frames along the replay with their times, above the plot of the angles; then error and input."""
    from matplotlib.figure import Figure

    if not STRIP_COUNTS[0] <= count <= STRIP_COUNTS[1]:
        raise InputError(f"the strip has {count} frames; give {STRIP_COUNTS[0]} to {STRIP_COUNTS[1]} frames")
    times = np.linspace(0, replay.length, count)
    poses = np.array([replay.pose(time) for time in times])
    pictures = draw(replay.model, poses, [replay.camera()] * count, stand=True, size=(480, 480))
    joints = _moving(replay)
    side = 2.0 if count >= 4 else 8.0 / count  # [inch]
    trace_plots = (draw_error, draw_input) if traces is not None else ()
    rows = len(joints) + len(trace_plots)
    figure = Figure(figsize=(side * count, side + 0.4 + 1.35 * rows), layout="constrained")
    grid = figure.add_gridspec(1 + rows, count, height_ratios=[side] + [1.2] * rows)
    for k, (picture, time) in enumerate(zip(pictures, times, strict=True)):
        axes = figure.add_subplot(grid[0, k])
        axes.imshow(picture)
        axes.set_axis_off()
        axes.text(0.5, -0.04, f"{replay.start + time:.1f} s", transform=axes.transAxes, ha="center", va="top")
    for row, joint in enumerate(joints, 1):
        axes = figure.add_subplot(grid[row, :])
        _trace(axes, replay, names, joint, times)
        if row == 1:
            legend(axes)
        if row == rows:
            axes.set_xlabel("time [s]")
        else:
            axes.tick_params(labelbottom=False)
    if traces is not None:
        mask = (traces.t >= replay.start) & (traces.t <= replay.start + replay.length)
        for row, draw_trace in enumerate(trace_plots, 1 + len(joints)):
            axes = figure.add_subplot(grid[row, :])
            draw_trace(axes, traces, mask)
            axes.tick_params(labelbottom=row == rows)
        axes.set_xlabel("time [s]")
    return figure


@styled
def robot_views(parameters: Parameters | None = None) -> Figure:
    """The robot on its floor at mid stroke, from three sides."""
    from matplotlib.figure import Figure

    pictures = draw(robot(parameters), np.array([standing_pose(parameters)] * len(SIDES)), SIDES)
    figure = Figure(figsize=(10.0, 2.6), layout="constrained")
    for k, picture in enumerate(pictures, 1):
        axes = figure.add_subplot(1, len(SIDES), k)
        axes.imshow(picture)
        axes.set_axis_off()
    return figure


def standing_pose(parameters: Parameters | None = None) -> np.ndarray:
    """Pose (nq,) of `robot()`: every joint at mid stroke, feet at the floor."""
    qpos = mid_stroke(robot(parameters), parameters or Parameters())
    qpos[2] = STAND_HEIGHT
    return qpos


def standing_robot() -> tuple[mujoco.MjModel, np.ndarray]:
    """The robot to simulate and its pose (nq,) on the floor; viewers give its motors sliders up to rated voltage."""
    parameters = Parameters()
    model = robot(parameters)
    for suffix in LEGS.values():
        for joint in JOINTS:
            voltage = parameters[f"{joint}.rated_voltage"]
            actuator = model.actuator(joint + suffix)
            actuator.ctrllimited, actuator.ctrlrange = True, (-voltage, voltage)
    return model, standing_pose(parameters)


def _moving(replay: Replay) -> list[str]:
    parts = [part for part in (replay.leg, replay.ghost) if part is not None]
    return [joint for joint in JOINTS if any(joint in part.angles for part in parts)]


def _trace(axes, replay: Replay, names: Names, joint: str, times: np.ndarray) -> None:
    """Draw the angle of a joint over time, with a mark at each frame."""
    for part, name, colour, width in (  # the ghost has the thinner line, so that both are visible where they agree
        (replay.leg, names.leg, INK, 1.9),
        (replay.ghost, f"{names.ghost} (ghost)", GHOST[:3], 1.0),
    ):
        if part is None or joint not in part.angles:
            continue
        mask = (part.t >= replay.start) & (part.t <= replay.start + replay.length)
        angles = np.rad2deg(part.angles[joint][mask])
        line(axes, part.t[mask], angles, color=colour, linewidth=width, label=name)
        marks = [np.rad2deg(part.angles_at(replay.start + time)[joint]) for time in times]
        axes.plot(replay.start + times, marks, "o", color=colour, markersize=3 + 1.6 * width)
    axes.set_ylabel(f"{joint} [deg]")
    axes.margins(x=0.01)


def _add_caption(picture: np.ndarray, text: str, names: Names) -> Image:
    """The picture with its time and the names of its legs."""
    from PIL import Image, ImageDraw, ImageFont

    image = Image.fromarray(picture)
    pen, font = ImageDraw.Draw(image), ImageFont.load_default(18 if image.width >= WIDTH else 14)
    pen.text((14, 10), text, fill=INK, font=font)
    pen.text((14, image.height - 32), names.leg, fill=INK, font=font)
    if names.ghost is not None:
        colour = tuple(round(255 * part) for part in GHOST[:3])
        pen.text((image.width - 14, image.height - 32), f"{names.ghost} (ghost)", fill=colour, font=font, anchor="ra")
    return image


@dataclass(frozen=True)
class CrawlPictures:
    """`stills`: label, time [s] and picture (360, 480, 3); `film` (n, 300, 400, 3) lasts FILM_SECONDS and runs
    at `times` the real speed [1]. All uint8."""

    stills: list[tuple[str, float, np.ndarray]]
    film: list[np.ndarray]
    times: float


def crawl_pictures(result: Crawl) -> CrawlPictures:
    """Pictures of the nominal robot's crawl. Raises twin.view.stills.NoRenderer if this machine cannot draw."""
    walk, moves = result.walk, result.plan.moves
    ends = [start for start, _ in moves[1:]] + [len(walk.qpos)]
    first = [(name, (start + end) // 2) for (start, name), end in zip(moves, ends, strict=True)][:8]
    moments = [(f"{name} swings", k) for name, k in first if name not in ("stand", "body moves")]
    moments = [("start", 0), *moments, ("end", len(walk.qpos) - 1)]
    middle = 0.5 * (walk.torso[0, 0] + walk.torso[-1, 0])
    camera = {"lookat": (middle, 0.0, 0.24), "distance": 1.05 + middle, "azimuth": 122.0, "elevation": -14.0}
    model = robot(walk.parameters)
    stills = draw_robot(walk.qpos[[k for _, k in moments]], camera, model, CRAWL_STILL)
    frames = np.unique(np.linspace(0, len(walk.qpos) - 1, FILM_FRAMES).astype(int))
    film = draw_robot(walk.qpos[frames], camera, model, CRAWL_FRAME)
    return CrawlPictures(
        [(name, float(walk.t[k]), picture) for (name, k), picture in zip(moments, stills, strict=True)],
        film,
        float(walk.t[-1]) / FILM_SECONDS,
    )
