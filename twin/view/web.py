"""MuJoCo's web viewer, with poses of a replay or a simulated robot, and the cylinders that are not bodies of the model.

Importing this raises ImportError if a library of the web viewer is missing.
"""

import logging
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import Any

import mujoco
from mujoco.studio import app, launch_web, messages, plugin, sim, viewer_protocol, web_viewer

from twin.view.guard import guarded
from twin.view.pictures import standing_robot
from twin.view.replay import Replay, moment
from twin.view.stills import column, cylinders, shape

FRAME = 1 / 60  # [s] between poses sent to the viewer


def serve(replay: Replay | None, speed: float, port: int) -> None:
    """Serve the page on this machine's `port` (0: the first free one from 8080 on) until Ctrl-C."""
    plugins: list[Any] = [app.App(app.Config(show_inspector=replay is None)), Overlay(on_column=replay is not None)]
    if replay is None:
        model, pose = standing_robot()
        plugins += app.SIM_PLUGINS
    else:
        model, pose = replay.model, replay.pose(0.0)
        _aim(model, replay.camera())
        plugins.append(Player(replay, speed))
    data = mujoco.MjData(model)
    data.qpos[:] = pose
    config = viewer_protocol.ViewerConfig(title="qpal view", gfx="web", http_port=port, open_browser=True)
    logging.getLogger("asyncio").setLevel(logging.CRITICAL)  # closing the page is not an error
    with on_this_machine_only():
        launch_web.run(config, model=model, data=data, plugins=plugins)


class Player(plugin.SimPlugin):
    """Sets the current pose instead of stepping physics; follows the viewer's pause and speed."""

    def __init__(self, replay: Replay, speed: float) -> None:
        self._replay, self._speed = replay, speed
        self._wall, self._last = 0.0, time.monotonic()
        self._control = messages.StepControlSnapshot()

    @messages.handler
    def on_step(self, event: messages.StepEvent) -> None:
        now = time.monotonic()
        if self._control.pause_state == sim.PauseState.UNPAUSED:
            self._wall += (now - self._last) * self._control.speed / 100
        self._last = now
        shown = moment(self._wall, self._replay.length, self._speed)
        event.data.qpos[:] = self._replay.pose(shown)
        event.data.time = self._replay.start + shown
        time.sleep(FRAME)

    @messages.handler
    def on_control(self, control: messages.StepControlSnapshot) -> bool:
        self._control = control
        return True

    @messages.handler
    def on_pause(self, event: messages.RequestPauseEvent) -> bool:
        self._control = messages.StepControlSnapshot(event.pause_state, self._control.speed)
        return True


class Overlay(plugin.ViewerPlugin):
    """Draws the actuators' cylinders into every frame, and the column under the robot of a replay."""

    def __init__(self, on_column: bool) -> None:
        self._on_column = on_column

    @messages.handler
    def on_update(self, event: messages.UpdateEvent) -> None:
        geoms, model, data = self.viewer.extra_geoms, self.viewer.model, self.viewer.data
        geoms.clear()
        if mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_BODY, "torso") < 0:
            return  # before our model arrives
        for rod in (*cylinders(model, data), *(column(data) if self._on_column else ())):
            geom = mujoco.MjvGeom()
            shape(geom, rod)
            geoms.append(geom)


def _aim(model: mujoco.MjModel, camera: Mapping[str, Any]) -> None:
    """Make `camera`, as in `twin.view.stills.CAMERA`, the viewer's first: 1.5 extents from the centre."""
    model.stat.center[:] = camera["lookat"]
    model.stat.extent = camera["distance"] / 1.5
    model.vis.global_.azimuth, model.vis.global_.elevation = camera["azimuth"], camera["elevation"]


@contextmanager
def on_this_machine_only() -> Iterator[None]:
    """Within this context the web viewer serves the loopback only, and its own page only (see `twin.view.guard`).

    MuJoCo 4.0 has no such option: it listens on every interface without a password, so that anyone can steer, load a
    model or read the paths of files. A server started in this context keeps these settings.
    """
    server, banner = web_viewer.web_server, web_viewer._print_url_banner
    bind, listen = server.bind_public_socket, server.serve
    server.serve = guarded(listen)
    server.bind_public_socket = lambda host, port=0: bind("127.0.0.1", port)
    web_viewer._print_url_banner = lambda host, port: print(
        f"The viewer is at http://localhost:{port}/ for browsers on this machine; Ctrl-C ends it.", flush=True
    )
    try:
        yield
    finally:
        server.bind_public_socket, server.serve, web_viewer._print_url_banner = bind, listen, banner
