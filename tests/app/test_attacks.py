"""One table of attacks on both pages that qpal serves on this machine: the app, and the viewer of `qpal view --web`."""

import asyncio
import select
import socket
import time
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field

import pytest
from app_served import app, request, viewer

pytest.importorskip("nicegui", reason="NiceGUI is in the app extra")
pytest.importorskip("websockets", reason="it is what the viewer's server is made of")

UPGRADE = {
    "Upgrade": "websocket",
    "Connection": "Upgrade",
    "Sec-WebSocket-Version": "13",
    "Sec-WebSocket-Key": "dGhlIHNhbXBsZSBub25jZQ==",
}
REFUSED = {400, 403, 405, 413, 414, 431}
SECRET = (b"<html", b"shank_rod", b"qpal session", b"root:", b"total_bytes")
WAITED = 30.0  # [s] that a test waits for what comes at once


@dataclass
class Site:
    """A page that is served: its port, the token of its address, and where on it what is."""

    port: int
    token: str
    socket: str
    paths: tuple[str, ...]
    cookie: str = field(default="", repr=False)

    @property
    def here(self):
        return {"Host": f"127.0.0.1:{self.port}"}

    @property
    def origin(self):
        return {"Origin": f"http://127.0.0.1:{self.port}"}

    @property
    def own(self):
        return {**self.here, "Cookie": self.cookie}


@contextmanager
def window(folder):
    """`qpal view --web` of the robot on a free port."""
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    with viewer(folder, "--port", str(port)) as (process, port, token):
        until(lambda: request(port, "/", {"Host": f"127.0.0.1:{port}"})[0])
        yield Site(port, token, "/state?sid=a", ("/", "/model", "/model?total_bytes", "/state?sid=a", "/ui?sid=a"))
        assert process.poll() is None, "no attack ends the viewer"


@contextmanager
def desk(folder):
    """`qpal app` on a free port."""
    socket_path = "/_nicegui_ws/socket.io/?EIO=4&transport="
    with app(folder / "session") as served:
        paths = ("/", f"{socket_path}polling", f"{socket_path}websocket", "/files/models/m1/model.json")
        yield Site(served.port, served.token, f"{socket_path}websocket", paths)
        assert served.process.poll() is None, "no attack ends the app"


@pytest.fixture(scope="module", params=[window, desk], ids=["view", "app"])
def site(request, tmp_path_factory):
    with request.param(tmp_path_factory.mktemp("served")) as found:
        found.cookie = enter(found)
        yield found


def enter(site):
    """The cookie that the address with the token gives."""
    status, headers, _ = request(site.port, f"/?token={site.token}", site.here)
    assert status == 303
    assert headers["location"] == "/"  # the token leaves the address line
    assert {"HttpOnly", "SameSite=Strict"} <= {part.strip() for part in headers["set-cookie"].split(";")}
    return headers["set-cookie"].partition(";")[0]


def until(look):
    end = time.monotonic() + WAITED
    while time.monotonic() < end:
        if found := look():
            return found
        time.sleep(0.1)
    raise AssertionError("nothing came")


def foreign_origin(site):
    for name in (
        "http://evil.example",
        f"http://evil.example:{site.port}",
        "null",
        "file://",
        "http://127.0.0.1:1",
        "",
    ):
        for path in site.paths:
            yield path, {**site.own, "Origin": name}
            yield path, {**site.own, "Origin": name, **UPGRADE}


def foreign_host(site):
    for name in ("evil.example", f"evil.example:{site.port}", "127.0.0.1", f"127.0.0.1.nip.io:{site.port}", ""):
        for path in (*site.paths, f"/?token={site.token}"):
            yield path, {**site.own, "Host": name}
            yield path, {**site.own, "Host": name, "Origin": f"http://{name}", **UPGRADE}


def no_token(site):
    for cookie in ({}, {"Cookie": f"qpal_{site.port}=x"}, {"Cookie": f"qpal_{site.port}={site.token}"}):
        for path in site.paths:
            yield path, {**site.here, **cookie}
            yield path, {**site.here, **site.origin, **UPGRADE, **cookie}


def wrong_token(site):
    for token in ("", "x", site.token[:-1], site.token + "x", "%00", f"{site.token}&token={site.token}"):
        yield f"/?token={token}", site.here
    yield f"/model?token={site.token}", site.here
    yield f"/state?token={site.token}", {**site.here, **site.origin, **UPGRADE}


def inside_another_page(site):
    for path in site.paths:
        yield path, {**site.own, "Sec-Fetch-Site": "cross-site", "Sec-Fetch-Mode": "no-cors"}
        yield path, {**site.own, "Sec-Fetch-Site": "same-site", "Sec-Fetch-Dest": "iframe"}


def another_model(site):
    """The way that a model takes which is dropped on MuJoCo's page, and writes of every kind."""
    yield "/drop?sid=a", {**site.own, "Origin": "http://evil.example", **UPGRADE}
    yield "/drop?sid=a", {**site.own, **site.origin, **UPGRADE}
    for method in ("PUT", "DELETE", "PATCH", "TRACE", "PROPFIND"):
        for path in ("/drop", "/model", "/"):
            yield path, {**site.own, **site.origin}, method
            yield path, {**site.own, **site.origin}, method, b"<mujoco/>"
    for path in ("/drop", "/model"):
        yield path, site.own, "POST", b"<mujoco/>"  # does not say where it comes from


def too_much(site):
    yield "/drop", {**site.own, **site.origin, "Content-Length": str(2**40)}, "POST", b"x"
    yield "/", {**site.here, "X-Long": "a" * 200_000}
    yield "/" + "a" * 200_000, site.here


TABLE = (foreign_origin, foreign_host, no_token, wrong_token, inside_another_page, another_model, too_much)


@pytest.mark.parametrize("attack", TABLE, ids=lambda attack: attack.__name__)
def test_an_attack_is_refused_and_reads_nothing(site, attack):
    for path, headers, *how in attack(site):
        status, answered, body = request(site.port, path, headers, *how)
        closed = status == 0 and (attack is too_much or len(how) == 2)  # before a body that nobody reads
        assert status in REFUSED or closed, (path[:60], headers, how, status)
        assert not [name for name in answered if name.startswith("access-control")], path
        assert "set-cookie" not in answered
        assert not [mark for mark in SECRET if mark in body], path


def test_no_path_leads_out_even_with_the_cookie(site):
    for path in (
        "/../../../../../../../../etc/passwd",
        "/..%2f..%2f..%2f..%2f..%2fetc%2fpasswd",
        "/assets/../../../../../../etc/passwd",
        "/%2e%2e/%2e%2e/%2e%2e/etc/passwd",
        "//etc/passwd",
        "/..\\..\\etc\\passwd",
        "file:///etc/passwd",
    ):
        status, _, body = request(site.port, path, site.own)
        assert status in {0, 400, 403, 404}, path
        assert b"root:" not in body


def test_the_rightful_browser_is_let_in_and_no_other_page_may_read_it(site):
    status, headers, body = request(site.port, "/", site.own)
    assert status == 200
    assert b"<html" in body
    assert not [name for name in headers if name.startswith("access-control")]
    live = {**site.own, **site.origin, **UPGRADE}
    with socket.create_connection(("127.0.0.1", site.port), timeout=WAITED) as line:
        head = "".join(f"{name}: {value}\r\n" for name, value in live.items())
        line.sendall(f"GET {site.socket} HTTP/1.1\r\n{head}\r\n".encode())
        received = b""
        while len(received.partition(b"\r\n\r\n")[2]) < 4:  # frames follow the handshake: the page is live
            part = line.recv(65536)
            assert part, received
            received += part
    assert received.startswith(b"HTTP/1.1 101 ")


COOKIES_OF_OTHERS = (
    'theme={"dark": true}', 'prefs={"a":1,"b":2}', "name=J\xfcrgen", "flag", "a[b]=1", "p=50% off", "path=/home",
    "version=3", "domain=lab", "", "=", 'open="never closed', "secure", "qpal_1=x", "a=b=c",
)  # fmt: skip


@pytest.mark.parametrize("other", COOKIES_OF_OTHERS)
def test_cookies_of_other_servers_of_this_machine_keep_nobody_out(site, other):
    """A cookie knows no port: the browser sends those of every server at this name, and RFC 6265 lets them be any."""
    for sent in (f"{other}; {site.cookie}", f"{site.cookie}; {other}", f"{other};{site.cookie};{other}"):
        assert request(site.port, "/", {**site.here, "Cookie": sent})[0] == 200, sent
    name, _, value = site.cookie.partition("=")
    for wrong in (
        f"{other}; {name}={value}x",
        f"{other}; x{site.cookie}",
        f'{other}; x="; {name}="',
        f"{name}; {value}",
    ):
        assert request(site.port, "/", {**site.here, "Cookie": wrong})[0] == 403, wrong


def test_silent_connections_are_few_and_keep_nobody_out(site):
    with ExitStack() as stack:
        lines = []
        for _ in range(260):
            line = stack.enter_context(socket.create_connection(("127.0.0.1", site.port), timeout=WAITED))
            line.sendall(b"GET / HT")
            lines.append(line)
        begun = time.monotonic()
        assert request(site.port, "/", site.own)[0] == 200
        assert time.monotonic() - begun < WAITED
        until(lambda: len(lines) - _closed(lines) <= 200)


def _closed(lines):
    return len(select.select(lines, [], [], 0)[0])  # nothing is sent to them, so what can be read is the end


def test_a_silent_connection_has_its_time():
    """With a clock of hundredths of a second: the oldest goes first, one that asked stays, one that waits goes."""
    from twin.view.door import SilentConnections

    class Transport:
        gone = False

        def abort(self):
            self.gone = True

    async def story():
        waiting = SilentConnections(limit=2, seconds=0.05)
        transports = [Transport() for _ in range(3)]
        for each in transports:
            waiting.add(each)
        assert [each.gone for each in transports] == [True, False, False]
        waiting.remove(transports[1])
        await asyncio.sleep(0.2)
        assert [each.gone for each in transports] == [True, False, True]
        assert len(waiting) == 0

    asyncio.run(story())


def test_the_token_on_a_command_line_opens_once():
    from twin.view.door import Door, Request

    door = Door(80, "token", "cookie", once="once")
    asked = Request("GET", "/", "token=once", {"host": ["127.0.0.1"]}, False)
    assert door.answer(asked).status == 303
    assert door.answer(asked).status == 403
    assert door.answer(Request("GET", "/", "token=token", asked.headers, False)).status == 303
