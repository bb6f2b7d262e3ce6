"""The door of a page that is served on this machine: who may ask for what. The viewer and the app have the same one.

A server on the loopback is in reach of every page that a browser on this machine shows, and of every user of the
machine. So each request, also the opening of a WebSocket, must have the Host of this server (a foreign name that points
to 127.0.0.1 does not), come from its own page (Origin, Sec-Fetch-Site) and carry the cookie, which only the address
with the token gives. `twin.app.server` asks the same `Door` in ASGI.

MuJoCo's viewer draws its page through a second port of the loopback, which has no password: a program of another user
that took this connection could draw the page. Both of its ends are in this process, so `accept_own_process` closes a
connection of any other process. Only Linux tells whose a connection is; elsewhere all are taken.
"""

import asyncio
import hmac
import os
import secrets
import socket
import sys
from collections.abc import Callable, Iterable, Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from http import HTTPStatus
from typing import Any
from urllib.parse import parse_qs

TOKEN = "token"
CROSS_ORIGIN = "access-control-"  # headers of an answer that would let pages of other sites read it
# Headers of every answer: no other page shows it in a frame, and no browser guesses its type.
# None asks a server of names for a link that nobody clicked.
HEADERS = (
    ("x-content-type-options", "nosniff"),
    ("x-frame-options", "DENY"),
    ("referrer-policy", "same-origin"),
    ("x-dns-prefetch-control", "off"),
)
MOST_SILENT, PATIENCE = 200, 10.0  # connections that have asked for nothing yet, and [s] that each may wait
HEAD = 64 * 1024  # [byte] of the line and the headers of a request
# WebSockets of the viewer; not /drop: the MJCF of a model can name any file of this machine and so show it.
SOCKETS = ("/ui", "/state")
LARGEST = 2**20  # [byte] of a message from the viewer's page: a key, a movement of the mouse, a text that is pasted
CLOSING = 5.0  # [s] that a browser has for the end of a connection


@dataclass(frozen=True)
class Request:
    """A request: `headers` by their names in small letters, `path` as it was sent, without the query."""

    method: str
    path: str
    query: str
    headers: Mapping[str, list[str]]
    websocket: bool

    def single_header(self, name: str) -> str | None:
        """The value of a header that is there once."""
        values = self.headers.get(name, [])
        return values[0] if len(values) == 1 else None


@dataclass(frozen=True)
class Answer:
    """What the door says itself: a refusal, or the way in with the cookie."""

    status: int
    text: str
    headers: tuple[tuple[str, str], ...] = ()


@dataclass(frozen=True)
class Door:
    """The door at `port`; `token` opens it, `cookie` keeps it open for one browser, and both are random texts.

    `once` is a token that opens it a single time: a browser that is started gets its address on a command line, which
    other users of the machine can read.
    """

    port: int
    token: str
    cookie: str
    once: str = ""
    names: tuple[str, ...] = ("localhost", "127.0.0.1")
    methods: tuple[str, ...] = ("GET", "HEAD", "POST")
    command: str = "qpal app"
    used: set[str] = field(default_factory=set, repr=False)

    def answer(self, request: Request) -> Answer | None:
        """What is said instead of the page; None lets the request in."""
        reason = self._refusal(request)
        if reason is not None:
            return Answer(403, reason)
        if not self._has_cookie(request):
            if self._has_token(request):
                cookie = f"{self.cookie_name}={self.cookie}; Path=/; HttpOnly; SameSite=Strict"
                return Answer(303, "", (("location", "/"), ("set-cookie", cookie)))
            return Answer(403, f"This page needs the address that {self.command} printed, with its token.")
        if request.method not in self.methods:
            return Answer(405, f"This page answers to {', '.join(self.methods)} only.")
        return None

    @property
    def cookie_name(self) -> str:
        """Cookies do not know ports, so two pages on one machine need two names."""
        return f"qpal_{self.port}"

    def _refusal(self, request: Request) -> str | None:
        """Why a request does not come from the own page or a person; None if it does."""
        hosts = {f"{name}:{self.port}" for name in self.names} | ({*self.names} if self.port == 80 else set())
        host = (request.single_header("host") or "").lower()
        if host not in hosts:
            return f"This page answers only to http://{self.names[0]}:{self.port}/."
        origins = request.headers.get("origin", [])
        if any(origin.lower() != f"http://{host}" for origin in origins):
            return "This page answers only to itself, not to pages of other sites."
        reads = not request.websocket and request.method in ("GET", "HEAD")
        if not origins and not reads:  # browsers always say where a write or a WebSocket comes from
            return "This request does not say from which page it comes."
        sites = request.headers.get("sec-fetch-site", [])
        fetch = request.single_header("sec-fetch-mode"), request.single_header("sec-fetch-dest")
        if not (fetch == ("navigate", "document") or all(site in ("same-origin", "none") for site in sites)):
            return "This page is not part of other pages."
        return None

    def _has_cookie(self, request: Request) -> bool:
        """Whether one of the cookies is the own one; the others come from any server at this name, and are any text."""
        cookie = f"{self.cookie_name}={self.cookie}"
        texts = [text.strip() for header in request.headers.get("cookie", []) for text in header.split(";")]
        equal = [is_equal(text, cookie) for text in texts]  # all are compared, whichever is the right one
        return any(equal)

    def _has_token(self, request: Request) -> bool:
        """Whether the address of the page has the token; the token for one use is then used up."""
        if request.websocket or request.method != "GET" or request.path != "/":
            return False
        tokens = parse_qs(request.query).get(TOKEN, [])
        if len(tokens) != 1:
            return False
        if self.once and self.once not in self.used and is_equal(tokens[0], self.once):
            self.used.add(self.once)
            return True
        return is_equal(tokens[0], self.token)


class SilentConnections:
    """Connections without a whole request yet. Each has `seconds`; of more than `limit` the oldest is closed.

    So silent connections, however many, do not keep the rightful browser out.
    """

    def __init__(self, limit: int = MOST_SILENT, seconds: float = PATIENCE) -> None:
        self.limit, self.seconds = limit, seconds
        self._open: dict[asyncio.Transport, asyncio.TimerHandle] = {}

    def __len__(self) -> int:
        return len(self._open)

    def add(self, transport: asyncio.Transport) -> None:
        """A connection waits from now on, if it does not wait already."""
        if transport in self._open:
            return
        if len(self._open) >= self.limit:
            self._close(next(iter(self._open)))
        clock = asyncio.get_running_loop()
        self._open[transport] = clock.call_later(self.seconds, self._close, transport)

    def remove(self, transport: asyncio.Transport) -> None:
        """A connection has sent its request, or has gone."""
        timer = self._open.pop(transport, None)
        if timer is not None:
            timer.cancel()

    def _close(self, transport: asyncio.Transport) -> None:
        self.remove(transport)
        transport.abort()


def secret() -> str:
    """A random text for a token or a cookie."""
    return secrets.token_urlsafe(24)


def is_equal(text: str, secret_text: str) -> bool:
    """Whether two texts are equal, in a time that does not tell where they differ."""
    return hmac.compare_digest(text.encode("utf-8", "surrogateescape"), secret_text.encode())


def refusal(request: Request, door: Door) -> Answer | None:
    """The answer that takes the place of the viewer's; None if the request is allowed."""
    answer = door.answer(request)
    if answer is not None:
        return answer
    if request.path == "/drop" or (request.websocket and request.path not in SOCKETS):
        return Answer(403, "This viewer loads no other model; end it and give the log to qpal view.")
    if not request.path.startswith("/") or ".." in request.path or "\\" in request.path:
        return Answer(403, "This viewer has no such path.")
    return None


def guard_server(serve: Callable[..., Any], door: Callable[[int], Door]) -> Callable[..., Any]:
    """`websockets.asyncio.server.serve` behind the `door` of its port: also for a WebSocket, and against silence."""
    from websockets.asyncio.server import ServerConnection
    from websockets.datastructures import Headers
    from websockets.http11 import Response

    silent = SilentConnections()

    class Connection(ServerConnection):
        """A connection that may not wait for ever before it asks."""

        def connection_made(self, transport: asyncio.BaseTransport) -> None:
            assert isinstance(transport, asyncio.Transport)
            silent.add(transport)
            super().connection_made(transport)

        def connection_lost(self, exc: Exception | None) -> None:
            silent.remove(self.transport)
            super().connection_lost(exc)

    def guarded_serve(handler: Any, *, sock: Any, process_request: Any, process_response: Any, **options: Any) -> Any:
        port_door = door(sock.getsockname()[1])

        def check_request(connection: Any, request: Any) -> Any:
            silent.remove(connection.transport)
            answer = refusal(_request(request), port_door)
            if answer is None:
                return process_request(connection, request)
            body = f"{answer.text}\n".encode() if answer.text else b""
            headers = Headers([*answer.headers, ("Content-Type", "text/plain"), ("Content-Length", str(len(body)))])
            return Response(answer.status, HTTPStatus(answer.status).phrase, headers, body)

        def set_headers(connection: Any, request: Any, response: Any) -> Any:
            answer = process_response(connection, request, response) or response
            for name in {name for name in answer.headers if name.lower().startswith(CROSS_ORIGIN)}:
                del answer.headers[name]
            answer.headers.update(HEADERS)
            return answer

        limits = {"max_size": LARGEST, "close_timeout": CLOSING, "create_connection": Connection}
        hooks = {"process_request": check_request, "process_response": set_headers}
        return serve(handler, sock=sock, **{**options, **limits, **hooks})

    return guarded_serve


def _request(request: Any) -> Request:
    """A request of websockets for the door."""
    path, _, query = request.path.partition("?")
    headers = headers_by_name(request.headers.raw_items())
    upgrade = any("upgrade" in value.lower() for value in headers.get("connection", []))
    return Request(getattr(request, "method", "GET"), path, query, headers, upgrade)


def headers_by_name(pairs: Iterable[tuple[str, str]]) -> dict[str, list[str]]:
    """All values of each header, by its name in small letters."""
    headers: dict[str, list[str]] = {}
    for name, value in pairs:
        headers.setdefault(name.lower(), []).append(value)
    return headers


def accept_own_process(listening: socket.socket) -> socket.socket:
    """The same listening socket, but it accepts connections of this process only."""
    return _OwnProcessSocket(listening.family, listening.type, listening.proto, listening.detach())


class _OwnProcessSocket(socket.socket):
    def accept(self) -> tuple[socket.socket, Any]:
        connection, address = super().accept()
        if sys.platform.startswith("linux") and not is_of_own_process(connection):
            connection.close()
            raise ConnectionAbortedError  # the server waits for the next one
        return connection, address


def is_of_own_process(connection: socket.socket) -> bool:
    """Whether the other end of an IPv4 connection within this machine is in this process (Linux)."""
    ends = _kernel_text(connection.getpeername()), _kernel_text(connection.getsockname())
    with open("/proc/self/net/tcp", encoding="ascii") as file:
        rows = [line.split() for line in file]
    inodes = {row[9] for row in rows if (row[1], row[2]) == ends}
    for name in os.listdir("/proc/self/fd"):
        with suppress(OSError):  # of a file that has been closed meanwhile
            if os.readlink(f"/proc/self/fd/{name}") in {f"socket:[{inode}]" for inode in inodes}:
                return True
    return False


def _kernel_text(address: tuple[str, int]) -> str:
    """An address as the kernel writes it: bytes in the order of the machine, in hexadecimal."""
    host = int.from_bytes(socket.inet_aton(address[0]), sys.byteorder)
    return f"{host:08X}:{address[1]:04X}"
