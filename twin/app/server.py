"""The server of the app: one port of the loopback, one browser, one token, until Ctrl-C.

Each request, also the opening of a WebSocket, passes the door of `twin.view.door` first. What comes in is at most
`entries.LARGEST` bytes, and what goes out says that no other page may read or show it.
"""

import socket
import threading
import webbrowser
from collections.abc import Awaitable, Callable, Iterable, MutableMapping
from dataclasses import dataclass
from functools import cached_property
from importlib.util import find_spec
from typing import Any

from sysid.base.errors import InputError
from twin.app.desk import Desk
from twin.app.entries import LARGEST
from twin.view.door import CROSS_ORIGIN, HEAD, HEADERS, TOKEN, Door, Request, SilentConnections, headers_by_name, secret

Scope = MutableMapping[str, Any]
Message = MutableMapping[str, Any]
Receive = Callable[[], Awaitable[Message]]
Send = Callable[[Message], Awaitable[None]]
Server = Callable[[Scope, Receive, Send], Awaitable[None]]

FIRST, TRIES = 8090, 50  # the ports that are tried if none is given
HOST = "127.0.0.1"
HOSTS = (HOST, "localhost")
NEEDED = 'qpal app needs NiceGUI, which is not installed; run: pip install "qpal[app]"'
# Everything comes from this server, and no other page shows it in a frame. Vue compiles its templates, Plotly draws to
# blobs, and both write styles.
POLICY = (
    "default-src 'self'; script-src 'self' 'unsafe-inline' 'unsafe-eval' blob:; style-src 'self' 'unsafe-inline'; "
    "img-src 'self' data: blob:; font-src 'self' data:; worker-src 'self' blob:; connect-src 'self' data: blob:; "
    "frame-ancestors 'none'; base-uri 'self'; form-action 'self'"
)
ISOLATION = (
    ("content-security-policy", POLICY),
    *HEADERS,
    ("cross-origin-resource-policy", "same-origin"),
    ("cross-origin-opener-policy", "same-origin"),
)


def serve(desk: Desk, listening: socket.socket, open_browser: bool, say: Callable[[str], None]) -> None:
    """Serve the page of `desk` on a socket of `listen` until Ctrl-C or SIGTERM, which raise KeyboardInterrupt.

    `say` receives the address.
    """
    import uvicorn

    from twin.app.page.frame import application

    port = listening.getsockname()[1]
    token = secret()
    single_token = secret()  # for the browser that is started: its address is on a command line, which others can read
    guard = Guard(application(desk), port, token, secret(), once=single_token)
    address = f"http://{HOST}:{port}/?{TOKEN}="
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
        threading.Timer(0.7, webbrowser.open, [address + single_token]).start()
    server.run(sockets=[listening])


def patient() -> Any:
    """uvicorn's protocol, in which a connection may not wait for ever before it asks, nor send a head without end."""
    from uvicorn.protocols.http.auto import AutoHTTPProtocol

    silent = SilentConnections()
    base: Any = AutoHTTPProtocol

    class Patient(base):
        head = 0  # [byte] that came while no request was at work

        def connection_made(self, transport: Any) -> None:
            silent.add(transport)
            super().connection_made(transport)

        def data_received(self, data: bytes) -> None:
            super().data_received(data)
            if self.transport.get_protocol() is not self or self._at_work():
                self.head = 0
                silent.remove(self.transport)
                return
            self.head += len(data)
            silent.add(self.transport)
            if self.head > HEAD:
                self.transport.abort()

        def connection_lost(self, exc: Exception | None) -> None:
            silent.remove(self.transport)
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
    for number in [port] if port else range(FIRST, FIRST + TRIES):
        listening = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
        listening.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            listening.bind((HOST, number))
            listening.listen(64)
            return listening
        except OSError as error:
            listening.close()
            reason = error.strerror
    if port:
        raise InputError(f"port {port} cannot be used: {reason}; give another one with --port, or leave --port out")
    raise InputError(f"no port from {FIRST} to {FIRST + TRIES - 1} is free; give one with --port")


class TooLarge(Exception):  # noqa: N818 - reads as what it says
    """The body of a request is larger than `LARGEST`."""


@dataclass(frozen=True)
class Guard:
    """An ASGI application that lets only its own browser reach `app`; `token`, `cookie` and `once` are random texts."""

    app: Server
    port: int
    token: str
    cookie: str
    largest: int = LARGEST
    once: str = ""

    @cached_property
    def door(self) -> Door:
        """What may pass."""
        return Door(self.port, self.token, self.cookie, self.once, HOSTS)

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer, refuse with 403, or pass on."""
        if scope["type"] not in ("http", "websocket"):
            await self.app(scope, receive, send)
            return
        headers = headers_by_name((name.decode("latin-1"), value.decode("latin-1")) for name, value in scope["headers"])
        query = scope.get("query_string", b"").decode("latin-1")
        websocket = scope["type"] == "websocket"
        answer = self.door.answer(Request(scope.get("method", "GET"), scope["path"], query, headers, websocket))
        if answer is None:
            await self._pass_on(scope, receive, send, headers)
        elif websocket:
            await send({"type": "websocket.close", "code": 1008, "reason": answer.text})  # before it was accepted: 403
        else:
            await _send_text(send, answer.status, answer.text, answer.headers)

    async def _pass_on(self, scope: Scope, receive: Receive, send: Send, headers: dict[str, list[str]]) -> None:
        """Hand a request to the application; its body is counted, and the answer gets the headers of `ISOLATION`."""
        refusal = f"The file is larger than {self.largest // 2**20} MiB; give a shorter part of it."
        length = headers.get("content-length", ["0"])[0]
        if not length.isdigit() or int(length) > self.largest:
            await _send_text(send, 413, refusal)
            return
        is_started = False
        budget = self.largest

        async def receive_counted() -> Message:
            nonlocal budget
            message = await receive()
            if message["type"] == "http.request":
                budget -= len(message.get("body", b""))
                if budget < 0:
                    raise TooLarge
            return message

        async def send_isolated(message: Message) -> None:
            nonlocal is_started
            if message["type"] in ("http.response.start", "websocket.accept"):
                is_started = True
                pairs = message.get("headers", [])
                pairs = [(name, value) for name, value in pairs if not name.lower().startswith(CROSS_ORIGIN.encode())]
                message = {**message, "headers": [*pairs, *_as_bytes(ISOLATION)]}
            await send(message)

        try:
            await self.app(scope, receive_counted, send_isolated)
        except TooLarge:
            if not is_started:
                await _send_text(send, 413, refusal)


async def _send_text(send: Send, status: int, text: str, headers: Iterable[tuple[str, str]] = ()) -> None:
    body = (text + "\n").encode() if text else b""
    pairs = ("content-type", "text/plain; charset=utf-8"), ("content-length", str(len(body))), *ISOLATION, *headers
    await send({"type": "http.response.start", "status": status, "headers": _as_bytes(pairs)})
    await send({"type": "http.response.body", "body": body})


def _as_bytes(headers: Iterable[tuple[str, str]]) -> list[tuple[bytes, bytes]]:
    return [(name.encode(), value.encode()) for name, value in headers]
