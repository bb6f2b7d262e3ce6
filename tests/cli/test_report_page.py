"""The page of a report: its structure, what it says of a bad result, and how it behaves in a browser."""

import html
import json
import re
import shutil
from dataclasses import replace
from html.parser import HTMLParser
from importlib.resources import files
from types import SimpleNamespace

import numpy as np
import pytest

from sysid.base.quantities import capital, probability
from sysid.data.record import IOData
from sysid.diagnosis.advice import Advice
from sysid.drawing.plotly import plotly
from sysid.joint.values import JointValue
from sysid.plots.free_runs import runs_figure
from sysid.plots.records import parts_figure, record_figure
from sysid.report import figures, glossary, identify, identify_answer, page, verdict
from sysid.report.answer import WORDS, Answer
from sysid.report.page import Grid, Page, Picture, Section
from sysid.report.sections import pole_grid
from sysid.structures import HammersteinWiener, NonlinearArx
from sysid.workflow.identification import identify_file
from sysid.workflow.saved import Exports
from sysid.workflow.setting import Setting
from sysid.workflow.steps import NextStep

pytestmark = pytest.mark.pixels

VOID = {"meta", "img", "br", "link", "hr", "input"}
TEMPLATE = files("sysid.report").joinpath("template.html").read_text(encoding="utf-8")
NOTHING = b"\x89PNG"


class Reader(HTMLParser):
    """Every element with its attributes and text; fails for tags that do not close in order."""

    def __init__(self, html):
        super().__init__()
        self.open, self.elements = [], []
        self.feed(html)
        self.close()
        assert self.open == []

    def handle_starttag(self, tag, attrs):
        element = SimpleNamespace(tag=tag, at=dict(attrs), text="", within=[each.tag for each in self.open])
        self.elements.append(element)
        if tag not in VOID:
            self.open.append(element)

    def handle_endtag(self, tag):
        assert self.open.pop().tag == tag

    def handle_data(self, data):
        for element in self.open:
            element.text += data

    def all(self, tag, **at):
        return [e for e in self.elements if e.tag == tag and all(e.at.get(k) == v for k, v in at.items())]


@pytest.fixture(scope="module")
def log(tmp_path_factory):
    """A record of a static map before a lag, with noise."""
    rng = np.random.default_rng(3)
    u = np.repeat(rng.uniform(-2, 2, 100), 5)
    y = np.zeros(500)
    for t in range(1, 500):
        y[t] = 0.85 * y[t - 1] + 0.2 * (u[t - 1] + 0.3 * u[t - 1] ** 2)
    path = tmp_path_factory.mktemp("log") / "lag.csv"
    rows = zip(u.tolist(), (y + 0.01 * rng.standard_normal(500)).tolist(), strict=True)
    path.write_text("voltage_V,angle_rad\n" + "".join(f"{a!r},{b!r}\n" for a, b in rows))
    return path


@pytest.fixture(scope="module")
def result(log):
    return identify_file(log, Setting(HammersteinWiener(1, 1, 1, "polynomial", "unit_gain"), starts=1), Ts=0.1)


@pytest.fixture(scope="module")
def folder(result, tmp_path_factory):
    made = tmp_path_factory.mktemp("page")
    page.write(made, identify.page(result, Exports()), {})
    return made


@pytest.fixture(scope="module")
def read(folder):
    return Reader((folder / "report.html").read_text(encoding="utf-8"))


def test_the_page_is_small_and_loads_the_script_beside_it_alone(read, folder):
    for element in read.elements:
        for name in ("src", "href", "data", "action", "poster", "srcset"):
            target = element.at.get(name)
            if (element.tag, target) != ("script", page.SCRIPT):
                assert target is None or target.startswith(("#", "data:image/png;base64,")), (element.tag, target)
    assert not any("url(" in e.text or "@import" in e.text for e in read.all("style"))
    assert [e.at["src"] for e in read.all("script") if "src" in e.at] == [page.SCRIPT]
    assert "plotly.js v" in (folder / page.SCRIPT).read_text(encoding="utf-8")[:500]
    assert (folder / "report.html").stat().st_size < 1e6


def test_a_page_of_its_own_has_plotly_in_it_once(result):
    read = Reader(identify.page(result, Exports()).html())
    assert not [e for e in read.all("script") if "src" in e.at]
    scripts = [e for e in read.all("script") if e.at.get("type") != "application/json"]
    assert sum("plotly.js v" in e.text[:500] for e in scripts) == 1
    assert sum(len(e.text) > 1e6 for e in scripts) == 1


def test_every_zoomable_figure_has_its_box_its_data_and_its_picture(read, folder):
    figures = read.all("figure")
    boxes = [e.at["id"] for e in read.all("div") if e.at.get("class") == "zoom"]
    assert [e.at["data-for"] for e in read.all("script", type="application/json")] == boxes
    assert {"zoom-answer", "zoom-data", "zoom-free-run", "zoom-pole-zero", "zoom-bode", "zoom-residuals"} <= set(boxes)
    assert len(read.all("img")) == len(figures) == len(list((folder / "figures").iterdir()))
    for e in read.all("script", type="application/json"):
        assert set(json.loads(e.text)) == {"data", "layout"}


def test_a_page_without_zoomable_figures_has_no_script():
    made = Page("t", "s", ["v"], [Section("a", pictures=[Picture("p", NOTHING, "A caption.")])]).html()
    assert "<script" not in made
    assert len(made) < 20_000


def test_the_colours_follow_the_reader_and_paper_stays_white(read):
    (style,) = read.all("style")
    dark = style.text.index("@media screen and (prefers-color-scheme: dark)")
    assert re.search(r"--paper: #1", style.text[dark:])
    printed = style.text[style.text.index("@media print") :]
    assert "figure.drawn img { display: block; }" in printed
    assert "figure.zoomed .zoom { display: none; }" in printed
    assert read.all("meta", name="viewport")
    assert all("div" in e.within for e in read.all("table"))  # each scrolls inside its own box


def test_headings_and_numbers_tell_what_they_mean(read):
    told = {e.text: e.at["title"] for e in read.all("abbr")}
    assert "below 0 % is worse" in glossary.meaning("fit")
    for term in ("95 % interval", "time constant [s]", "fit, free run, validation data", "BIC"):
        assert told[term] == glossary.meaning(term) != ""
    words = [e.text for e in read.all("dt")]
    assert "time constant" in words
    assert len(words) == len(set(words))
    cells = [e.at["title"] for e in read.all("td") if e.at.get("title", "").startswith("pole, time constant [s]: ")]
    assert cells
    assert all(glossary.meaning("time constant") in cell for cell in cells)


def test_a_number_names_its_row_its_column_and_its_unit():
    grid = Grid(("", "value", "95 % interval", "unit"), [("backlash", "0.5", "0.4 to 0.6", "deg")], last_text=True)
    assert grid.title(grid.rows[0], 1).startswith("backlash, value [deg]: gap between")
    assert grid.title(grid.rows[0], 2).startswith("backlash, 95 % interval [deg]: range that holds")
    assert grid.title(grid.rows[0], 3) == grid.title(grid.rows[0], 0) == ""


def test_every_term_of_the_glossary_is_found_and_is_a_phrase():
    for term, said in glossary.TERMS.items():
        assert glossary.meaning(f"{term.capitalize()} [deg]") == said, term
        assert len(said.split()) >= 3, term
        assert not said.endswith("."), term


@pytest.fixture
def plain(monkeypatch):
    """Pages without pictures, for what they say."""
    monkeypatch.setattr(identify.figures, "pictures", lambda section, evaluation: [])


def bad(result, validation_fit, following=None, **changes):
    e = replace(result.evaluation, validation_fit=validation_fit, **changes)
    return replace(result, evaluation=e, next=following)


def coloured(result):
    return replace(result.evaluation.tests, autocorrelation=np.ones(26), independence_p=1.0)


def test_a_bad_result_says_so_first_with_the_reason_and_the_next_command(result, plain):
    step = NextStep("this model has no end stops", "qpal identify a.csv --structure actuated_joint")
    made = identify.page(bad(result, -212.0, step, tests=coloured(result)), Exports())
    first = made.answer
    assert (first.number, first.word) == ("−212.00 %", "poor")
    assert first.picture.caption.endswith(
        "What to see: where the two part: there the model lacks what moves the output."
    )
    assert first.of == "of the validation data explained by the model's free run"
    assert first.sentence == "Do not use this model: this model has no end stops."
    assert first.next == "Next: qpal identify a.csv --structure actuated_joint"
    assert not any("actuated_joint" in sentence for sentence in made.verdict)  # said once
    code = next(e for e in Reader(made.html()).all("code"))
    assert code.text == "qpal identify a.csv --structure actuated_joint"


def test_a_bad_result_without_a_next_step_still_says_what_to_do(result):
    advice = (Advice("excitation", "the input has 2 levels", 2.0, "use more levels", "warning"),)
    some = replace(bad(result, -20.0, tests=coloured(result)), advice=advice)
    assert first_of(some).sentence.endswith("its free run misses the validation data, worse than its constant mean.")
    assert first_of(some).next == f"Next: use more levels; then qpal info {result.record.path}"
    none = replace(bad(result, 20.0, tests=coloured(result)), advice=())
    assert first_of(none).next.startswith("Next: record again with an input that shows more of the system")


def first_of(result):
    """The first screen without its picture."""
    return identify.page(result, Exports()).answer


def test_a_good_result_says_that_noise_is_left_and_how_to_go_on(result):
    first = identify.page(result, Exports(), "m.json").answer
    assert first.word == "good"
    assert float(first.number.removesuffix(" %")) > 90
    assert first.sentence == "The input's effect is captured; what is left is noise."
    assert first.next == "Next, on another record: qpal run m.json FILE"


def test_the_word_is_that_of_the_rules(result, plain):
    """Good: unseen data, nothing to try; usable: a step is left, or noise limits the fit, or no data were left."""
    white = replace(result.evaluation.tests, autocorrelation=np.eye(26)[0], independence_p=0.5)
    step = NextStep("the search did not converge", "qpal identify a.csv --starts 20")
    wrong = bad(result, 99.0, notes=("the free run has the WRONG SIGN: y falls",))
    words = [
        (bad(result, 99.0, tests=white), "good"),
        (bad(result, 99.0, step, tests=white), "usable"),
        (bad(result, 40.0, tests=white), "usable"),
        (bad(result, 0.0, tests=white), "poor"),  # explains nothing
        (bad(result, 99.0, unseen=False), "usable"),
        (bad(result, 70.0, tests=coloured(result)), "poor"),
        (wrong, "poor"),
    ]
    assert [identify_answer.word(each) for each, _ in words] == [word for _, word in words]
    assert identify_answer.sentence(wrong).startswith("Do not use this model: the free run has the WRONG SIGN")


def test_the_first_screen_has_few_words_one_picture_and_at_most_five_values(read, result):
    """What folds stands below; the words of the search are the last."""
    picture = read.elements.index(next(e for e in read.all("figure")))
    texts = ["h1", "p"]
    above = [e.text for e in read.elements[:picture] if e.tag in texts and "main" in e.within]
    assert len(" ".join(above).split()) <= WORDS
    (mark,) = read.all("span", **{"class": "mark"})
    assert mark.at["class"] == "mark"
    assert read.all("div", **{"class": "answer good"})
    table = read.all("table")[0]
    assert len([e for e in read.elements if e.tag == "tr" and e.text in table.text]) >= 1
    assert 1 <= len(result_rows(result)) <= 5
    folds = [e.text for e in read.all("h2")]
    assert folds[0] == "In words"
    assert folds[-1] == "Search"
    assert all("details" in e.within for e in read.all("h2"))
    assert read.all("nav") == []


def result_rows(result):
    (table,) = first_of(result).tables
    return table.rows


def half_width(text):
    low, high = (float(part) for part in text.split(" to "))
    return 0.5 * (high - low)


def test_intervals_are_read_as_wide_as_they_are(result):
    """On the first screen and in the table of poles, to one digit of the half width."""
    (root,) = result.evaluation.roots
    slowest, size = (0.5 * (x.upper - x.lower) for x in (root.time_constant, root.modulus))
    rows = {row[0]: row[1:] for row in result_rows(result)}
    assert half_width(rows["time constant"][1]) == pytest.approx(slowest, rel=0.11)
    _, _, modulus, of_modulus, _, of_time = pole_grid(result.evaluation).rows[0]
    assert half_width(of_modulus) == pytest.approx(size, rel=0.11)
    assert half_width(of_time) == pytest.approx(slowest, rel=0.11)
    assert len(modulus) == len(of_modulus.split(" to ")[0])


def test_the_values_of_the_first_screen_are_those_of_the_record(result):
    """The lag of 0.85 at 0.1 s, and the gain of its map at the mean input, both with their intervals."""
    rows = {row[0]: row[1:] for row in result_rows(result)}
    value, interval, unit = rows["time constant"]
    low, high = (float(text) for text in interval.split(" to "))
    assert unit == "s"
    assert low <= -0.1 / np.log(0.85) <= high
    assert low <= float(value) <= high
    gain = next(row for name, row in rows.items() if name.startswith("gain at voltage = "))
    assert gain[2] == "deg/V"
    mean = float(np.mean(result.evaluation.estimation.u + result.evaluation.estimation.u_offset))
    assert np.isclose(float(gain[0]), np.degrees(0.2 / 0.15 * (1.0 + 0.6 * mean)), rtol=0.1)


def test_a_poor_fit_that_noise_alone_limits_is_not_called_bad(result):
    tests = replace(result.evaluation.tests, autocorrelation=np.eye(26)[0], independence_p=0.5)
    assert not verdict.bad(replace(result.evaluation, validation_fit=40.0, tests=tests))
    assert verdict.bad(replace(result.evaluation, validation_fit=40.0, tests=coloured(result)))
    assert verdict.bad(replace(result.evaluation, validation_fit=-np.inf, tests=None))


def test_a_run_that_leaves_the_data_is_told_with_time_and_size(result):
    e = result.evaluation
    run = e.validation_output.copy()
    run[100:] += np.geomspace(1.0, 1e31, len(run) - 100)
    worse = bad(result, -np.inf, validation_output=run, tests=coloured(result))
    said = verdict.first(worse)[0]
    assert re.search(r"leaves the data 1\d(\.\d)? s after the start and reaches 5\.7e32 deg", said)
    figure = figures.TABLE["free-run"].picture("free-run", worse.evaluation)
    assert "reaches 5.7e32 deg" in figure.sentence


def test_intervals_that_are_known_to_be_too_narrow_say_so_where_they_stand(result, plain):
    e = result.evaluation
    assert verdict.too_narrow(replace(e, tests=replace(e.tests, independence_p=0.5))) == ""
    apart = bad(result, 70.0, estimation_fit=99.0)
    said = verdict.too_narrow(apart.evaluation)
    assert "falls from 99.00 % on the estimation data to 70.00 %" in said
    dependent = replace(e, tests=replace(e.tests, independence_p=1e-6))
    assert "the residuals depend on the input" in verdict.too_narrow(dependent)
    html = identify.page(apart, Exports()).html()
    table = html.index("Poles and zeros of the linear block")
    assert table < html.index('<p class="note">Too narrow:') < html.index("<table", table)
    joint = replace(e, roots=None, values=(JointValue("end_low", 1.0, 0.9, 1.1, "rad"),), estimation_fit=99.0)
    assert verdict.too_narrow(replace(joint, validation_fit=95.0))  # two parts of one joint agree better than that
    assert not verdict.too_narrow(replace(joint, values=(), validation_fit=95.0))  # no interval, nothing to narrow


def test_deviations_of_parameters_under_coloured_residuals_are_called_too_small(result, plain):
    made = identify.page(bad(result, 99.0, tests=coloured(result)), Exports()).html()
    assert "Too small: these standard deviations take the residuals as white" in made
    white = replace(result.evaluation.tests, autocorrelation=np.eye(26)[0], independence_p=0.5)
    made = identify.page(bad(result, 99.0, tests=white), Exports()).html()
    assert "Too small" not in made


@pytest.mark.nightly
def test_a_page_of_a_million_samples_stays_below_10_mb(tmp_path):
    n = 1_000_000
    rng = np.random.default_rng(0)
    data = IOData(rng.normal(size=n), rng.normal(size=n), 1e-3)
    pictures = [
        Picture(str(k), NOTHING, "A caption.", figure)
        for k, figure in enumerate(
            map(plotly, (record_figure(data), runs_figure(data, {"a": data.y, "b": data.y}), parts_figure(data, data)))
        )
    ]
    page.write(tmp_path, Page("t", "s", ["v"], [Section("a", pictures=pictures)]), {})
    assert (tmp_path / "report.html").stat().st_size < 10e6


@pytest.fixture(scope="module")
def browser():
    """Chromium by its driver."""
    webdriver = pytest.importorskip("selenium.webdriver", reason="selenium is in the test extra")
    found = {name: shutil.which(name) for name in ("chromium", "chromedriver")}
    if not all(found.values()):
        pytest.skip("no chromium with its chromedriver on this machine (Debian: apt-get install chromium-driver)")
    options = webdriver.ChromeOptions()
    options.binary_location = found["chromium"]
    options.set_capability("goog:loggingPrefs", {"browser": "ALL"})
    for flag in ("headless=new", "no-sandbox", "disable-gpu", "disable-background-networking", "disable-sync"):
        options.add_argument(f"--{flag}")
    for flag in ("enable-unsafe-swiftshader", "no-first-run", "disable-component-update", "disable-dev-shm-usage"):
        options.add_argument(f"--{flag}")
    driver = webdriver.Chrome(options=options, service=webdriver.ChromeService(found["chromedriver"]))
    driver.set_script_timeout(20)
    yield driver
    driver.quit()


DRAWN = """
const done = arguments[arguments.length - 1];
document.querySelectorAll(".fold").forEach((part) => { part.open = true; });
document.querySelectorAll("figure.zoomed").forEach((f) => f.scrollIntoView());
const wait = () => document.querySelectorAll(".zoom.drawn").length === document.querySelectorAll(".zoom").length
  ? done(true) : setTimeout(wait, 50);
const boxes = [...document.querySelectorAll(".zoom")];
(async () => { for (const b of boxes) { b.scrollIntoView(); await new Promise((r) => setTimeout(r, 60)); } wait(); })();
"""


def opened(browser, folder, width, dark=False):
    size = {"width": width, "height": 900, "deviceScaleFactor": 1, "mobile": width < 600}
    browser.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", size)
    scheme = [{"name": "prefers-color-scheme", "value": "dark" if dark else "light"}]
    browser.execute_cdp_cmd("Emulation.setEmulatedMedia", {"media": "", "features": scheme})
    browser.get((folder / "report.html").as_uri())
    assert browser.execute_async_script(DRAWN)
    wrong = [entry for entry in browser.get_log("browser") if entry["level"] in ("SEVERE", "ERROR")]
    assert wrong == []


def test_in_chromium_figures_are_drawn_nothing_is_loaded_and_the_legend_hides_a_model(browser, folder):
    opened(browser, folder, 1280)
    loaded = browser.execute_script("return performance.getEntriesByType('resource').map((e) => e.name)")
    assert set(loaded) <= {(folder / page.SCRIPT).as_uri()}
    shown = "return [...document.querySelectorAll('figure img')].filter((i) => i.offsetParent).length"
    assert browser.execute_script(shown) == 0  # the pictures are for paper
    lines = "return document.querySelectorAll('#zoom-free-run .scatterlayer .trace').length"
    before = browser.execute_script(lines)
    click = """
      const done = arguments[0], box = document.getElementById("zoom-free-run");
      box.once("plotly_restyle", () => setTimeout(() => done(box.data.map((t) => [t.name, t.visible])), 100));
      const item = [...box.querySelectorAll(".legend .traces")].find((g) => g.textContent.includes("free run"));
      const toggle = item.querySelector(".legendtoggle");
      for (const kind of ["mousedown", "mouseup"]) toggle.dispatchEvent(new MouseEvent(kind, { bubbles: true }));
    """
    visible = browser.execute_async_script(click)
    assert {state for name, state in visible if name.startswith("free run")} == {"legendonly"}
    assert "legendonly" not in {state for name, state in visible if not name.startswith("free run")}
    assert browser.execute_script(lines) == before - 2  # in the output's and in the error's panel


def test_in_chromium_a_folder_may_move_and_a_page_alone_shows_its_pictures(browser, folder, tmp_path):
    moved = tmp_path / "elsewhere"
    shutil.copytree(folder, moved)
    opened(browser, moved, 1280)
    assert browser.execute_script("return document.querySelectorAll('.zoom .main-svg').length") > 0
    (moved / page.SCRIPT).unlink()
    browser.get((moved / "report.html").as_uri())
    figures = browser.execute_script("return document.querySelectorAll('figure').length")
    shown = "return [...document.querySelectorAll('figure img')].filter((i) => i.offsetParent).length"
    assert browser.execute_script(shown) == figures > 0
    browser.get_log("browser")  # it says that the script is missing


@pytest.mark.nightly
def test_in_chromium_a_phone_scrolls_tables_and_never_the_page(browser, folder):
    opened(browser, folder, 390)
    assert browser.execute_script("return innerWidth") == 390
    assert browser.execute_script("return document.documentElement.scrollWidth") <= 390
    right = "[...document.querySelectorAll('.zoom, img, p')].map((e) => e.getBoundingClientRect().right)"
    assert browser.execute_script(f"return Math.max(...{right})") <= 390
    tables = "return [...document.querySelectorAll('.scroll')].some((e) => e.scrollWidth > e.clientWidth)"
    assert browser.execute_script(tables)


@pytest.mark.nightly
def test_in_chromium_the_values_of_the_first_screen_fit_a_phone_with_their_units(browser, tmp_path):
    friction = ("moving friction down, with load", "−0.599", "wider than −0.628 to −0.569", "V")
    rows = [friction, ("gain", "4", "3 to 5", "duty/rad")]
    values = Grid(("", "value", "95 % interval", "unit"), rows, last_text=True)
    page.write(tmp_path, Page("t", "s", ["v"], answer=Answer("1 %", "of", "good", "s", values=values)), {})
    opened(browser, tmp_path, 390)
    assert browser.execute_script("return document.querySelector('.scroll').scrollWidth") <= 390 - 32


def test_a_phone_gives_the_values_of_the_first_screen_no_least_width():
    assert ".first table { min-width: 0;" in TEMPLATE


@pytest.mark.nightly
def test_in_chromium_dark_is_dark_and_print_has_pictures_on_white(browser, folder):
    opened(browser, folder, 1000, dark=True)
    colour = "return getComputedStyle(document.querySelector('{}')).{}"
    paper = [int(v) for v in re.findall(r"\d+", browser.execute_script(colour.format("main", "backgroundColor")))]
    assert max(paper[:3]) < 60
    tick = browser.execute_script(colour.format("#zoom-free-run .xtick text", "fill"))
    assert min(int(v) for v in re.findall(r"\d+", tick)[:3]) > 150  # light letters in the figure
    browser.execute_cdp_cmd("Emulation.setEmulatedMedia", {"media": "print"})
    assert browser.execute_script(colour.format("body", "backgroundColor")) == "rgb(255, 255, 255)"
    assert browser.execute_script(colour.format("figure.zoomed .zoom", "display")) == "none"
    assert browser.execute_script(colour.format("figure.zoomed img", "display")) == "block"


def test_a_model_without_poles_makes_a_whole_page(log, tmp_path):
    result = identify_file(log, Setting(NonlinearArx(1, 1, 1), starts=1), Ts=0.1)
    page.write(tmp_path, identify.page(result, Exports()), {})
    read = Reader((tmp_path / "report.html").read_text(encoding="utf-8"))
    boxes = {e.at["id"] for e in read.all("div") if e.at.get("class") == "zoom"}
    assert {"zoom-data", "zoom-free-run", "zoom-residuals"} <= boxes


def test_commands_are_code_and_minus_signs_are_true_outside_of_them():
    said = "From -1.5 to 2-3: qpal run A --limit -2, or qpal design FILE (qpal models A B). Next: qpal info 'a.csv'."
    shown = str(page._commands(said)).replace("<span>", "").replace("</span>", "").replace("&#39;", "'")
    assert shown == (
        "From −1.5 to 2-3: <code>qpal run A --limit -2</code>, or <code>qpal design FILE</code> "
        "(<code>qpal models A B</code>). Next: <code>qpal info 'a.csv'</code>."
    )


@pytest.mark.parametrize(
    "command",
    [
        "qpal identify tank1.csv --input 'Pump (%),Valve (%)' --output 'Level (cm)'",
        "qpal run 'my  model.json' 'a; then b.csv' --ts 0.1",
        "qpal info 'it'\"'\"'s a log.csv'",
    ],
)
def test_a_quoted_word_of_a_command_is_code_with_all_its_blanks(command):
    shown = str(page._commands(f"Next: {command}, or 'qpal info A' and 'qpal info B'."))
    first, *others = re.findall("<code>(.*?)</code>", shown)
    assert html.unescape(re.sub("<.*?>", "", first)) == command
    assert len(others) == 2
    assert "code span.quoted { display: inline; white-space: pre-wrap; }" in TEMPLATE


def test_a_capital_letter_makes_no_other_symbol_and_a_small_chance_has_no_digits():
    told = [capital(text) for text in ("e with e u", "u1, u2 are the columns", "a pole is real", "Ts is 1", "angle")]
    assert told == ["e with e u", "u1, u2 are the columns", "A pole is real", "Ts is 1", "Angle"]
    assert [probability(p) for p in (0.0123, 4.9e-301)] == ["p = 0.012", "p < 0.0001"]
