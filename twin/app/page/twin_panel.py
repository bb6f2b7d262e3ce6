"""The twin beside the record: comparison and calibration, and the leg that moves as the record says.

The leg is a few cylinders between points, which MuJoCo's forward kinematics gives.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from typing import Any

import mujoco
import numpy as np
from nicegui import run, ui

from twin.app.entries import Data
from twin.app.page.answer import heading
from twin.app.page.panel import RecordPanel, attempt, delete_button, note
from twin.parameters import JOINTS, Parameters
from twin.plant.leg import BENCH_LEG, robot
from twin.view.stills import leg_points, on_stand

FRAME = 0.08  # [s] between poses while it plays
TORSO, LINK, FOOT, MOTOR, ROD, STAND = "#475569", "#2f6f8f", "#1f2933", "#c2410c", "#9aa5b1", "#64748b"


@dataclass(frozen=True)
class Bar:
    """A cylinder of `radius` [m] from `start` to `stop` (3,) [m]; equal points are a ball."""

    name: str
    radius: float
    start: np.ndarray
    stop: np.ndarray
    colour: str

    @property
    def length(self) -> float:
        """Distance of its ends [m]."""
        return float(np.linalg.norm(self.stop - self.start))

    def turn(self) -> np.ndarray:
        """Rotation (3, 3) that takes the y axis, along which a cylinder of the scene lies, to this bar."""
        if self.length < 1e-9:
            return np.eye(3)
        axis = (self.stop - self.start) / self.length
        helper = np.array([1.0, 0.0, 0.0]) if abs(axis[0]) < 0.9 else np.array([0.0, 0.0, 1.0])
        side = np.cross(helper, axis)
        side /= np.linalg.norm(side)
        return np.column_stack([side, axis, np.cross(side, axis)])


class Leg:
    """The front left leg on a stand; joints without a record are at mid stroke."""

    def __init__(self, parameters: Parameters | None = None) -> None:
        self._parameters = parameters or Parameters()
        self._model = robot(self._parameters)
        self._data = mujoco.MjData(self._model)

    def bars(self, angles: Mapping[str, float]) -> list[Bar]:
        """The bars at these joint angles [rad], always of the same names in the same order."""
        data = self._data
        data.qpos[:] = on_stand(self._model, self._parameters, angles)
        mujoco.mj_kinematics(self._model, data)
        torso = np.array(data.body("torso").xpos)
        (hub, thigh, shank, foot), ends = leg_points(data)
        floor = np.array([torso[0], torso[1], 0.0])
        cylinders = [
            Bar("stand", 0.02, floor, torso, STAND),
            Bar("torso", 0.05, torso, hub, TORSO),
            Bar("shoulder", 0.03, hub, thigh, LINK),
            Bar("thigh", 0.024, thigh, shank, LINK),
            Bar("shank", 0.02, shank, foot, LINK),
            Bar("foot", 0.03, foot, foot, FOOT),
        ]
        for joint, base, rod in zip(JOINTS[1:], ends[::2], ends[1::2], strict=True):
            shell = 0.8 * self._model.tendon_range[self._model.tendon(joint + BENCH_LEG).id, 0]
            tip = base + (rod - base) / np.linalg.norm(rod - base) * shell
            cylinders += [Bar(f"{joint} cylinder", 0.014, base, tip, MOTOR), Bar(f"{joint} rod", 0.007, tip, rod, ROD)]
        return cylinders


class StudyPanel(RecordPanel):
    """Compare a record with the twin, or calibrate the twin from it."""

    title = "4  Twin"
    fields = ("joint",)
    empty = "Add a record of the leg first."

    def state(self) -> Any:
        return super().state(), tuple(self.desk.session.studies), tuple(self.desk.session.data), self.view.detail

    def draw_record(self, key: str, entry: Data) -> None:
        note("The whole log drives the twin, without preparation. Both take a minute or more.")
        joint = ui.select(list(JOINTS), value=entry.joint or None, label="joint of the log").classes("w-full")
        joint.props("dense").on_value_change(lambda e: self.desk.session.change_data(key, joint=e.value or ""))
        options = {other: f"{other}  {e.name}" for other, e in self.desk.session.data.items() if other != key}
        further = ui.select(options, multiple=True, label="calibrate to these records too", value=[])
        further.props("dense use-chips options-dense data-mark=calibrate-further").classes("w-full min-w-0")
        further.set_visibility(bool(options))

        def study(kind: str) -> None:
            records = further.value if kind == "calibrate" else ()
            attempt(lambda: self.desk.study(key, kind, joint.value or "", records))

        with ui.row().classes("gap-2"):
            for kind, words in (("compare", "Compare"), ("calibrate", "Calibrate")):
                ui.button(words, on_click=partial(study, kind)).props(f"outline dense data-mark={kind}").classes(
                    "q-px-md"
                )
        for name, entry_of_study in self.desk.session.studies.items():
            with ui.row().classes("items-center no-wrap w-full"):
                words = f"{name}  {heading(entry_of_study)}, {entry_of_study.seconds:.0f} s"
                ui.button(words, on_click=lambda name=name: self._show(name)).props("flat dense no-caps align=left")
                delete_button(partial(self.desk.remove, "studies", name), "Delete this study")

    def _show(self, name: str) -> None:
        self.view.detail = ("studies", name)


class LegPanel(RecordPanel):
    """The leg in three dimensions at a time of the record."""

    title = "The leg at a time of the record"
    _leg: Leg | None = None

    fields = ("joint", "notes", "problem")
    empty = "The leg moves here as the record says."

    def draw_record(self, key: str, entry: Data) -> None:
        joint, data = entry.joint, self.samples(key)
        if data is None:
            return
        if not joint or data.y_unit != "rad":
            note("The leg moves where the output is an angle of a joint: name the joint under 4 Twin.")
            return
        box = ui.column().classes("w-full gap-2")
        ui.timer(0.01, lambda: self._draw_scene(box, joint, data), once=True)

    async def _draw_scene(self, box: ui.column, joint: str, data: Any) -> None:
        """The scene; the first time the model is compiled in a thread, so that the page goes on."""
        if LegPanel._leg is None:
            LegPanel._leg = await run.io_bound(Leg)
        with box:
            self._scene(LegPanel._leg or Leg(), joint, data)

    def _scene(self, leg: Leg, joint: str, data: Any) -> None:
        """Draw the leg with its slider over time and the button that plays the record."""
        y, Ts, last = data.y[:, 0], data.Ts, (data.N - 1) * data.Ts
        first = leg.bars({joint: float(y[0])})
        with ui.scene(height=300, grid=(2, 20), background_color="#f5f7fa", fps=15).classes("w-full") as scene:
            shapes = [_shape(scene, bar) for bar in first]
        scene.move_camera(x=0.72, y=0.72, z=0.5, look_at_x=0.12, look_at_y=0.2, look_at_z=0.27, duration=0)

        def pose(t: float) -> None:
            for bar, shape in zip(leg.bars({joint: angle_at(t, y, Ts)}), shapes, strict=True):
                _place(shape, bar)
            angle = angle_at(t, y, Ts) * 57.29577951308232
            words.set_text(f"{t:.1f} of {last:.1f} s, {joint} {angle:.1f} deg")

        with ui.row().classes("w-full items-center no-wrap gap-2"):
            play = ui.button(icon="play_arrow").props("flat dense round").props("data-mark=play")
            slider = ui.slider(min=0, max=last, step=Ts, value=0).classes("grow").props("data-mark=time")
            words = ui.label("").classes("text-caption whitespace-nowrap tabular-nums")
        slider.on_value_change(lambda event: pose(float(event.value)))

        def step() -> None:
            time = slider.value + FRAME
            slider.set_value(0.0 if time > last else time)

        timer = ui.timer(FRAME, step, active=False)

        def toggle() -> None:
            timer.active = not timer.active
            play.props(f"icon={'pause' if timer.active else 'play_arrow'}")

        play.on_click(toggle)
        pose(0.0)


def _shape(scene: ui.scene, bar: Bar) -> Any:
    if bar.length < 1e-9:
        return scene.sphere(bar.radius).material(bar.colour)
    return scene.cylinder(bar.radius, bar.radius, 1.0, 16).material(bar.colour)


def _place(shape: Any, bar: Bar) -> None:
    middle = (bar.start + bar.stop) / 2
    shape.move(*(float(value) for value in middle))
    if bar.length >= 1e-9:
        shape.rotate_R(bar.turn().tolist())
        shape.scale(1.0, bar.length, 1.0)


def angle_at(t: float, y: np.ndarray, Ts: float) -> float:
    """The measured angle [rad] at time t [s] of a record y (N,), linear between samples."""
    place = min(max(t / Ts, 0.0), len(y) - 1.0)
    k = min(int(place), len(y) - 2)
    return float(y[k] + (place - k) * (y[k + 1] - y[k]))
