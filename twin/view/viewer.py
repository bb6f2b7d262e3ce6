"""The robot, or a replay of a log, in MuJoCo's own viewer: a window, or a page that a browser opens."""

import os
import socket
import sys
import time
import warnings
from collections.abc import Mapping
from contextlib import suppress
from typing import Any

import mujoco

from sysid.base.errors import InputError
from twin.parameters import Parameters
from twin.plant.board import user_data
from twin.plant.leg import robot_circuits
from twin.plant.stepping import boards
from twin.view.pictures import standing_robot
from twin.view.replay import Replay, moment
from twin.view.stills import CAMERA, column, cylinders, shape

ELSEWHERE = "use --web to see it in a browser, or --strip FILE.png for pictures"
FRAME = 1 / 60  # [s] between pictures
LAG = 0.1  # [s] that the simulation may lag behind the clock before it skips time


def show(replay: Replay | None, *, speed: float = 1.0, web: bool = False, port: int = 0) -> None:
    """Show `replay` in a loop at `speed` times real time, until a person closes the viewer or presses Ctrl-C.

    Without a replay: the simulated robot on its floor, with sliders for the motor voltages, 0 V at first. `web` serves
    a page on this machine's `port`, 0 for the first free one from 8080 on. Raises InputError if this machine cannot.
    """
    if web:
        check_port(port)
        _serve(replay, speed, port)
    else:
        check_display()
        window(replay, speed)


def _serve(replay: Replay | None, speed: float, port: int) -> None:
    try:
        from twin.view.web import serve
    except ImportError as error:
        raise InputError(
            f"MuJoCo's web viewer cannot be loaded ({error}); install it with: pip install mujoco-studio websockets"
        ) from None
    serve(replay, speed, port)


def check_display() -> None:
    """Raises InputError if no window can be opened.

    The test opens a hidden window: MuJoCo's viewer opens its window in a thread and waits forever after a failure.
    """
    if sys.platform.startswith("linux") and not (os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")):
        raise InputError(f"there is no display to open a window on (DISPLAY is not set); {ELSEWHERE}")
    if sys.platform == "darwin":
        from mujoco import viewer

        if viewer._MJPYTHON is None:
            raise InputError(
                f"MuJoCo's window needs its own mjpython on macOS: mjpython -m twin.cli view; or {ELSEWHERE}"
            )
        return  # there the window belongs to another thread, so it is not tested
    import glfw

    with warnings.catch_warnings(record=True) as warnings_list:  # GLFW's errors are Python warnings
        warnings.simplefilter("always")
        works = bool(glfw.init())
        if works:
            glfw.window_hint(glfw.VISIBLE, glfw.FALSE)
            works = bool(glfw.create_window(64, 64, "qpal", None, None))
            glfw.terminate()
    if not works:
        reason = str(warnings_list[-1].message) if warnings_list else "GLFW gives no reason"
        raise InputError(f"no window can be opened here ({reason}); {ELSEWHERE}")


def check_port(port: int) -> None:
    """Raises InputError if no page can be served at `port`."""
    if not 0 <= port <= 65535:
        raise InputError(f"--port is {port}; give a port from 1 to 65535, or leave it out for the first free one")
    if not port:
        return
    with socket.socket() as probe:
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            probe.bind(("127.0.0.1", port))
            probe.listen()  # two sockets may share a port until one of them listens
        except OSError as error:
            raise InputError(
                f"--port {port} is not available ({error.strerror}); give another, or omit it for the first free one"
            ) from None


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
            start = time.monotonic()
            with handle.lock():
                if replay is None:
                    simulate(model, data, speed * clock.tick(start))
                else:
                    clock.tick(start)
                    time_shown = moment(clock.wall, replay.length, speed)
                    data.qpos[:], data.time = replay.pose(time_shown), replay.start + time_shown
                    mujoco.mj_fwdPosition(model, data)
                _decorate(handle.user_scn, model, data, replay is not None)
            handle.sync()
            time.sleep(max(0.0, FRAME - (time.monotonic() - start)))


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

    def tick(self, clock: float) -> float:
        """Time [s] that passed since the last call, 0 in a pause."""
        duration = 0.0 if self._paused or self._last is None else clock - self._last
        self._last = clock
        self.wall += duration
        return duration


def simulate(model: mujoco.MjModel, data: mujoco.MjData, duration: float) -> None:
    """Step physics through `duration` [s], less if the machine is too slow; ctrl keeps the person's settings."""
    commands = data.ctrl.copy()
    with boards():  # the board's kernels replace the commands by the motors' voltages
        for _ in range(round(min(duration, LAG) / model.opt.timestep)):
            data.ctrl[:] = commands
            mujoco.mj_step(model, data)
    data.ctrl[:] = commands
    mujoco.mj_fwdPosition(model, data)


def _aim(camera: mujoco.MjvCamera, view: Mapping[str, Any]) -> None:
    camera.lookat[:] = view["lookat"]
    camera.distance, camera.azimuth, camera.elevation = view["distance"], view["azimuth"], view["elevation"]


def _decorate(scene: mujoco.MjvScene, model: mujoco.MjModel, data: mujoco.MjData, on_column: bool) -> None:
    scene.ngeom = 0
    for rod in (*cylinders(model, data), *(column(data) if on_column else ())):
        shape(scene.geoms[scene.ngeom], rod)
        scene.ngeom += 1
