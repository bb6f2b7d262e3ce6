"""Access to the app: one browser, one address of this machine, one token.

Each request, also the opening of a WebSocket, passes the door of `twin.view.door` first. What comes in is at most
`LARGEST` bytes, and what goes out says that no other page may read or show it.
"""

from collections.abc import Awaitable, Callable, MutableMapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

from twin.view.door import OPEN_TO_ALL, Asked, Door

Scope = MutableMapping[str, Any]
Message = MutableMapping[str, Any]
Receive = Callable[[], Awaitable[Message]]
Send = Callable[[Message], Awaitable[None]]
Server = Callable[[Scope, Receive, Send], Awaitable[None]]

OWN = ("127.0.0.1", "localhost")
LARGEST = 512 * 2**20  # [byte] of a request: a log of some million samples as text
# Everything comes from this server, and no other page shows it in a frame. Vue compiles its templates, Plotly draws to
# blobs, and both write styles.
POLICY = (
    "default-src 'self'; script-src 'self' 'unsafe-inline' 'unsafe-eval' blob:; style-src 'self' 'unsafe-inline'; "
    "img-src 'self' data: blob:; font-src 'self' data:; worker-src 'self' blob:; connect-src 'self' data: blob:; "
    "frame-ancestors 'none'; base-uri 'self'; form-action 'self'"
)
HEADERS = (
    (b"content-security-policy", POLICY.encode()),
    (b"x-content-type-options", b"nosniff"),
    (b"x-frame-options", b"DENY"),
    (b"referrer-policy", b"same-origin"),
    (b"cross-origin-resource-policy", b"same-origin"),
    (b"cross-origin-opener-policy", b"same-origin"),
)


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
        return Door(self.port, self.token, self.cookie, self.once, OWN)

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer, refuse with 403, or pass on."""
        if scope["type"] not in ("http", "websocket"):
            await self.app(scope, receive, send)
            return
        headers = _headers(scope)
        query = scope.get("query_string", b"").decode("latin-1")
        websocket = scope["type"] == "websocket"
        said = self.door.answer(Asked(scope.get("method", "GET"), scope["path"], query, headers, websocket))
        if said is None:
            await self._pass(scope, receive, send, headers)
        elif websocket:
            await send({"type": "websocket.close", "code": 1008, "reason": said.text})  # before it was accepted: 403
        else:
            await _answer(send, said.status, said.text, [(k.encode(), v.encode()) for k, v in said.headers])

    async def _pass(self, scope: Scope, receive: Receive, send: Send, headers: dict[str, list[str]]) -> None:
        stated = headers.get("content-length", ["0"])[0]
        if not stated.isdigit() or int(stated) > self.largest:
            await _answer(send, 413, self._too_large())
            return
        started = False
        left = self.largest

        async def counted() -> Message:
            nonlocal left
            message = await receive()
            if message["type"] == "http.request":
                left -= len(message.get("body", b""))
                if left < 0:
                    raise TooLarge
            return message

        async def own_headers(message: Message) -> None:
            nonlocal started
            if message["type"] in ("http.response.start", "websocket.accept"):
                started = True
                kept = [(k, v) for k, v in message.get("headers", []) if not k.lower().startswith(OPEN_TO_ALL.encode())]
                message = {**message, "headers": [*kept, *HEADERS]}
            await send(message)

        try:
            await self.app(scope, counted, own_headers)
        except TooLarge:
            if not started:
                await _answer(send, 413, self._too_large())

    def _too_large(self) -> str:
        return f"The file is larger than {self.largest // 2**20} MiB; give a shorter part of it."


def _headers(scope: Scope) -> dict[str, list[str]]:
    found: dict[str, list[str]] = {}
    for name, value in scope["headers"]:
        found.setdefault(name.decode("latin-1").lower(), []).append(value.decode("latin-1"))
    return found


async def _answer(send: Send, status: int, text: str, headers: list[tuple[bytes, bytes]] | None = None) -> None:
    body = (text + "\n").encode() if text else b""
    given = [(b"content-type", b"text/plain; charset=utf-8"), (b"content-length", str(len(body)).encode())]
    await send({"type": "http.response.start", "status": status, "headers": [*given, *HEADERS, *(headers or [])]})
    await send({"type": "http.response.body", "body": body})
