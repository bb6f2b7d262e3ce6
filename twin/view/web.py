"""MuJoCo's web viewer, with poses of a replay or a simulated robot, and the cylinders that are not bodies of the model.

Importing this raises ImportError if a library of the web viewer is missing.
"""

import logging
import os
import sys
import threading
import time
import webbrowser
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import Any

import mujoco
from mujoco.studio import app, launch_web, messages, plugin, sim, viewer_protocol, web_viewer

from twin.view.door import TOKEN, Door, accept_own_process, guard_server, secret
from twin.view.pictures import standing_robot
from twin.view.replay import Replay, moment
from twin.view.stills import column, cylinders, shape

FRAME = 1 / 60  # [s] between poses sent to the viewer
HOSTS = ("localhost", "127.0.0.1", "[::1]")  # names of this machine


def serve(replay: Replay | None, speed: float, port: int) -> None:
    """Serve the page on this machine's `port` (0: the first free one from 8080 on) until Ctrl-C."""
    plugins: list[Any] = [app.App(app.Config(show_inspector=replay is None)), Overlay(on_column=replay is not None)]
    plugins.append(OneModel())
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


class OneModel(plugin.SimPlugin):
    """Keeps the model that the viewer began with: another one, dropped or loaded again, would not fit its poses."""

    @messages.handler(priority=messages.Priority.CRITICAL)
    def on_load_model(self, event: messages.LoadModelEvent) -> bool:
        if event.path:
            print("This viewer shows one model and loads no other; end it with Ctrl-C to show another log.", flush=True)
        return True


class Player(plugin.SimPlugin):
    """Sets the current pose instead of stepping physics; follows the viewer's pause and speed."""

    def __init__(self, replay: Replay, speed: float) -> None:
        self._replay, self._speed = replay, speed
        self._wall, self._last = 0.0, time.monotonic()
        self._control = messages.StepControlSnapshot()

    @messages.handler
    def on_step(self, event: messages.StepEvent) -> None:
        clock = time.monotonic()
        if self._control.pause_state == sim.PauseState.UNPAUSED:
            self._wall += (clock - self._last) * self._control.speed / 100
        self._last = clock
        time_shown = moment(self._wall, self._replay.length, self._speed)
        event.data.qpos[:] = self._replay.pose(time_shown)
        event.data.time = self._replay.start + time_shown
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
    """Within this context the web viewer serves the loopback only, and its own page only (see `twin.view.door`).

    MuJoCo 4.0 has no such option: it listens on every interface without a password, so that anyone can steer, load a
    model or read the paths of files. A server started in this context keeps these settings. The address has a token;
    MuJoCo's inner port, through which the page is drawn, takes connections of this process only.
    """
    server, banner, browser = web_viewer.web_server, web_viewer._print_url_banner, web_viewer._open_browser
    bind, listen, inner = server.bind_public_socket, server.serve, server.bind_loopback_socket
    token, single_token, cookie = secret(), secret(), secret()

    def door(port: int) -> Door:
        return Door(port, token, cookie, single_token, HOSTS, ("GET",), "qpal view")

    server.serve = guard_server(listen, door)
    server.bind_public_socket = lambda host, port=0: bind("127.0.0.1", port)
    server.bind_loopback_socket = lambda port=0: accept_own_process(inner(port))
    web_viewer._print_url_banner = lambda host, port: print(
        f"The viewer is at http://localhost:{port}/?{TOKEN}={token} for browsers on this machine; Ctrl-C ends it.",
        flush=True,
    )
    web_viewer._open_browser = lambda port: _open(f"http://localhost:{port}/?{TOKEN}={single_token}")
    try:
        yield
    finally:
        server.bind_public_socket, server.serve, server.bind_loopback_socket = bind, listen, inner
        web_viewer._print_url_banner, web_viewer._open_browser = banner, browser


def _open(address: str) -> None:
    """Show `address` in a browser, if there is a display to show it on."""
    if sys.platform.startswith("linux") and not (os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")):
        return
    threading.Thread(target=webbrowser.open, args=(address, 2), daemon=True).start()
