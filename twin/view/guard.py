"""Access to the web viewer: each request passes the door of `twin.view.door`, and no model comes in."""

import asyncio
from collections.abc import Callable
from http import HTTPStatus
from typing import Any

from twin.view.door import OPEN_TO_ALL, Asked, Door, Waiting

OWN = ("localhost", "127.0.0.1", "[::1]")
SOCKETS = ("/ui", "/state")  # not /drop: the MJCF of a model can name any file of this machine and so show it
LARGEST = 2**20  # [byte] of a message from the page: a key, a movement of the mouse, a text that is pasted
CLOSING = 5.0  # [s] that a browser has for the end of a connection


def refusal(asked: Asked, door: Door) -> tuple[int, str, tuple[tuple[str, str], ...]] | None:
    """Status, text and headers of the answer that takes the place of the viewer's; None if the request is allowed."""
    said = door.answer(asked)
    if said is not None:
        return said.status, said.text, said.headers
    if asked.path == "/drop" or (asked.websocket and asked.path not in SOCKETS):
        return 403, "This viewer loads no other model; end it and give the log to qpal view.", ()
    if not asked.path.startswith("/") or ".." in asked.path or "\\" in asked.path:
        return 403, "This viewer has no such path.", ()
    return None


def guarded(serve: Callable[..., Any], door: Callable[[int], Door]) -> Callable[..., Any]:
    """`websockets.asyncio.server.serve` behind the `door` of its port: also for a WebSocket, and against silence."""
    from websockets.asyncio.server import ServerConnection
    from websockets.datastructures import Headers
    from websockets.http11 import Response

    waiting = Waiting()

    class Connection(ServerConnection):
        """A connection that may not wait for ever before it asks."""

        def connection_made(self, transport: asyncio.BaseTransport) -> None:
            assert isinstance(transport, asyncio.Transport)
            waiting.came(transport)
            super().connection_made(transport)

        def connection_lost(self, exc: Exception | None) -> None:
            waiting.asked(self.transport)
            super().connection_lost(exc)

    def checked(handler: Any, *, sock: Any, process_request: Any, process_response: Any, **options: Any) -> Any:
        own = door(sock.getsockname()[1])

        def request_first(connection: Any, request: Any) -> Any:
            waiting.asked(connection.transport)
            said = refusal(_asked(request), own)
            if said is None:
                return process_request(connection, request)
            status, text, more = said
            body = f"{text}\n".encode() if text else b""
            headers = Headers([*more, ("Content-Type", "text/plain"), ("Content-Length", str(len(body)))])
            return Response(status, HTTPStatus(status).phrase, headers, body)

        def response_last(connection: Any, request: Any, response: Any) -> Any:
            answer = process_response(connection, request, response) or response
            for name in {name for name in answer.headers if name.lower().startswith(OPEN_TO_ALL)}:
                del answer.headers[name]
            answer.headers["X-Content-Type-Options"] = "nosniff"
            answer.headers["X-Frame-Options"] = "DENY"
            answer.headers["Referrer-Policy"] = "same-origin"
            return answer

        limits = {"max_size": LARGEST, "close_timeout": CLOSING, "create_connection": Connection}
        given = {**options, **limits}
        return serve(handler, sock=sock, process_request=request_first, process_response=response_last, **given)

    return checked


def _asked(request: Any) -> Asked:
    path, _, query = request.path.partition("?")
    headers: dict[str, list[str]] = {}
    for name, value in request.headers.raw_items():
        headers.setdefault(name.lower(), []).append(value)
    upgrade = any("upgrade" in value.lower() for value in headers.get("connection", []))
    return Asked(getattr(request, "method", "GET"), path, query, headers, upgrade)
