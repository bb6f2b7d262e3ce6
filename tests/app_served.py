"""What the tests of the app share: a running app, plain requests to it, and a browser."""

import os
import re
import shutil
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import polars as pl
import pytest

CHROMIUM, DRIVER = "/usr/bin/chromium", "/usr/bin/chromedriver"
FLAGS = (
    "--headless=new",
    "--no-sandbox",
    "--disable-gpu",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--disable-dev-shm-usage",
    "--enable-unsafe-swiftshader",
    "--window-size=1400,1000",
)
PATIENCE = 300.0  # [s] until a test gives up: on a busy machine pages and fits take minutes


@contextmanager
def viewer(home: Path, *options: str) -> Iterator[tuple[subprocess.Popen, int, str]]:
    """`qpal view --web` of the robot, without a display: its process, its port and its token."""
    process = subprocess.Popen(
        [sys.executable, "-m", "twin.cli", "view", "--web", *options],
        env={**os.environ, "HOME": str(home), "DISPLAY": "", "WAYLAND_DISPLAY": "", "BROWSER": "true"},
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
    )
    try:
        found = re.search(r"http://localhost:(\d+)/\?token=(\S+)", process.stdout.readline())
        assert found, "the address has a token"
        yield process, int(found[1]), found[2]
    finally:
        process.kill()
        process.communicate()


@dataclass
class Served:
    """An app that runs: its process, its port, its token, its session."""

    process: subprocess.Popen
    port: int
    token: str
    session: Path

    @property
    def address(self) -> str:
        return f"http://127.0.0.1:{self.port}/?token={self.token}"

    def stop(self) -> tuple[int, str]:
        """Ctrl-C; the exit code and what was said."""
        self.process.send_signal(signal.SIGINT)
        said = self.process.communicate(timeout=PATIENCE)[0]
        return self.process.returncode, said


@contextmanager
def app(session: Path, *options: str) -> Iterator[Served]:
    """`qpal app` on a free port."""
    process = subprocess.Popen(
        [sys.executable, "-m", "twin.cli", "app", "--session", str(session), "--no-browser", *options],
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        cwd=session.parent,
    )
    assert process.stdout is not None
    said = []
    try:
        for line in process.stdout:
            said.append(line)
            found = re.search(r"http://127\.0\.0\.1:(\d+)/\?token=(\S+)", line)
            if found:
                break
        else:
            raise AssertionError("".join(said))
        served = Served(process, int(found[1]), found[2], session)
        _answers(served.port)
        yield served
    finally:
        process.terminate()
        try:
            process.wait(10)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()
        process.stdout.close()


def _answers(port: int) -> None:
    end = time.monotonic() + PATIENCE
    while time.monotonic() < end:
        status, _, _ = request(port, "/", {"Host": f"127.0.0.1:{port}"})
        if status == 403:
            return
        time.sleep(0.1)
    raise AssertionError("the app does not answer")


def request(
    port: int, path: str, headers: dict[str, str], method: str = "GET", body: bytes = b""
) -> tuple[int, dict[str, str], bytes]:
    """Status, headers and body of the answer to one plain request; status 0 if there is none."""
    head = "".join(f"{name}: {value}\r\n" for name, value in headers.items())
    length = f"Content-Length: {len(body)}\r\n" if body and "Content-Length" not in headers else ""
    close = "" if "Connection" in headers else "Connection: close\r\n"
    text = f"{method} {path} HTTP/1.1\r\n{head}{length}{close}\r\n".encode() + body
    received = b""
    try:
        with socket.create_connection(("127.0.0.1", port), timeout=PATIENCE) as line:
            line.sendall(text)
            while part := line.recv(65536):
                received += part
                if b" 101 " in received[:20]:
                    break
    except OSError:
        pass
    first, _, rest = received.partition(b"\r\n\r\n")
    if not first:
        return 0, {}, b""
    lines = first.decode("latin-1").split("\r\n")
    named = {name.lower(): value.strip() for name, _, value in (line.partition(":") for line in lines[1:])}
    return int(lines[0].split()[1]), named, rest


def cookie_of(served: Served) -> str:
    """The cookie that the address with the token gives."""
    status, headers, _ = request(served.port, f"/?token={served.token}", {"Host": f"127.0.0.1:{served.port}"})
    assert status == 303
    return headers["set-cookie"].partition(";")[0]


@contextmanager
def browser(folder: Path, *flags: str, log: bool = False) -> Iterator:
    """Chromium without a window, with a profile of its own; with `log`, its performance log has every request."""
    webdriver = pytest.importorskip("selenium.webdriver", reason="selenium is in the test extra")
    if not (os.path.exists(CHROMIUM) and os.path.exists(DRIVER)):
        pytest.skip("Chromium and its driver are not installed; on Debian: apt-get install chromium chromium-driver")
    options = webdriver.ChromeOptions()
    options.binary_location = CHROMIUM
    for flag in (*FLAGS, *flags, f"--user-data-dir={folder / 'profile'}"):
        options.add_argument(flag)
    if log:
        options.set_capability("goog:loggingPrefs", {"performance": "ALL", "browser": "ALL"})
    driver = webdriver.Chrome(options=options, service=webdriver.ChromeService(DRIVER))
    driver.set_page_load_timeout(PATIENCE)
    driver.execute_cdp_cmd("Page.setDownloadBehavior", {"behavior": "allow", "downloadPath": str(folder)})
    try:
        yield driver
    finally:
        driver.quit()
        shutil.rmtree(folder / "profile", ignore_errors=True)


def until(look, what: str = "", seconds: float = PATIENCE):
    """The first true result of `look`, which may fail meanwhile because the page changes under it."""
    from selenium.common.exceptions import WebDriverException

    end = time.monotonic() + seconds
    while time.monotonic() < end:
        try:
            if found := look():
                return found
        except WebDriverException:
            pass
        time.sleep(0.1)
    raise AssertionError(f"nothing came within {seconds:g} s: {what}")


def marked(page, name):
    """The element with this mark."""
    return page.find_element("css selector", f'[data-mark="{name}"]')


def there(page, name):
    """Whether there is an element with this mark."""
    return bool(page.find_elements("css selector", f'[data-mark="{name}"]'))


def click(page, name):
    """A click on what may lie below the window's edge."""
    until(lambda: page.execute_script("arguments[0].click(); return true", marked(page, name)), name)


def type_in(page, name, text):
    """Replaces what a field holds, as a person does, and leaves it."""
    from selenium.webdriver.common.keys import Keys

    field = until(lambda: marked(page, name), name)
    field.send_keys(Keys.CONTROL, "a", Keys.NULL, text, Keys.TAB)
    time.sleep(0.5)  # until the app has it


def drop(page, log):
    """Drops a log on the page."""
    page.find_element("css selector", "input[type=file]").send_keys(str(log))


def idle(page):
    """Waits for the end of all jobs."""
    return until(lambda: not there(page, "cancel"), "the end of all jobs")


def severe(page):
    """What the browser complains of, but for two that mean nothing: the software renderer, and a plot that was just
    taken away and is told its size."""
    rows = [row["message"] for row in page.get_log("browser") if row["level"] == "SEVERE"]
    return [row for row in rows if "WebGL" not in row and "displayed plot div" not in row]


def write_log(path: Path, N: int = 400, Ts: float = 0.05, noise: float = 0.01) -> Path:
    """A record of y_t = 0.8 y_{t-1} + 0.1 u_{t-1}, in volts and radians."""
    from scipy.signal import lfilter

    rng = np.random.default_rng(3)
    u = np.repeat(rng.uniform(-5.0, 5.0, -(-N // 8)), 8)[:N]
    y = lfilter([0.0, 0.1], [1.0, -0.8], u) + noise * rng.standard_normal(N)
    table = pl.DataFrame({"time_s": np.round(np.arange(N) * Ts, 6), "voltage_V": u, "angle_rad": y})
    table.write_csv(path, float_precision=6)
    return path


def write_process(path: Path, K: float = 0.5, T: float = 1.0, Td: float = 1.0, seed: int = 1, N: int = 600) -> Path:
    """A record, in volts and radians, of a gain K [rad/V], a time constant T and a delay Td [s], every 0.1 s."""
    from scipy.signal import lfilter

    rng, Ts = np.random.default_rng(seed), 0.1
    u = np.repeat(rng.uniform(-5.0, 5.0, -(-N // 25)), 25)[:N]
    pole = np.exp(-Ts / T)
    y = lfilter([0.0] * (round(Td / Ts) + 1) + [K * (1.0 - pole)], [1.0, -pole], u) + 0.02 * rng.standard_normal(N)
    table = pl.DataFrame({"time_s": np.round(np.arange(N) * Ts, 6), "voltage_V": u, "angle_rad": y})
    table.write_csv(path, float_precision=6)
    return path


def desk_with_a_record(folder: Path):
    """A desk of a session in `folder` with a record, on two cores."""
    from twin.app.desk import Desk
    from twin.app.jobs import Jobs
    from twin.app.session import Session

    desk = Desk(Session.open(folder / "session"), Jobs(2))
    desk.add_log("thigh.csv", write_log(folder / "log.csv"))
    wait(desk)
    return desk


def wait(desk, seconds=PATIENCE):
    """The jobs of a desk by title, when all are over."""
    end = time.monotonic() + seconds
    while any(not job.over for job in desk.jobs.all):
        assert time.monotonic() < end, [(job.title, job.progress) for job in desk.jobs.all]
        time.sleep(0.05)
    return {job.title: job for job in desk.jobs.all}
