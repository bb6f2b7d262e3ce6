"""The robot, or a replay of a log, in MuJoCo's own viewer: a window, or a page that a browser opens."""

import os
import socket
import sys
import warnings

from sysid.base.errors import InputError
from twin.view.replay import Replay

ELSEWHERE = "use --web to see it in a browser, or --strip FILE.png for pictures"


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
        from twin.view.window import window

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

    with warnings.catch_warnings(record=True) as said:  # GLFW's errors are Python warnings
        warnings.simplefilter("always")
        works = bool(glfw.init())
        if works:
            glfw.window_hint(glfw.VISIBLE, glfw.FALSE)
            works = bool(glfw.create_window(64, 64, "qpal", None, None))
            glfw.terminate()
    if not works:
        reason = str(said[-1].message) if said else "GLFW gives no reason"
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
