"""Attacks on a running app: foreign names, foreign pages, no token, foreign paths, too much data."""

import json

import pytest
from app_served import app, cookie_of, request

pytest.importorskip("nicegui", reason="NiceGUI is in the app extra")

SOCKET = "/_nicegui_ws/socket.io/?EIO=4&transport=websocket"
POLLING = "/_nicegui_ws/socket.io/?EIO=4&transport=polling"
UPGRADE = {
    "Upgrade": "websocket",
    "Connection": "Upgrade",
    "Sec-WebSocket-Version": "13",
    "Sec-WebSocket-Key": "dGhlIHNhbXBsZSBub25jZQ==",
}


@pytest.fixture(scope="module")
def served(tmp_path_factory):
    with app(tmp_path_factory.mktemp("guard") / "session") as running:
        yield running


@pytest.fixture(scope="module")
def own(served):
    """Headers of the app's own page."""
    return {"Host": f"127.0.0.1:{served.port}", "Cookie": cookie_of(served)}


def origin(served, name="127.0.0.1"):
    return {"Origin": f"http://{name}:{served.port}"}


def test_its_own_page_is_served_with_the_cookie_and_no_door_for_other_sites(served, own):
    status, headers, body = request(served.port, "/", own)
    assert status == 200
    assert b"qpal app" in body
    assert not [name for name in headers if name.startswith("access-control")]
    assert "frame-ancestors 'none'" in headers["content-security-policy"]
    assert "https:" not in headers["content-security-policy"]  # nothing comes from elsewhere
    assert headers["x-content-type-options"] == "nosniff"


def test_the_cookie_is_for_this_site_and_no_script(served):
    _, headers, _ = request(served.port, f"/?token={served.token}", {"Host": f"127.0.0.1:{served.port}"})
    assert {"HttpOnly", "SameSite=Strict"} <= {part.strip() for part in headers["set-cookie"].split(";")}
    assert served.token not in headers["set-cookie"]
    assert headers["location"] == "/"  # the token leaves the address line


@pytest.mark.parametrize("path", ["/", SOCKET, POLLING, "/files/models/m1/model.json", "/_nicegui/client/x/upload/1"])
@pytest.mark.parametrize("method", ["GET", "POST", "OPTIONS", "HEAD"])
def test_without_the_cookie_nothing_is_reached(served, path, method):
    for extra in ({}, {"Cookie": f"qpal_{served.port}=x"}, {"Cookie": f"qpal_{served.port}={served.token}"}):
        status, _, _ = request(
            served.port, path, {"Host": f"127.0.0.1:{served.port}", **origin(served), **extra}, method
        )
        assert status == 403


@pytest.mark.parametrize("token", ["", "x", "wrong-token", "%00"])
def test_a_wrong_token_gives_no_cookie(served, token):
    status, headers, _ = request(served.port, f"/?token={token}", {"Host": f"127.0.0.1:{served.port}"})
    assert status == 403
    assert "set-cookie" not in headers


@pytest.mark.parametrize(
    "host",
    [
        "evil.example",
        "evil.example:{port}",
        "127.0.0.1",
        "127.0.0.1:1",
        "127.0.0.1.evil.example:{port}",
        "[::1]:{port}",
        "0.0.0.0:{port}",
    ],
)
@pytest.mark.parametrize("path", ["/", POLLING])
def test_a_foreign_host_is_refused_token_and_cookie_or_not(served, own, host, path):
    name = host.format(port=served.port)
    status, headers, _ = request(served.port, path, {**own, "Host": name})
    assert status == 403
    status, headers, _ = request(served.port, f"/?token={served.token}", {"Host": name})
    assert status == 403
    assert "set-cookie" not in headers


@pytest.mark.parametrize(
    "page", ["http://evil.example", "null", "https://127.0.0.1:{port}", "http://127.0.0.1:1", "http://localhost:{port}"]
)
def test_a_foreign_origin_is_refused_on_http_and_websocket(served, own, page):
    foreign = {**own, "Origin": page.format(port=served.port)}
    assert request(served.port, "/", foreign)[0] == 403
    assert request(served.port, POLLING, foreign, "POST", b"40")[0] == 403
    assert request(served.port, SOCKET, {**foreign, **UPGRADE})[0] == 403


def test_a_websocket_or_a_write_says_where_it_comes_from(served, own):
    assert request(served.port, SOCKET, {**own, **UPGRADE})[0] == 403
    assert request(served.port, POLLING, own, "POST", b"40")[0] == 403
    assert request(served.port, SOCKET, {**own, **UPGRADE, **origin(served)})[0] == 101  # the page itself


def test_a_websocket_without_the_cookie_or_with_a_foreign_host_is_refused(served, own):
    bare = {"Host": own["Host"], **UPGRADE, **origin(served)}
    assert request(served.port, SOCKET, bare)[0] == 403
    assert request(served.port, SOCKET, {**own, **UPGRADE, **origin(served), "Host": "evil.example"})[0] == 403


def test_another_page_cannot_embed_it(served, own):
    framed = {"Sec-Fetch-Site": "cross-site", "Sec-Fetch-Mode": "no-cors", "Sec-Fetch-Dest": "script"}
    assert request(served.port, "/", {**own, **framed})[0] == 403


def test_no_path_leads_out_of_the_session(served, own):
    head = json.loads((served.session / "session.json").read_text())
    assert head["format"] == "qpal session"
    for path in (
        "/files/models/../../session.json",
        "/files/models/..%2f..%2f/session.json",
        "/files/data/d1/log.csv",
        "/files/models/m1/..%2f..%2fsession.json",
        "/files/session/complaints/x",
        "//etc/passwd",
        "/files/models/%2e%2e/entry.json",
    ):
        status, _, body = request(served.port, path, own)
        assert status in (400, 403, 404), path
        assert b"qpal session" not in body
        assert b"root:" not in body


def test_too_large_a_body_is_refused_before_it_is_read(served, own):
    huge = {**own, **origin(served), "Content-Length": str(2**40)}
    status, _, body = request(served.port, "/_nicegui/client/x/upload/1", huge, "POST", b"x")
    assert status == 413
    assert b"MiB" in body


def test_only_the_loopback_listens(served):
    with open("/proc/net/tcp") as file:
        rows = [line.split() for line in file][1:]
    mine = [row[1] for row in rows if row[3] == "0A" and int(row[1].split(":")[1], 16) == served.port]
    assert mine == [f"0100007F:{served.port:04X}"]


def test_the_guard_counts_a_body_whose_length_is_not_stated():
    """A chunked body ends in 413 when it passes the limit, and the application never sees the rest."""
    import asyncio

    from twin.app.server import Guard

    seen, sent = [], []

    async def application(scope, receive, send):
        while True:
            message = await receive()
            seen.append(len(message["body"]))
            if not message["more_body"]:
                break

    async def receive():
        return {"type": "http.request", "body": b"x" * 40, "more_body": True}

    async def send(message):
        sent.append(message)

    guard = Guard(application, 80, "t", "c", largest=100)
    headers = {"host": "127.0.0.1:80", "origin": "http://127.0.0.1:80", "cookie": "qpal_80=c"}
    pairs = [(name.encode(), value.encode()) for name, value in headers.items()]
    scope = {"type": "http", "method": "POST", "path": "/x", "headers": pairs}
    asyncio.run(guard(scope, receive, send))
    assert seen == [40, 40]
    assert sent[0]["status"] == 413
