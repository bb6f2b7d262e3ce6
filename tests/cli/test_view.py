"""`qpal view`: pictures without a display, a page on this machine, and sentences where there is nothing to show on."""

import os
import re
import signal
import socket
import subprocess
import sys
import time
import urllib.error
import urllib.request
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

import twin
from twin.cli import main
from twin.hardware.linkage import end_angles
from twin.view import pictures, stills
from twin.view.replay import Replay, movement
from twin.view.viewer import check_port

pytestmark = pytest.mark.pixels

linux = pytest.mark.skipif(not sys.platform.startswith("linux"), reason="about X11 and /proc")


@pytest.fixture
def logs(tmp_path, monkeypatch):
    """A folder, now the current one, with logs of a thigh that goes up and down for 4 s."""
    monkeypatch.chdir(tmp_path)
    t = np.arange(41) * 0.1
    low, high = end_angles(twin.Parameters(), "thigh")
    for name, lag in (("thigh.parquet", 0.0), ("thigh.csv", 0.0), ("rig.csv", 0.4)):
        y = low + (high - low) * (1 - np.cos(np.pi * (t - lag))) / 2
        twin.Log(12 * np.sin(t), y, 0.1, joint="thigh").save(tmp_path / name)
    lines = (tmp_path / "thigh.csv").read_text(encoding="utf-8").splitlines(keepends=True)
    (tmp_path / "plain.csv").write_text("".join(lines[1:]), encoding="utf-8")  # as from a program that keeps no header
    y = np.column_stack([y, y, y])
    twin.Log(np.zeros_like(y), y, 0.1, joint="leg").save(tmp_path / "leg.csv")
    return tmp_path


def run(arguments: list[str], capsys) -> tuple[int, str, str]:
    """Exit code, output and error of `qpal view`; skips where this machine cannot draw."""
    code = main(["view", *arguments])
    out, err = capsys.readouterr()
    if "no offscreen renderer works here" in err:
        pytest.skip(err.strip())
    return code, out, err


@pytest.mark.parametrize(
    "arguments",
    [
        ["plain.csv", "--joint", "thigh"],
        ["thigh.parquet", "--ghost", "rig.csv", "--count", "3", "--start", "1", "--stop", "2"],
        ["leg.csv", "--count", "2"],
        [],
    ],
    ids=["csv", "ghost", "all joints", "robot"],
)
def test_strip_is_one_png_and_nothing_else(arguments, logs, capsys):
    before = set(logs.iterdir())
    code, out, err = run([*arguments, "--strip", "strip.png"], capsys)
    assert (code, out, err) == (0, "Picture: strip.png\n", "")
    assert set(logs.iterdir()) - before == {logs / "strip.png"}
    pixels = np.asarray(Image.open("strip.png").convert("RGB"))
    assert pixels.shape[1] > 700
    assert len(np.unique(pixels.reshape(-1, 3), axis=0)) > 1000  # a picture of something, not a blank


def test_frames_are_twenty_for_a_second_of_the_clock(logs, capsys):
    code, out, _ = run(["thigh.parquet", "--speed", "10", "--frames", "film"], capsys)
    assert (code, out) == (0, "Frames: 9 in film\n")
    names = sorted(path.name for path in (logs / "film").iterdir())
    assert names == [f"frame-{k:04d}.png" for k in range(1, 10)]
    first, middle, last = (np.asarray(Image.open(logs / "film" / names[k])).astype(int) for k in (0, 2, 8))
    here = (slice(40, 440), slice(None))  # without the captions
    assert np.mean(np.abs(first[here] - middle[here]) > 40) > 0.01
    assert np.mean(np.abs(first[here] - last[here]) > 40) < 0.001  # the record ends where it began


def test_gif_runs_at_the_speed_that_was_asked_for(logs, capsys):
    code, _, _ = run(["thigh.parquet", "--ghost", "rig.csv", "--speed", "8", "--gif", "film.gif"], capsys)
    assert code == 0
    with Image.open("film.gif") as film:
        assert film.n_frames == 6  # both ends of half a second
        assert film.info["duration"] * film.n_frames == pytest.approx(1000 * 4.0 / 8.0, abs=100)
        assert film.info["loop"] == 0


def test_a_second_of_gif_is_few_small_pictures_with_a_small_shadow_map(logs, monkeypatch, capsys):
    """Software draws a picture in a time that grows with its pixels, its samples a pixel and its shadow map."""
    asked = []

    def drawing(model, qpos, cameras, *, size=(640, 480), film=False, **_):
        asked.append((len(qpos), *size, film))
        return [np.zeros((size[1], size[0], 3), dtype=np.uint8) + k for k in range(len(qpos))]

    monkeypatch.setattr(pictures, "draw", drawing)
    assert main(["view", "thigh.parquet", "--speed", "4", "--gif", "film.gif"]) == 0
    capsys.readouterr()
    with Image.open("film.gif") as film:
        assert film.size == (480, 360)
    assert sum(n * width * height for n, width, height, _ in asked) <= 11 * 480 * 360
    assert all(film for *_, film in asked)


def test_a_film_shows_what_a_still_shows(logs):
    replay = Replay(movement(twin.Log.load("thigh.csv")))
    size = replay.model.vis.quality.shadowsize
    pose = [replay.pose(1.0)]
    try:
        still, film = (stills.draw(replay.model, np.array(pose), [{}], film=f)[0].astype(int) for f in (False, True))
    except stills.NoRenderer as reason:
        pytest.skip(str(reason))
    assert 0.0 < np.mean(np.abs(still - film)) < 2.0
    assert replay.model.vis.quality.shadowsize == size


def test_without_a_renderer_it_is_one_sentence_and_no_file(logs, monkeypatch, capsys):
    monkeypatch.setattr(stills, "BACKENDS", ("no-such-backend",))
    before = set(logs.iterdir())
    assert main(["view", "thigh.parquet", "--strip", "strip.png"]) == 2
    err = capsys.readouterr().err
    assert err.count("\n") == 1
    assert "no offscreen renderer works here" in err
    assert set(logs.iterdir()) == before


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        ("plain.csv", "give --joint"),
        ("plain.csv --joint knee", "shoulder, thigh, shank"),
        ("thigh.parquet --joint shank", "leave --joint out"),
        ("missing.csv --strip a.png", "missing.csv does not exist"),
        ("thigh.parquet --ghost missing.csv --strip a.png", "missing.csv does not exist"),
        ("thigh.parquet --strip a.jpg", "ends in .png"),
        ("thigh.parquet --gif a.png", "ends in .gif"),
        ("thigh.parquet --strip nowhere/a.png", "there is no folder nowhere"),
        ("thigh.parquet --strip a.png --count 1", "give 2 to 12 frames"),
        ("thigh.parquet --strip a.png --start 3 --stop 2", "start before the stop"),
        ("thigh.parquet --strip a.png --stop 5", "goes from 0 to 4 s"),
        ("thigh.parquet --speed 0", "--speed is 0"),
        ("thigh.parquet --speed nan", "--speed is nan"),
        ("thigh.parquet --speed 0.01 --frames film", "give --speed 1 or show a part"),
        ("thigh.parquet --web --strip a.png", "--web and --strip are given"),
        ("thigh.parquet --port 9000", "add --web"),
        ("--web --port 70000", "from 1 to 65535"),
        ("--ghost thigh.csv", "qpal view LOG --ghost"),
        ("--gif a.gif", "give a LOG"),
    ],
)
def test_bad_input_is_one_sentence(arguments, said, logs, capsys):
    before = set(logs.iterdir())
    assert main(["view", *arguments.split()]) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert err.count("\n") == 1
    assert said in err
    assert set(logs.iterdir()) == before


@linux
@pytest.mark.parametrize("display", [None, ":4077"], ids=["none", "dead"])
@pytest.mark.parametrize("arguments", [[], ["thigh.parquet"]], ids=["robot", "log"])
def test_no_display_is_one_sentence_and_no_wait(display, arguments, logs):
    environment = {name: value for name, value in os.environ.items() if name not in ("DISPLAY", "WAYLAND_DISPLAY")}
    done = subprocess.run(
        [sys.executable, "-m", "twin.cli", "view", *arguments],
        env=environment | ({} if display is None else {"DISPLAY": display}),
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )
    assert done.returncode == 2, done.stderr
    assert done.stdout == ""
    assert done.stderr.count("\n") == 1
    assert "--web" in done.stderr
    assert "--strip" in done.stderr


def test_a_web_viewer_that_is_not_installed_is_a_sentence(logs, monkeypatch, capsys):
    monkeypatch.setitem(sys.modules, "twin.view.web", None)
    assert main(["view", "thigh.parquet", "--web"]) == 2
    assert "pip install mujoco-studio" in capsys.readouterr().err


def test_a_port_that_is_taken_is_a_sentence(logs, capsys):
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = taken.getsockname()[1]
        assert main(["view", "thigh.parquet", "--web", "--port", str(port)]) == 2
    assert f"--port {port} is not available" in capsys.readouterr().err
    check_port(port)  # free again


@pytest.mark.skipif(sys.platform == "win32", reason="ends the server with Ctrl-C as a POSIX signal")
@pytest.mark.parametrize("arguments", [[], ["thigh.parquet", "--ghost", "rig.csv"]], ids=["robot", "ghost"])
def test_web_serves_page_and_model_on_this_machine_until_ctrl_c(arguments, logs):
    server = subprocess.Popen(
        [sys.executable, "-m", "twin.cli", "view", *arguments, "--web"],
        env={**os.environ, "HOME": str(logs), "DISPLAY": "", "WAYLAND_DISPLAY": "", "BROWSER": "true"},
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
    )
    try:
        assert server.stdout is not None
        found = re.search(r"http://localhost:(\d+)/\?token=(\S+)", server.stdout.readline())
        assert found, "the address comes first"
        own = browser()
        assert b"MuJoCo" in fetch(f"http://127.0.0.1:{found[1]}/?token={found[2]}", own)
        for _ in range(100):  # an empty model is there first
            if len(model := fetch(f"http://127.0.0.1:{found[1]}/model", own)) > 10_000:
                break
            time.sleep(0.2)
        assert b"shank_rod" in model
        if sys.platform.startswith("linux"):
            assert listeners(int(found[1])) == {"0100007F"}  # 127.0.0.1 alone, as the kernel writes it
        assert_answers_its_own_page_alone(int(found[1]), found[2])
        time.sleep(0.5)  # some frames, which would end it if one failed
        server.send_signal(signal.SIGINT)
        assert server.wait(30) == 0
    finally:
        server.kill()
        server.communicate()


def assert_answers_its_own_page_alone(port: int, token: str) -> None:
    own = f"localhost:{port}"
    kept = answer(port, f"/?token={token}", [f"Host: {own}"])[1]["set-cookie"].partition(";")[0]

    def ask(port: int, target: str, headers: list[str]) -> tuple[int, dict[str, str]]:
        return answer(port, target, [*headers, f"Cookie: {kept}"])

    for host in (own, own.upper(), f"127.0.0.1:{port}", f"[::1]:{port}"):
        for target in ("/", "/model", "/model?total_bytes"):
            status, headers = ask(port, target, [f"Host: {host}"])
            assert status == 200
            assert "access-control-allow-origin" not in headers  # which would let any page read it
        assert ask(port, "/model", [f"Host: {host}", f"Origin: http://{host}"])[0] == 200
        for target in ("/state?sid=a", "/ui?sid=a"):
            status, headers = ask(port, target, [f"Host: {host}", f"Origin: http://{host}", *UPGRADE])
            assert status == 101
            assert "access-control-allow-origin" not in headers
    for target, more in [("/", []), ("/model", []), ("/state?sid=b", UPGRADE), ("/ui?sid=b", UPGRADE)]:
        for host in (
            *("rebound.example", f"rebound.example:{port}", f"localhost.rebound.example:{port}", f"localhost.:{port}"),
            *(f"127.0.0.1.nip.io:{port}", f"0.0.0.0:{port}", f"x@localhost:{port}", "localhost", "localhost:1", ""),
        ):
            assert ask(port, target, [f"Host: {host}", *more])[0] == 403, host
        assert ask(port, target, [f"Host: {own}", "Host: rebound.example", *more])[0] == 403
        assert ask(port, target, more)[0] == 403  # no Host at all
        for origin in (
            *("http://evil.example", f"http://evil.example:{port}", "null", "http://localhost", "http://localhost:1"),
            *(f"https://localhost:{port}", f"http://localhost:{port}.evil.example", "file://", ""),
        ):
            assert ask(port, target, [f"Host: {own}", f"Origin: {origin}", *more])[0] == 403, origin
        assert ask(port, target, [f"Host: {own}", "Sec-Fetch-Site: cross-site", *more])[0] == 403
        assert (
            ask(port, target, [f"Host: {own}", "Sec-Fetch-Site: same-site", "Sec-Fetch-Mode: no-cors", *more])[0] == 403
        )
    followed = ["Sec-Fetch-Site: cross-site", "Sec-Fetch-Mode: navigate"]
    assert ask(port, "/", [f"Host: {own}", *followed, "Sec-Fetch-Dest: document"])[0] == 200  # a link to it
    assert ask(port, "/", [f"Host: {own}", *followed, "Sec-Fetch-Dest: iframe"])[0] == 403
    for target in ("/drop", "/drop?sid=a"):  # a model from elsewhere, which could name files of this machine
        assert ask(port, target, [f"Host: {own}", f"Origin: http://{own}", *UPGRADE])[0] == 403


UPGRADE = [
    *("Connection: Upgrade", "Upgrade: websocket", "Sec-WebSocket-Version: 13"),
    "Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==",
]


def answer(port: int, target: str, headers: list[str]) -> tuple[int, dict[str, str]]:
    """Status and headers of the answer to a GET with exactly these headers."""
    with socket.create_connection(("127.0.0.1", port), timeout=30) as line:
        line.sendall("\r\n".join([f"GET {target} HTTP/1.1", *headers, "", ""]).encode())
        said = b""
        while b"\r\n\r\n" not in said:
            part = line.recv(4096)
            assert part, f"closed after {said!r}"
            said += part
    first, *rest = said.partition(b"\r\n\r\n")[0].decode().split("\r\n")
    return int(first.split()[1]), {name.lower(): value for name, _, value in (row.partition(": ") for row in rest)}


def browser() -> urllib.request.OpenerDirector:
    """What keeps the cookie that the address with the token gives."""
    return urllib.request.build_opener(urllib.request.ProxyHandler({}), urllib.request.HTTPCookieProcessor())


def fetch(address: str, direct: urllib.request.OpenerDirector) -> bytes:
    """What a server sends that is about to listen."""
    for _ in range(100):
        try:
            with direct.open(address, timeout=30) as answer:
                return answer.read()
        except urllib.error.URLError:
            time.sleep(0.2)
    raise AssertionError(f"nothing at {address}")


def listeners(port: int) -> set[str]:
    """Addresses that listen on `port`, in hexadecimal."""
    rows = [line.split() for table in ("tcp", "tcp6") for line in Path(f"/proc/net/{table}").read_text().splitlines()]
    ends = [row[1].split(":") for row in rows if row[3] == "0A"]
    return {address for address, number in ends if int(number, 16) == port}
