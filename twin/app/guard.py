"""Access to the app: one browser, one address of this machine, one token.

A server on the loopback is in reach of every page that a browser on this machine shows, and of every user of the
machine. Each request, also the opening of a WebSocket, must have the Host of this server (a foreign name that points to
127.0.0.1 does not), come from its own page (Origin) and carry the cookie, which only the address with the token gives.
"""

import hmac
from collections.abc import Awaitable, Callable, MutableMapping
from dataclasses import dataclass
from http.cookies import CookieError, SimpleCookie
from typing import Any
from urllib.parse import parse_qs

Scope = MutableMapping[str, Any]
Message = MutableMapping[str, Any]
Receive = Callable[[], Awaitable[Message]]
Send = Callable[[Message], Awaitable[None]]
Server = Callable[[Scope, Receive, Send], Awaitable[None]]

OWN = ("localhost", "127.0.0.1")
TOKEN = "token"
LARGEST = 512 * 2**20  # [byte] of a request: a log of some million samples as text
OPEN_TO_ALL = b"access-control-"  # headers that would let pages of other sites read the answer
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
    """An ASGI application that lets only its own browser reach `app`; `token` and `cookie` are random texts."""

    app: Server
    port: int
    token: str
    cookie: str
    largest: int = LARGEST

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer, refuse with 403, or pass on."""
        if scope["type"] not in ("http", "websocket"):
            await self.app(scope, receive, send)
            return
        headers = _headers(scope)
        reason = self._foreign(scope, headers)
        if reason is None and not self._known(headers):
            if self._has_token(scope):
                await _answer(send, 303, "", [(b"location", b"/"), (b"set-cookie", self._set_cookie())])
                return
            reason = "This page needs the address that qpal app printed, with its token."
        if reason is not None:
            await _refuse(scope, send, reason)
            return
        await self._pass(scope, receive, send, headers)

    def _foreign(self, scope: Scope, headers: dict[str, list[str]]) -> str | None:
        """Why a request does not come from the app's own page or a person; None if it does."""
        hosts = {f"{name}:{self.port}" for name in OWN}
        asked = headers.get("host", [])
        if len(asked) != 1 or asked[0].lower() not in hosts:
            return f"This page answers only to http://127.0.0.1:{self.port}/."
        origins = headers.get("origin", [])
        own = f"http://{asked[0].lower()}"
        if any(origin.lower() != own for origin in origins):
            return "This page answers only to itself, not to pages of other sites."
        reads = scope["type"] == "http" and scope["method"] in ("GET", "HEAD")
        if not origins and not reads:  # browsers always say where a write or a WebSocket comes from
            return "This request does not say from which page it comes."
        sites = headers.get("sec-fetch-site", [])
        opened = headers.get("sec-fetch-mode") == ["navigate"] and headers.get("sec-fetch-dest") == ["document"]
        if not (opened or all(site in ("same-origin", "none") for site in sites)):
            return "This page is not part of other pages."
        return None

    @property
    def cookie_name(self) -> str:
        """Cookies do not know ports, so two apps on one machine need two names."""
        return f"qpal_{self.port}"

    def _known(self, headers: dict[str, list[str]]) -> bool:
        for text in headers.get("cookie", []):
            try:
                found = SimpleCookie(text).get(self.cookie_name)
            except CookieError:
                continue
            if found is not None and hmac.compare_digest(found.value.encode(), self.cookie.encode()):
                return True
        return False

    def _has_token(self, scope: Scope) -> bool:
        if scope["type"] != "http" or scope["method"] != "GET" or scope["path"] != "/":
            return False
        given = parse_qs(scope.get("query_string", b"").decode("latin-1")).get(TOKEN, [])
        return len(given) == 1 and hmac.compare_digest(given[0].encode(), self.token.encode())

    def _set_cookie(self) -> bytes:
        return f"{self.cookie_name}={self.cookie}; Path=/; HttpOnly; SameSite=Strict".encode()

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
                kept = [(k, v) for k, v in message.get("headers", []) if not k.lower().startswith(OPEN_TO_ALL)]
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


async def _refuse(scope: Scope, send: Send, reason: str) -> None:
    if scope["type"] == "websocket":
        await send({"type": "websocket.close", "code": 1008, "reason": reason})  # before it was accepted: 403
        return
    await _answer(send, 403, reason)


async def _answer(send: Send, status: int, text: str, headers: list[tuple[bytes, bytes]] | None = None) -> None:
    body = (text + "\n").encode() if text else b""
    given = [(b"content-type", b"text/plain; charset=utf-8"), (b"content-length", str(len(body)).encode())]
    await send({"type": "http.response.start", "status": status, "headers": [*given, *HEADERS, *(headers or [])]})
    await send({"type": "http.response.body", "body": body})
