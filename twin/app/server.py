"""The server of the app: one port of the loopback, behind the guard, until Ctrl-C."""

import secrets
import socket
import threading
import webbrowser
from collections.abc import Callable
from importlib.util import find_spec

from sysid.base.errors import InputError
from twin.app.desk import Desk
from twin.app.guard import TOKEN, Guard

FIRST, TRIES = 8090, 50  # the ports that are tried if none is given
HOST = "127.0.0.1"
NEEDED = 'qpal app needs NiceGUI, which is not installed; run: pip install "qpal[app]"'


def serve(desk: Desk, listening: socket.socket, open_browser: bool, say: Callable[[str], None]) -> None:
    """Serve the page of `desk` on a socket of `listen` until Ctrl-C or SIGTERM, which raise KeyboardInterrupt.

    `say` receives the address.
    """
    import uvicorn

    from twin.app.page.frame import application

    chosen = listening.getsockname()[1]
    token = secrets.token_urlsafe(24)
    guard = Guard(application(desk), chosen, token, secrets.token_urlsafe(24))
    address = f"http://{HOST}:{chosen}/?{TOKEN}={token}"
    server = uvicorn.Server(
        uvicorn.Config(
            guard,
            log_level="critical",
            ws="wsproto",
            timeout_graceful_shutdown=1,
            server_header=False,
            date_header=False,
        )
    )
    say(address)
    if open_browser:
        threading.Timer(0.7, webbrowser.open, [address]).start()
    server.run(sockets=[listening])


def listen(port: int) -> socket.socket:
    """A socket on `port` of the loopback (0: the first free one from 8090 on).

    Raises InputError for a port that is no port or in use, and if NiceGUI is missing.
    """
    if find_spec("nicegui") is None:
        raise InputError(NEEDED)
    if not 0 <= port <= 65535:
        raise InputError(f"--port is {port}; give a number from 1 to 65535, or 0 for the first free one")
    for each in [port] if port else range(FIRST, FIRST + TRIES):
        found = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
        found.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            found.bind((HOST, each))
            found.listen(64)
            return found
        except OSError as error:
            found.close()
            reason = error.strerror
    if port:
        raise InputError(f"port {port} cannot be used: {reason}; give another one with --port, or leave --port out")
    raise InputError(f"no port from {FIRST} to {FIRST + TRIES - 1} is free; give one with --port")
