"""The server of the app: one port of the loopback, behind the guard, until Ctrl-C."""

import socket
import threading
import webbrowser
from collections.abc import Callable
from importlib.util import find_spec
from typing import Any

from sysid.base.errors import InputError
from twin.app.desk import Desk
from twin.app.guard import Guard
from twin.view.door import HEAD, TOKEN, Waiting, secret

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
    token = secret()
    once = secret()  # for the browser that is started: its address is on a command line, which others can read
    guard = Guard(application(desk), chosen, token, secret(), once=once)
    address = f"http://{HOST}:{chosen}/?{TOKEN}="
    server = uvicorn.Server(
        uvicorn.Config(
            guard,
            log_level="critical",
            http=patient(),
            ws="wsproto",
            timeout_graceful_shutdown=1,
            server_header=False,
            date_header=False,
        )
    )
    say(address + token)
    if open_browser:
        threading.Timer(0.7, webbrowser.open, [address + once]).start()
    server.run(sockets=[listening])


def patient() -> Any:
    """uvicorn's protocol, in which a connection may not wait for ever before it asks, nor send a head without end."""
    from uvicorn.protocols.http.auto import AutoHTTPProtocol

    waiting = Waiting()
    base: Any = AutoHTTPProtocol

    class Patient(base):
        head = 0  # [byte] that came while no request was at work

        def connection_made(self, transport: Any) -> None:
            waiting.came(transport)
            super().connection_made(transport)

        def data_received(self, data: bytes) -> None:
            super().data_received(data)
            if self.transport.get_protocol() is not self or self._at_work():
                self.head = 0
                waiting.asked(self.transport)
                return
            self.head += len(data)
            waiting.came(self.transport)
            if self.head > HEAD:
                self.transport.abort()

        def connection_lost(self, exc: Exception | None) -> None:
            waiting.asked(self.transport)
            super().connection_lost(exc)

        def _at_work(self) -> bool:
            return self.cycle is not None and not self.cycle.response_complete

    return Patient


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
