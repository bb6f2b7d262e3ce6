"""Traces of a log beside its twin: the error and the input under the frames of a replay, and all as an MCAP file."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from sysid.base import style
from sysid.base.errors import InputError
from sysid.base.files import atomic_file
from sysid.base.style import INK, INPUT, SECOND, line, styled

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from PIL.Image import Image

HEIGHT = 190  # [pixel] of the panel under a frame
MCAP_SUFFIX = ".mcap"
MCAP_SCHEMA = {
    "type": "object",
    "title": "qpal.Value",
    "properties": {"value": {"type": "number"}, "unit": {"type": "string"}},
    "required": ["value", "unit"],
}
NANOSECONDS = 1_000_000_000  # of a second


@dataclass(frozen=True)
class Traces:
    """Time t (N,) [s], input u (N,) [V], log and twin (N,) [rad] of one joint."""

    joint: str
    t: np.ndarray
    u: np.ndarray
    log: np.ndarray
    twin: np.ndarray

    @property
    def error(self) -> np.ndarray:
        """Log less twin (N,) [rad]."""
        return self.log - self.twin


def draw_error(axes: Axes, traces: Traces, mask: np.ndarray) -> None:
    """The error in degrees."""
    line(axes, traces.t[mask], np.rad2deg(traces.error[mask]), color=SECOND, linewidth=1.0)
    axes.axhline(0.0, color=INK, linewidth=0.6)
    axes.set_ylabel("error [deg]")
    axes.margins(x=0.01)


def draw_input(axes: Axes, traces: Traces, mask: np.ndarray) -> None:
    """The input in volts."""
    line(axes, traces.t[mask], traces.u[mask], steps=True, color=INPUT, linewidth=1.0)
    axes.set_ylabel("input [V]")
    axes.margins(x=0.01)


@dataclass(frozen=True)
class Panel:
    """A picture (height, width, 3) of both traces, and the columns [pixel] of the first and the last time shown."""

    picture: np.ndarray
    left: float
    right: float
    start: float
    stop: float

    def paste_below(self, image: Image, time: float) -> Image:
        """The image with this panel below it and a line at `time` [s]."""
        from PIL import Image as Images
        from PIL import ImageDraw

        strip = Images.fromarray(self.picture)
        share = (time - self.start) / max(self.stop - self.start, 1e-12)
        x = self.left + min(max(share, 0.0), 1.0) * (self.right - self.left)
        ImageDraw.Draw(strip).line([(x, 4), (x, strip.height - 4)], fill=style.MODEL, width=2)
        sheet = Images.new("RGB", (image.width, image.height + strip.height), "white")
        sheet.paste(image, (0, 0))
        sheet.paste(strip, (0, image.height))
        return sheet


@styled
def panel(traces: Traces, start: float, stop: float, width: int) -> Panel:
    """Both traces from `start` to `stop` [s], `width` pixels wide."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width / 80, HEIGHT / 80), dpi=80, layout="constrained")
    upper, lower = figure.subplots(2, 1, sharex=True)
    mask = (traces.t >= start) & (traces.t <= stop)
    draw_error(upper, traces, mask)
    draw_input(lower, traces, mask)
    lower.set(xlabel="time [s]", xlim=(start, stop))
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    picture = np.asarray(canvas.buffer_rgba())[:, :, :3].copy()
    box = lower.get_window_extent()
    return Panel(picture, float(box.x0), float(box.x1), start, stop)


def write_mcap(path: Path, traces: Traces) -> Path:
    """Write JSON messages that Foxglove, rerun and PlotJuggler read.

    Topics are /input, /log/JOINT, /twin/JOINT and /error/JOINT, one message a sample; times count from zero.

    Raises InputError if the library `mcap` is not installed, or if the suffix is not .mcap.
    """
    if path.suffix.lower() != MCAP_SUFFIX:
        raise InputError(f"{path} ends in {path.suffix or 'no suffix'!r}; give a name that ends in {MCAP_SUFFIX}")
    try:
        from mcap.writer import Writer
    except ImportError:
        raise InputError("writing MCAP needs the library mcap; install it with: pip install 'qpal[robot]'") from None
    topics = {
        "/input": (traces.u, "V"),
        f"/log/{traces.joint}": (traces.log, "rad"),
        f"/twin/{traces.joint}": (traces.twin, "rad"),
        f"/error/{traces.joint}": (traces.error, "rad"),
    }
    with atomic_file(path) as temporary, temporary.open("wb") as file:
        writer = Writer(file)
        writer.start(profile="", library="qpal")
        schema = writer.register_schema("qpal.Value", "jsonschema", json.dumps(MCAP_SCHEMA).encode())
        channels = {topic: writer.register_channel(topic, "json", schema) for topic in topics}
        for k, time in enumerate(np.round(traces.t * NANOSECONDS).astype(int).tolist()):
            for topic, (values, unit) in topics.items():
                value = float(values[k])
                if np.isfinite(value):  # JSON has no other numbers
                    message = json.dumps({"value": value, "unit": unit}).encode()
                    writer.add_message(channels[topic], log_time=time, publish_time=time, data=message, sequence=k)
        writer.finish()
    return path
