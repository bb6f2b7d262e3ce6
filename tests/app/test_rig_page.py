"""The page Rig in a real Chromium, on an emulated leg in this process, which says itself when its drive is off."""

import re
import threading
import time

import numpy as np
import pytest
from app_served import app, browser, until

pytest.importorskip("nicegui", reason="NiceGUI is in the app extra")
pytest.importorskip("serial", reason="the rig needs pyserial: pip install 'qpal[rig]'")

from twin.app.desk import Desk
from twin.app.session import Session
from twin.rig import wire
from twin.rig.emulator import Emulator

# A leg that moves in real time beside a browser: on two busy cores a page waits for minutes. By day
# tests/app/test_rig.py drives the same orders without a browser.
pytestmark = pytest.mark.nightly

SOON = 0.5  # [s] from the act to a drive that is off


def marked(page, name):
    return page.find_element("css selector", f'[data-mark="{name}"]')


def there(page, name):
    return bool(page.find_elements("css selector", f'[data-mark="{name}"]'))


def click(page, name):
    """A click on what may lie below the window's edge, as soon as it can be pressed."""
    until(lambda: marked(page, name).is_enabled(), name)
    until(lambda: page.execute_script("arguments[0].click(); return true", marked(page, name)), name)


def type_in(page, name, text, last="TAB"):
    from selenium.webdriver.common.keys import Keys

    keys = Keys.CONTROL, "a", Keys.NULL, text, getattr(Keys, last)
    until(lambda: [marked(page, name).send_keys(*keys)], name)


def move(page, name):
    """Press a button and confirm what it warns of; again where the page was just drawn anew and no button heard it."""

    def press(button, done):
        if not done():
            page.execute_script("arguments[0].click()", marked(page, button))
            time.sleep(0.5)
        return done()

    until(lambda: press(f"rig-{name}", lambda: there(page, f"rig-yes-{name}")), name)
    until(lambda: press(f"rig-yes-{name}", lambda: not there(page, f"rig-yes-{name}")), name)


def run(page):
    """Begin a run that does not end by itself."""
    move(page, "run")
    text = "no text yet"

    def begun():
        nonlocal text
        text = page.find_element("tag name", "body").text
        return marked(page, "rig-stop").is_displayed() and "playing the input" in text

    try:
        until(begun, "a run", 60.0)
    except AssertionError:
        raise AssertionError(text) from None


def visible(page, name):
    return until(lambda: marked(page, name).is_displayed(), name)


def driven(emulator):
    return emulator.board.state in (wire.ARMED, wire.RUNNING) or any(emulator.plant._queue)


def seconds_until_off(emulator, act, page=None):
    """From the act, or from the moment at which the browser of `page` heard it, to a drive that is off."""
    until(lambda: driven(emulator), "a drive that is on")
    if page:
        page.execute_script(
            "for (const kind of ['keydown', 'click'])"
            " addEventListener(kind, () => { window.heard ??= Date.now() }, true); window.heard = undefined"
        )
    off = []

    def look():
        while driven(emulator):
            time.sleep(0.002)
        off.append(time.time())

    thread = threading.Thread(target=look)
    thread.start()
    began = time.time()
    act()
    thread.join(30.0)
    assert off, "the drive stays on"
    return off[0] - (page.execute_script("return window.heard") / 1000.0 if page else began)


@pytest.fixture(scope="module")
def place(tmp_path_factory):
    return tmp_path_factory.mktemp("rig")


@pytest.fixture(scope="module")
def emulator():
    with pytest.MonkeyPatch.context() as patch, Emulator("shoulder", 3) as made:
        patch.setattr("twin.rig.emulator.REST", 0.1)  # on a busy machine its thread rests for longer than a host waits
        patch.setattr("twin.rig.emulator.PATIENCE", 5.0)  # each drive off that is seen here is one that was asked for
        yield made


@pytest.fixture(scope="module")
def design(place):
    """Ten minutes of slow steps."""
    u = np.repeat(np.tile([7.0, -7.0], 250), 60)
    rows = "".join(f"{0.02 * k:.2f},{level}\n" for k, level in enumerate(u))
    path = place / "steps.csv"
    path.write_text("time [s],u [V]\n" + rows)
    return path


@pytest.fixture(scope="module")
def served(place):
    with app(place / "session") as running:
        yield running


@pytest.fixture(scope="module")
def page(place, served):
    with browser(place) as driver:
        rig_page(driver, served)
        yield driver


def rig_page(page, served):
    page.get(served.address)
    click(page, "page-Rig")


def test_from_the_port_to_the_record(page, emulator, design):
    from selenium.webdriver.common.keys import Keys

    visible(page, "rig-connect")
    type_in(page, "rig-port", "/dev/ttyNOPE", "ENTER")
    click(page, "rig-connect")
    until(lambda: "there is no such port" in page.find_element("tag name", "body").text, "a sentence")
    type_in(page, "rig-port", emulator.port, "ENTER")
    click(page, "rig-connect")
    visible(page, "rig-readings")
    until(lambda: f"joint 0: {emulator.plant.position(0):.0f}"[:-1] in marked(page, "rig-readings").text, "readings")
    assert not marked(page, "rig-stop").is_displayed()
    type_in(page, "rig-joint", "shoulder")
    type_in(page, "rig-channel", "0")
    time.sleep(0.5)
    move(page, "wire")
    visible(page, "rig-stop")
    until(lambda: "joint moves from" in page.find_element("tag name", "body").text, "the wiring in words")
    move(page, "zero")
    for end in ("low", "high"):
        until(lambda end=end: f"at its {end} end" in marked(page, "rig-question").text, "a question")
        counts = emulator.plant.position(0)
        type_in(page, "rig-angle", f"{np.rad2deg(emulator.plant.angle_of(counts)):.3f}")
        time.sleep(0.3)
        click(page, "rig-answer")
    emulator.speed = 1.5
    file = '[data-mark="rig-upload"] input[type=file]'
    until(lambda: [page.find_element("css selector", file).send_keys(str(design))], "the run")
    run(page)
    until(lambda: page.find_elements("css selector", '[data-mark="rig-live"] .main-svg'), "the live figure")
    until(lambda: re.search(r"input, ([4-9]|\d\d)\.", marked(page, "rig-moves").text), "4 s of the run")

    def escape():
        page.find_element("tag name", "body").send_keys(Keys.ESCAPE)

    took = seconds_until_off(emulator, escape, page)
    print(f"Escape to a drive that is off: {took:.3f} s")
    assert took < SOON
    until(lambda: "stopped by hand" in page.find_element("tag name", "body").text, "why it ended")
    assert until(lambda: there(page, "rig-identify"))
    assert "d1" in page.find_element("tag name", "body").text
    click(page, "page-Logs and models")
    until(lambda: page.find_elements("css selector", '[data-mark="signals"] .main-svg'), "the signals of the record")
    click(page, "page-Rig")
    assert not [row for row in page.get_log("browser") if row["level"] == "SEVERE" and "rig" in row["message"]]


def test_the_space_bar_and_the_button_stop_and_a_second_window_cannot_drive(page, served, emulator):
    first = page.current_window_handle
    page.switch_to.new_window("tab")
    rig_page(page, served)
    visible(page, "rig-who")
    second = page.current_window_handle
    page.execute_script("arguments[0].querySelector('.q-item').click()", marked(page, "rig-wiring"))
    visible(page, "rig-joint")
    type_in(page, "rig-joint", "a b")
    assert marked(page, "rig-joint").get_attribute("value") == "a b"  # keys are keys where nothing moves
    page.switch_to.window(first)
    run(page)
    page.switch_to.window(second)
    visible(page, "rig-stop")  # it has the button, and cannot begin anything
    assert not marked(page, "rig-run").is_enabled()
    assert seconds_until_off(emulator, lambda: page.find_element("tag name", "body").send_keys(" "), page) < SOON
    run(page)
    button = marked(page, "rig-stop")
    assert seconds_until_off(emulator, button.click, page) < SOON
    until(lambda: not marked(page, "rig-stop").is_displayed(), "no button where nothing moves")
    run(page)
    assert (
        seconds_until_off(emulator, page.close) < 4 * SOON
    )  # with what closing takes; the first window does not keep the drive on
    page.switch_to.window(first)
    until(lambda: "the page that moved it was closed" in page.find_element("tag name", "body").text, "why it ended")


def test_a_killed_app_is_a_stop_and_its_log_is_there_when_the_session_opens_again(page, served, emulator):
    records = len(list((served.session / "data").glob("d*")))
    run(page)
    assert seconds_until_off(emulator, served.process.kill) < SOON
    until(lambda: list((served.session / "rig").glob("run-*.csv")), "the log")
    served.process.wait()
    desk = Desk(Session.open(served.session))
    assert len(desk.session.data) == records + 1
    desk.close()
