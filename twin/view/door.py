"""The door of a page that is served on this machine: who may ask for what. The viewer and the app have the same one.

A server on the loopback is in reach of every page that a browser on this machine shows, and of every user of the
machine. So each request, also the opening of a WebSocket, must have the Host of this server (a foreign name that points
to 127.0.0.1 does not), come from its own page (Origin, Sec-Fetch-Site) and carry the cookie, which only the address
with the token gives. The door knows no server: `twin.view.guard` and `twin.app.guard` ask it.
"""

import asyncio
import hmac
import secrets
from collections.abc import Mapping
from dataclasses import dataclass, field
from urllib.parse import parse_qs

TOKEN = "token"
OPEN_TO_ALL = "access-control-"  # headers of an answer that would let pages of other sites read it
MOST_SILENT, PATIENCE = 200, 10.0  # connections that have asked for nothing yet, and [s] that each may wait
HEAD = 64 * 1024  # [byte] of the line and the headers of a request


@dataclass(frozen=True)
class Asked:
    """A request: `headers` by their names in small letters, `path` as it was sent, without the query."""

    method: str
    path: str
    query: str
    headers: Mapping[str, list[str]]
    websocket: bool

    def one(self, name: str) -> str | None:
        """The value of a header that is there once."""
        found = self.headers.get(name, [])
        return found[0] if len(found) == 1 else None


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
    spent: set[str] = field(default_factory=set, repr=False)

    def answer(self, asked: Asked) -> Answer | None:
        """What is said instead of the page; None lets the request in."""
        reason = self._foreign(asked)
        if reason is not None:
            return Answer(403, reason)
        if not self._known(asked):
            if self._has_token(asked):
                kept = f"{self.cookie_name}={self.cookie}; Path=/; HttpOnly; SameSite=Strict"
                return Answer(303, "", (("location", "/"), ("set-cookie", kept)))
            return Answer(403, f"This page needs the address that {self.command} printed, with its token.")
        if asked.method not in self.methods:
            return Answer(405, f"This page answers to {', '.join(self.methods)} only.")
        return None

    @property
    def cookie_name(self) -> str:
        """Cookies do not know ports, so two pages on one machine need two names."""
        return f"qpal_{self.port}"

    def _foreign(self, asked: Asked) -> str | None:
        """Why a request does not come from the own page or a person; None if it does."""
        hosts = {f"{name}:{self.port}" for name in self.names} | ({*self.names} if self.port == 80 else set())
        host = (asked.one("host") or "").lower()
        if host not in hosts:
            return f"This page answers only to http://{self.names[0]}:{self.port}/."
        origins = asked.headers.get("origin", [])
        if any(origin.lower() != f"http://{host}" for origin in origins):
            return "This page answers only to itself, not to pages of other sites."
        reads = not asked.websocket and asked.method in ("GET", "HEAD")
        if not origins and not reads:  # browsers always say where a write or a WebSocket comes from
            return "This request does not say from which page it comes."
        sites = asked.headers.get("sec-fetch-site", [])
        opened = asked.one("sec-fetch-mode") == "navigate" and asked.one("sec-fetch-dest") == "document"
        if not (opened or all(site in ("same-origin", "none") for site in sites)):
            return "This page is not part of other pages."
        return None

    def _known(self, asked: Asked) -> bool:
        """Whether one of the cookies is the own one; the others come from any server at this name, and are any text."""
        own = f"{self.cookie_name}={self.cookie}"
        found = [_same(each.strip(), own) for text in asked.headers.get("cookie", []) for each in text.split(";")]
        return any(found)

    def _has_token(self, asked: Asked) -> bool:
        if asked.websocket or asked.method != "GET" or asked.path != "/":
            return False
        given = parse_qs(asked.query).get(TOKEN, [])
        if len(given) != 1:
            return False
        if self.once and self.once not in self.spent and _same(given[0], self.once):
            self.spent.add(self.once)
            return True
        return _same(given[0], self.token)


class Waiting:
    """Connections without a whole request yet. Each has `seconds`; of more than `most` the oldest is closed.

    So silent connections, however many, do not keep the rightful browser out.
    """

    def __init__(self, most: int = MOST_SILENT, seconds: float = PATIENCE) -> None:
        self.most, self.seconds = most, seconds
        self._open: dict[asyncio.Transport, asyncio.TimerHandle] = {}

    def __len__(self) -> int:
        return len(self._open)

    def came(self, transport: asyncio.Transport) -> None:
        """A connection waits from now on, if it does not wait already."""
        if transport in self._open:
            return
        if len(self._open) >= self.most:
            self._close(next(iter(self._open)))
        clock = asyncio.get_running_loop()
        self._open[transport] = clock.call_later(self.seconds, self._close, transport)

    def asked(self, transport: asyncio.Transport) -> None:
        """A connection has sent its request, or has gone."""
        timer = self._open.pop(transport, None)
        if timer is not None:
            timer.cancel()

    def _close(self, transport: asyncio.Transport) -> None:
        self.asked(transport)
        transport.abort()


def secret() -> str:
    """A random text for a token or a cookie."""
    return secrets.token_urlsafe(24)


def _same(given: str, own: str) -> bool:
    """Whether two texts are equal, in a time that does not tell where they differ."""
    return hmac.compare_digest(given.encode("utf-8", "surrogateescape"), own.encode())
