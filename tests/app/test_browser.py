"""The page in a real Chromium: load a log, choose a range, fit two structures, take the script away, cancel a fit."""

import subprocess
import sys
import time
from pathlib import Path

import pytest
from app_served import (
    PATIENCE,
    app,
    browser,
    click,
    drop,
    idle,
    marked,
    severe,
    there,
    type_in,
    until,
    write_log,
)

pytest.importorskip("nicegui", reason="NiceGUI is in the app extra")


def shown(page):
    return until(lambda: page.find_elements("css selector", '[data-mark="signals"] .main-svg'), "signals")


@pytest.fixture(scope="module")
def place(tmp_path_factory):
    return tmp_path_factory.mktemp("browser")


@pytest.fixture(scope="module")
def served(place):
    with app(place / "session") as running:
        yield running


@pytest.fixture(scope="module")
def page(served, place):
    with browser(place) as driver:
        driver.get(served.address)
        until(lambda: marked(driver, "fit"), "the page")
        yield driver


def test_from_a_log_to_the_script_that_does_the_same(page, place, served):
    from selenium.webdriver.common.action_chains import ActionChains

    assert "token" not in page.current_url
    drop(page, write_log(place / "thigh.csv"))
    shown(page)
    idle(page)

    area = marked(page, "signals").find_element("css selector", ".nsewdrag")
    chain = ActionChains(page).move_to_element_with_offset(area, -200, 0).click_and_hold()
    chain.move_by_offset(250, 4).move_by_offset(250, 4).release().perform()
    until(lambda: marked(page, "start").get_attribute("value") not in ("", None), "the range")
    start, stop = (float(marked(page, name).get_attribute("value")) for name in ("start", "stop"))
    assert 0.0 < start < stop < 19.95
    idle(page)

    click(page, "structure-hammerstein_wiener")
    until(lambda: not there(page, "hammerstein_wiener-nb"))
    click(page, "structure-hammerstein")
    for structure in ("hammerstein", "output_error"):
        for order in ("nb", "nf", "nk"):
            type_in(page, f"{structure}-{order}", "1")
    type_in(page, "starts", "1")
    click(page, "fit")
    until(lambda: there(page, "model-m1") and there(page, "model-m2"), "two models on the board")
    board = marked(page, "board").text
    assert "hammerstein (1,1,1)" in board
    assert "output error (1,1,1)" in board
    until(lambda: page.find_elements("css selector", '[data-mark="overlay"] .main-svg'), "the overlay")
    until(lambda: page.find_elements("css selector", '[data-mark="figure-free-run"] .main-svg'), "the free run")
    for tab in ("residuals", "pole-zero", "bode"):
        click(page, f"tab-{tab}")
        until(lambda tab=tab: page.find_elements("css selector", f'[data-mark="figure-{tab}"] .main-svg'), tab)

    click(page, "file-script.py")
    until(lambda: list(place.glob("m*-script.py")), "the script")
    (script,) = place.glob("m*-script.py")
    done = subprocess.run([sys.executable, script.name], cwd=place, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    fits = [float(line.split()[-2]) for line in done.stdout.splitlines()[:2]]
    key = script.name.partition("-")[0]
    row = marked(page, f"model-{key}").text
    assert all(f"{fit:.1f}" in row for fit in fits), (row, fits)
    assert f"Preparation(start={start!r}, stop={stop!r}, " in script.read_text()
    assert not severe(page)


def test_a_fit_is_cancelled_and_nothing_of_it_is_left(page, served):
    idle(page)
    click(page, "structure-output_error")
    until(lambda: not there(page, "output_error-nb"))
    type_in(page, "hammerstein-nf", "6")
    type_in(page, "starts", "1000")
    click(page, "fit")
    until(lambda: there(page, "cancel"), "a job")
    workers = children(served.process.pid)
    assert workers
    click(page, "cancel")
    until(lambda: not there(page, "cancel"), "the end of the job")
    until(lambda: not children(served.process.pid), "the end of its process")
    assert not there(page, "model-m3")
    assert "cancelled" in marked(page, "job").text


def children(pid):
    """Processes of the app that live."""
    found = []
    for folder in Path("/proc").glob("[0-9]*"):
        try:
            state, parent = (folder / "stat").read_text().rpartition(") ")[2].split()[:2]
        except OSError:
            continue
        if int(parent) == pid and state != "Z":
            found.append(int(folder.name))
    return found


def test_a_message_says_what_is_wrong(page, place):
    bad = place / "bad.csv"
    bad.write_text("a,b,c\n" + "1,2,3\n" * 50)
    drop(page, bad)
    until(lambda: "bad.csv" in page.find_element("tag name", "body").text, "the record")
    until(lambda: page.find_elements("css selector", ".text-negative"), "why it cannot be read")
    idle(page)


@pytest.mark.nightly
def test_a_million_samples_are_drawn_and_the_page_answers_meanwhile(page, place):
    """Measured: seconds until the signals stand, and the longest that a tick of a box took meanwhile."""
    log = write_log(place / "million.csv", N=1_000_000, Ts=0.01)
    drop(page, log)
    began, longest, answers = time.monotonic(), 0.0, 0
    while "1,000,000 samples" not in page.find_element("tag name", "body").text:
        asked = time.monotonic()
        click(page, "structure-wiener")
        answers += 1
        until(lambda odd=answers % 2: there(page, "wiener-nb") == bool(odd), "an answer")
        longest = max(longest, time.monotonic() - asked)
        assert time.monotonic() - began < 2 * PATIENCE, "never drawn"
    print(f"1e6 samples: drawn after {time.monotonic() - began:.1f} s, the longest answer took {longest:.2f} s")
    shown(page)
    points = page.execute_script(
        "return document.querySelector('[data-mark=\"signals\"]').data.map(t => t._length || t.x.length || 0)"
    )
    assert max(points) < 10_000
    assert answers >= 2  # however slow the machine is: a page that waits for the log answers once
