"""Fifty clients on the app at once for a minute: some open pages and sockets as a browser does, others do not.

Each client goes on with one request after the other, drawn from those that the owner makes and from those that others
try: without the token, from another host, with odd paths, heads and bodies, and lines that are left in the middle. Bad
are: an answer of another kind than is right, no answer, one that takes long; afterwards an app that has ended, that
keeps descriptors, prints a traceback, or does not stop when it is told to.
"""

import os
import random
import socket
import tempfile
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from app_served import Served, app, cookie_of, request
from fuzz.tally import Tally

CLIENTS, SECONDS = 50, 60.0  # of a full attack
SLOW = 30.0  # [s] for an answer, with fifty clients and few processors
SPARE = 10  # descriptors beyond those before: kernels and listeners that stay
SOCKET = "/_nicegui_ws/socket.io/?EIO=4&transport="
UPGRADE = {
    "Upgrade": "websocket",
    "Connection": "Upgrade",
    "Sec-WebSocket-Version": "13",
    "Sec-WebSocket-Key": "dGhlIHNhbXBsZSBub25jZQ==",
}
GONE = (0, 400, 403, 404, 405, 411, 413, 414, 431, 501)  # to nonsense, a closed line is an answer as well


@dataclass(frozen=True)
class Site:
    """A served app and its owner's cookie."""

    served: Served
    cookie: str

    def ask(self, path: str, own: bool = True, method: str = "GET", body: bytes = b"", **heads: str) -> int:
        """The status of an answer; `own` sends the cookie."""
        here = f"127.0.0.1:{self.served.port}"
        first = {"Host": here, **({"Cookie": self.cookie} if own else {})}
        named = {name.replace("_", "-"): value for name, value in heads.items()}
        return request(self.served.port, path, {**first, **named}, method, body)[0]

    def socket(self, own: bool) -> int:
        """The status of a request for a socket."""
        return self.ask(f"{SOCKET}websocket", own, **UPGRADE, Origin=f"http://127.0.0.1:{self.served.port}")

    def half(self, draw: random.Random) -> int:
        """A line that is left in the middle of what it says; 0."""
        said = f"GET /?token={self.served.token} HTTP/1.1\r\nHost: 127.0.0.1:{self.served.port}\r\n\r\n".encode()
        with socket.create_connection(("127.0.0.1", self.served.port), timeout=SLOW) as line:
            line.sendall(said[: draw.randrange(len(said))])
        return 0


Ask = Callable[[Site, random.Random], int]
# What is asked, and the statuses that are right.
ASKED: dict[str, tuple[Ask, tuple[int, ...]]] = {
    "page": (lambda site, draw: site.ask("/"), (200,)),
    "address with the token": (lambda site, draw: site.ask(f"/?token={site.served.token}", False), (303,)),
    "socket": (lambda site, draw: site.socket(True), (101,)),
    "file that is not there": (lambda site, draw: site.ask("/files/models/m9/model.json"), (404,)),
    "page without the token": (lambda site, draw: site.ask("/", False), (403,)),
    "wrong token": (lambda site, draw: site.ask(f"/?token={draw.randbytes(16).hex()}", False), (403,)),
    "socket without the token": (lambda site, draw: site.socket(False), (403,)),
    "another host": (lambda site, draw: site.ask("/", Host="evil.example"), (400, 403)),
    "another origin": (lambda site, draw: site.ask(f"{SOCKET}polling", Origin="http://evil.example"), (400, 403)),
    "odd path": (lambda site, draw: site.ask("/" + _odd(draw, 200)), (200, *GONE)),
    "path upwards": (lambda site, draw: site.ask("/files/" + "../" * draw.randrange(1, 9) + "etc/passwd"), GONE),
    "odd method": (lambda site, draw: site.ask("/", method=draw.choice(("PUT", "DELETE", "TRACE", "ODD"))), GONE),
    "long head": (lambda site, draw: site.ask("/", X_Odd="x" * draw.randrange(1 << 20)), (200, *GONE)),
    "odd body": (lambda site, draw: site.ask(f"{SOCKET}polling", method="POST", body=draw.randbytes(4096)), GONE),
    "half a request": (lambda site, draw: site.half(draw), (0,)),
}


def _odd(draw: random.Random, length: int) -> str:
    return "".join(f"%{draw.randrange(256):02x}" for _ in range(draw.randrange(length)))


def client(site: Site, seed: str, ends: float, names: list[str]) -> list[tuple[str, str, str]]:
    """Until the time ends: what was asked, its kind of fault ("" for none) and a sample."""
    draw, found = random.Random(seed), []
    while time.monotonic() < ends:
        name = draw.choice(names)
        ask, right = ASKED[name]
        began = time.monotonic()
        try:
            status: Any = ask(site, draw)
        except OSError as error:
            status = repr(error)
        took = time.monotonic() - began
        fault = "slow" if took > SLOW else "" if status in right else "another answer"
        found.append((name, fault, f"{name}: {status} after {took:.1f} s"))
    return found


def descriptors(site: Site) -> int:
    """How many files and lines the app holds."""
    return len(os.listdir(f"/proc/{site.served.process.pid}/fd"))


def attack(chosen: Any) -> Tally:
    """The requests whose name has the part."""
    tally, names = Tally(), [name for name in ASKED if chosen.part in name]
    with tempfile.TemporaryDirectory() as folder, app(Path(folder) / "session") as served:
        site = Site(served, cookie_of(served))
        site.ask("/")
        before, ends = descriptors(site), time.monotonic() + max(5.0, SECONDS * chosen.scale)
        with ThreadPoolExecutor(CLIENTS) as pool:
            told = pool.map(lambda k: client(site, f"{chosen.seed} {k}", ends, names), range(CLIENTS))
            for name, fault, sample in (each for found in told for each in found):
                tally.case(name, [(fault, sample)] if fault else [])
        faults = []
        if served.process.poll() is not None or site.ask("/") != 200:
            faults.append(("the app has ended", str(served.process.poll())))
        else:
            waited = time.monotonic() + SLOW
            while descriptors(site) > before + SPARE and time.monotonic() < waited:
                time.sleep(0.5)
            if descriptors(site) > before + SPARE:
                faults.append(("descriptors are kept", f"{before} before, {descriptors(site)} after"))
        code, said = served.stop()
        faults += [("does not stop", str(code))] if code not in (0, 130) else []
        faults += [("traceback", said[-600:])] if "Traceback" in said else []
        tally.case("stopped", faults)
    return tally
