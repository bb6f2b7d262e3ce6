"""The page in a real Chromium: a poor fit that is seen, the step that mends it, several records, a search, undo."""

import re
import time

import numpy as np
import pytest
from app_served import app, browser, click, drop, idle, marked, severe, there, type_in, until, write_process

import sysid
from sysid.base.quantities import percent

pytest.importorskip("nicegui", reason="NiceGUI is in the app extra")

K, T, TD = 0.5, 1.0, 1.0
RED = "rgba(197, 48, 48, 1)"


@pytest.fixture(scope="module")
def place(tmp_path_factory):
    return tmp_path_factory.mktemp("answer")


@pytest.fixture(scope="module")
def served(place):
    with app(place / "session") as running:
        yield running


@pytest.fixture(scope="module")
def page(served, place):
    with browser(place) as driver:
        driver.get(served.address)
        until(lambda: marked(driver, "fit"), "the page")
        for k in (1, 2):
            drop(driver, write_process(place / f"plant{k}.csv", K, T, TD, seed=k))
            until((served.session / "data" / f"d{k}" / "record.npz").exists, "the record")
            idle(driver)
        yield driver


def parameters(served, key):
    fit = sysid.load(served.session / "models" / key / "model.json")
    return dict(zip(fit.model.names, fit.theta, strict=True))


def fitted(page, key):
    until(lambda: there(page, f"model-{key}"), f"model {key}")
    idle(page)
    until(lambda: marked(page, "verdict").text.startswith(f"{key} "), "its first screen")


def choose(page, name, text):
    """Choose an entry of a list, by a click on it as a person would: once more where the list was just drawn anew."""

    def choice():
        if not page.find_elements("css selector", ".q-menu"):
            field = marked(page, name)
            page.execute_script("arguments[0].scrollIntoView({block: 'center'})", field)
            page.execute_script("arguments[0].click()", field)
            time.sleep(0.5)  # the list opens; a second click would close it
        return [e for e in page.find_elements("css selector", ".q-menu .q-item") if text in e.text]

    until(choice, text)[0].click()
    page.find_element("tag name", "body").send_keys("\ue00c")  # Escape closes the list


def only(page, structure, *others):
    for other in others:
        click(page, f"structure-{other}")
        until(lambda other=other: page.execute_script(f"return !document.querySelector('[data-mark^=\"{other}-\"]')"))
    if structure:
        click(page, f"structure-{structure}")
        until(lambda: page.find_elements("css selector", f'[data-mark^="{structure}-"]'))


def test_a_poor_fit_is_seen_and_the_step_that_was_tried_mends_it(page, served):
    only(page, "", "hammerstein_wiener")
    for order in ("nb", "nf", "nk"):
        type_in(page, f"output_error-{order}", "1")
    type_in(page, "starts", "1")
    assert page.execute_script("return window.scrollY") > 200
    click(page, "fit")
    fitted(page, "m1")
    until(lambda: page.execute_script("return window.scrollY") == 0, "the way up to the answer")
    word = marked(page, "word")
    assert word.text == "poor"
    assert word.value_of_css_property("color") == RED
    shape = marked(page, "verdict").find_element("css selector", ".qpal-mark.qpal-poor")
    assert "polygon" in shape.value_of_css_property("clip-path")
    place = page.execute_script("return arguments[0].getBoundingClientRect().toJSON()", word)
    assert place["top"] < 200
    assert place["height"] > 40
    number, promise = re.search(r"([\d.]+ %)\s+poor", marked(page, "verdict").text)[1], marked(page, "step-0").text
    found = re.search(r"Try: process P1D, ([\d.]+ %) instead of ([\d.]+ %)", promise)
    assert found[2] == number
    click(page, "step-0")
    fitted(page, "m2")
    assert marked(page, "word").text == "good"
    assert marked(page, "verdict").text.split("\n")[1] == found[1]
    values = parameters(served, "m2")
    assert [values["plant.K"], values["plant.T1"]] == pytest.approx([K, T], rel=0.02)


def test_a_model_that_was_deleted_comes_back(page):
    assert not marked(page, "model-m1").find_elements("css selector", ".none")
    marked(page, "model-m1").find_elements("css selector", "button")[-1].click()
    until(lambda: not there(page, "model-m1"), "the deletion")
    click(page, "undo")
    until(lambda: there(page, "model-m1"), "the model")


def test_another_record_judges_a_process_of_which_the_delay_is_held(page, served):
    only(page, "process", "output_error")
    choose(page, "validation", "plant1.csv")
    click(page, "hold")
    type_in(page, "held-0", "plant.Td")
    type_in(page, "held-0-value", "1.0")
    click(page, "fit")
    fitted(page, "m3")
    assert "d2, d1" in marked(page, "model-m3").text
    values = parameters(served, "m3")
    assert values["plant.Td"] == 1.0
    assert [values["plant.K"], values["plant.T1"]] == pytest.approx([K, T], rel=0.01)


@pytest.mark.nightly  # a search beside a browser needs minutes on two busy cores; tests/app/test_fits.py has one by day
def test_a_search_finds_a_model_that_leaves_no_more_than_the_noise(page, served):
    choose(page, "validation", "plant1.csv")  # once more: off
    type_in(page, "seconds", "90")
    click(page, "auto")
    fitted(page, "m4")
    assert "chosen by a search" in marked(page, "verdict").text, marked(page, "verdict").text
    record = np.loadtxt(served.session / "data" / "d2" / "log.csv", delimiter=",", skiprows=1)
    best = 100.0 * (1.0 - 0.02 / np.std(record[300:, 2]))
    shown = float(re.search(r"([\d.]+) %", marked(page, "verdict").text)[1])
    assert best - 1.0 < shown < best + 1.0, percent(best)


def test_a_model_predicts_some_samples_ahead(page):
    type_in(page, "horizon", "5")
    click(page, "run")
    until(lambda: re.search(r"m\d on d2", marked(page, "verdict").text), "the run")
    assert "Predicted 5 sample(s) ahead from measured outputs: 9" in page.find_element("tag name", "body").text
    until(lambda: page.find_elements("css selector", '[data-mark="figure-run"] .main-svg'), "its figure")
    assert not severe(page)
