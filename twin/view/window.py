"""MuJoCo's window, with poses of a replay or a simulated robot, and the cylinders that are not bodies of the model."""

import time
from collections.abc import Mapping
from contextlib import suppress
from typing import Any

import mujoco

from twin.parameters import Parameters
from twin.plant.board import user_data
from twin.plant.leg import robot_circuits
from twin.plant.stepping import boards
from twin.view.pictures import standing_robot
from twin.view.replay import Replay, moment
from twin.view.stills import CAMERA, column, cylinders, shape

FRAME = 1 / 60  # [s] between pictures
LAG = 0.1  # [s] that the simulation may lag behind the clock before it skips time


def window(replay: Replay | None, speed: float) -> None:
    """Open the window and keep it moving until it is closed or Ctrl-C; the space bar pauses. Needs a display."""
    from mujoco import viewer

    model, pose = standing_robot() if replay is None else (replay.model, replay.pose(0.0))
    data = mujoco.MjData(model)
    data.qpos[:] = pose
    if replay is None:
        data.userdata[:] = user_data(model, robot_circuits(Parameters()))
    clock = Clock()
    panels = {"show_left_ui": False, "show_right_ui": replay is None}  # the panel with the motors' voltages
    with suppress(KeyboardInterrupt), viewer.launch_passive(model, data, key_callback=clock.key, **panels) as handle:
        _aim(handle.cam, {**CAMERA, **({} if replay is None else replay.camera())})
        while handle.is_running():
            begun = time.monotonic()
            with handle.lock():
                if replay is None:
                    simulate(model, data, speed * clock.tick(begun))
                else:
                    clock.tick(begun)
                    shown = moment(clock.wall, replay.length, speed)
                    data.qpos[:], data.time = replay.pose(shown), replay.start + shown
                    mujoco.mj_fwdPosition(model, data)
                _decorate(handle.user_scn, model, data, replay is not None)
            handle.sync()
            time.sleep(max(0.0, FRAME - (time.monotonic() - begun)))


class Clock:
    """Wall time [s] without the pauses."""

    def __init__(self) -> None:
        self.wall = 0.0
        self._paused = False
        self._last: float | None = None

    def key(self, code: int) -> None:
        """Key callback of the viewer: the space bar pauses or continues."""
        if code == ord(" "):
            self._paused = not self._paused

    def tick(self, now: float) -> float:
        """Time [s] that passed since the last call, 0 in a pause."""
        passed = 0.0 if self._paused or self._last is None else now - self._last
        self._last = now
        self.wall += passed
        return passed


def simulate(model: mujoco.MjModel, data: mujoco.MjData, passed: float) -> None:
    """Step physics through `passed` [s], less if the machine is too slow; ctrl keeps the person's settings."""
    asked = data.ctrl.copy()
    with boards():  # the board's kernels replace the commands by the motors' voltages
        for _ in range(round(min(passed, LAG) / model.opt.timestep)):
            data.ctrl[:] = asked
            mujoco.mj_step(model, data)
    data.ctrl[:] = asked
    mujoco.mj_fwdPosition(model, data)


def _aim(camera: mujoco.MjvCamera, view: Mapping[str, Any]) -> None:
    camera.lookat[:] = view["lookat"]
    camera.distance, camera.azimuth, camera.elevation = view["distance"], view["azimuth"], view["elevation"]


def _decorate(scene: mujoco.MjvScene, model: mujoco.MjModel, data: mujoco.MjData, on_column: bool) -> None:
    scene.ngeom = 0
    for rod in (*cylinders(model, data), *(column(data) if on_column else ())):
        shape(scene.geoms[scene.ngeom], rod)
        scene.ngeom += 1
