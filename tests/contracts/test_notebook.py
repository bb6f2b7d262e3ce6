"""What results show at a prompt and in a notebook: one screen, no markup from names."""

import re
from dataclasses import replace
from html.parser import HTMLParser

import matplotlib as mpl
import numpy as np
import pytest
import shown

import sysid
from sysid.data.preprocess import detrend
from sysid.notebook import card
from sysid.notebook.page import identified
from sysid.report import identify
from sysid.systems import system
from sysid.workflow.saved import Exports

mpl.use("Agg")
PNG = b"\x89PNG\r\n\x1a\n"


@pytest.fixture(scope="module")
def data():
    return shown.data()


@pytest.fixture(scope="module")
def fit():
    return shown.fit()


@pytest.fixture(scope="module")
def linear():
    return shown.linear()


@pytest.fixture(scope="module")
def network():
    return shown.network()


@pytest.fixture(scope="module")
def joint():
    return shown.joint_fit()


@pytest.fixture(scope="module")
def selection(linear):
    from sysid.selection.table import Row, Selection
    from sysid.structures import OutputError

    rows = tuple(Row(OutputError(1, k, 1), 70.0 - k, 2 + k, 1, np.ones(20), True, equal=k < 3) for k in range(1, 40))
    return Selection(rows, rows[1], linear, ("the budget ended the search",), 12.0)


@pytest.fixture(scope="module")
def things(data, fit, linear, network, joint, selection):
    return {
        "record": data,
        "experiments": sysid.IOData.merge(*(data[k : k + 20] for k in range(0, 400, 20))),
        "channels": sysid.IOData(np.arange(300.0).reshape(10, 30), np.arange(10.0), 0.1),
        "fit": fit,
        "linear": linear,
        "nlarx": network,
        "joint": joint,
        "selection": selection,
        "comparison": sysid.compare(data, fit, linear, network),
        "tests": linear.residual_tests(data),
        "modes": fit.modes(data),
    }


class Reader(HTMLParser):
    """Tags that are open, and the text outside and inside of what is folded away."""

    void = ("br", "img")

    def __init__(self):
        super().__init__()
        self.open, self.shown, self.folded, self.tags = [], [], [], set()

    def handle_starttag(self, tag, attrs):
        self.tags.add(tag)
        if tag not in self.void:
            self.open.append(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, text):
        (self.folded if "details" in self.open and "summary" not in self.open else self.shown).append(text)


def parsed(thing):
    reader = Reader()
    reader.feed(thing._repr_html_())
    assert not reader.open
    return reader


KINDS = (
    "record",
    "experiments",
    "channels",
    "fit",
    "linear",
    "nlarx",
    "joint",
    "selection",
    "comparison",
    "tests",
    "modes",
)


@pytest.mark.parametrize("name", KINDS)
def test_each_result_is_a_line_a_screen_and_a_fragment_of_html(things, name):
    thing = things[name]
    assert "\n" not in repr(thing)
    assert len(repr(thing)) < 200
    assert repr(thing).startswith(f"<{type(thing).__name__}: ")
    lines = str(thing).splitlines()
    assert 2 <= len(lines) <= card.LINES
    assert max(map(len, lines)) <= 125
    html = parsed(thing)
    assert "b" in html.tags
    assert "script" not in html.tags
    rows = thing._repr_html_().partition("<details>")[0].count("<tr>")
    assert rows <= card.LINES
    assert not re.search(r"\b(nan|None|inf)\b", "".join(html.shown) + str(thing))


def test_a_name_is_text_and_no_markup(things):
    assert shown.NAME in str(things["record"])
    html = things["record"]._repr_html_()
    assert shown.NAME not in html
    assert shown.NAME in "".join(parsed(things["record"]).shown)


def test_a_record_shows_ranges_in_what_people_read(data):
    text = str(detrend(data))
    assert "500 every 0.1 s, 50 s in all" in text
    assert re.search(rf"angle +output +deg .* {np.degrees(data.y.mean()):.2f}$", text, flags=re.MULTILINE)
    lost = np.zeros((500, 1), dtype=bool)
    lost[:5] = True
    assert "5 output samples, 1 %" in str(replace(data, missing=lost))
    assert "removed" not in str(data)


def test_a_fit_shows_its_numbers_and_folds_the_parameters_away(data, fit):
    text, html = str(fit), parsed(fit)
    assert text.splitlines()[0] == "Hammerstein-Wiener (nb 2, nf 2, nk 1), input saturation, output piecewise linear"
    spread = np.std(data.y)
    assert f"{100 * (1 - np.sqrt(fit.criteria.mse) / spread):.2f} % on its own record" in text
    assert f"{np.degrees(np.sqrt(fit.criteria.mse)):.3f} deg" in text
    gain = sysid.linear.gain(fit, data=data)
    assert f"{np.degrees(gain.value):.1f} ±" in text
    mode = fit.modes(data)[0]
    assert f"{mode.hertz:.4f}  {mode.hertz_std:.4f}" in text
    assert f"{mode.damping:.4f}" in text
    assert f"{mode.pole.real:.4f} ± {abs(mode.pole.imag):.4f}i" in text
    folded = "".join(html.folded)
    for p in fit.parameters:
        assert p.name in folded
        assert p.name not in "".join(html.shown)
    assert f"{len(fit.theta)} parameters with standard deviations" in "".join(html.shown)


def test_a_fit_of_a_nonlinear_plant_by_a_line_says_that_its_residuals_are_coloured(linear):
    noise = linear.noise_model()
    assert "The residuals are coloured" in str(linear)
    assert f"q^-{noise.order}," in str(linear).replace("\n", " ") or f"q^-{noise.order} " in str(linear)
    said = str(linear).replace("\n", " ")
    assert f"{np.degrees(np.sqrt(noise.variance)):.1f} where e has {np.degrees(np.sqrt(noise.total)):.1f} deg" in said
    assert "try higher orders, or sysid.select(data)" in said


def test_a_poor_fit_begins_with_a_warning_and_the_call_to_try(data, fit, linear):
    assert "Warning" not in str(fit).partition("sampling")[0]
    first = str(linear).partition("sampling")[0]
    assert re.search(r"^Warning: the free run explains only \d\d\.\d\d % of", first, flags=re.MULTILINE)
    assert "Next: sysid.select(data).fit" in first
    assert "Warning: the free run explains only" in "".join(parsed(linear).shown).partition("sampling")[0]
    stopped = replace(fit, stop=replace(fit.stop, converged=False))
    assert "the search did not converge; go on with fit.refine(" in str(stopped).partition("sampling")[0]
    reason = stopped.stop.reason
    stopped = replace(stopped, warnings=(f"the search did not converge: {reason}", "something else"))
    made = identify.page(identified(stopped, data, None), Exports())
    words = " ".join([*made.verdict, *made.sections[-1].paragraphs])  # the words of the search are the last
    assert words.count(reason) == words.count("something else") == 1
    assert f"which did not converge: {reason}" in made.sections[-1].paragraphs[0]
    assert "did not converge" in made.answer.sentence


def test_noise_alone_is_no_reason_for_a_warning():
    rng = np.random.default_rng(3)
    u = rng.normal(size=(400, 1))
    noisy = sysid.IOData(u, np.r_[[[0.0]], u[:-1]] + 2.0 * rng.normal(size=(400, 1)), 0.1)
    found = sysid.fit(sysid.structures.output_error(nb=1, nf=1, nk=1, fixed={"linear.f1": 0.0}), noisy, starts=1)
    assert found.fit_percent(noisy) < 30.0
    assert "explains only" not in str(found)


def test_an_output_that_rests_at_its_ends_leads_to_a_joint():
    u = np.repeat(np.random.default_rng(1).uniform(-1.0, 1.0, 25), 20)
    y = np.empty(500)
    for k in range(500):  # a motor between two stops
        y[k] = np.clip((y[k - 1] if k else 0.0) + 0.1 * u[k], -0.2, 0.5)
    stops = sysid.IOData(u, y, 0.1, y_unit="rad")
    for record, named in ((stops, "actuated_joint(), data)"), (detrend(stops), "retrend(data))")):
        found = sysid.fit(sysid.structures.output_error(nb=1, nf=1, nk=1), record, search="lm", starts=1)
        assert named in str(found).replace("\n", " ").partition("sampling")[0]
    np.testing.assert_allclose(sysid.data.preprocess.retrend(detrend(stops)).y, stops.y)


def test_residual_tests_say_their_verdicts(data, fit, linear):
    for made in (fit, linear):
        tests = made.residual_tests(data)
        for text in (str(tests), tests._repr_html_()):
            assert ("not white" in text) is not tests.white
            assert ("not independent" in text) is not tests.independent
            assert f"{tests.whiteness_outside} of 25" in text
            assert f"{tests.independence_outside} of 51" in text
    white = sysid.residual_tests(*np.random.default_rng(0).normal(size=(2, 500)))
    assert "What the model leaves is noise" in str(white)


def test_modes_are_a_tuple_and_a_table(data, fit):
    found = fit.modes(data)
    assert isinstance(found, tuple)
    assert len(found) == 2
    for text in (str(found), found._repr_html_()):
        assert f"{found[0].hertz:.4f}" in text
        assert f"{found[0].time_constant_std:.2g}"[:4] in text
    assert "0 poles" in repr(type(found)())
    assert "no linear block" in str(type(found)())


def test_what_is_not_determined_has_no_number():
    from sysid.linear.modes import Mode
    from sysid.notebook.poles import determined, pole_table

    wide = Mode(1.0 - 2.6e-9, 7e-3, 2.6e-8, 0.07, 1.0, 0.1, 3.8e7, 1e14)
    sharp = Mode(0.5 + 0j, 0.01, 6.9, 0.2, 1.0, 0.0, 0.144, 0.004)
    assert [determined(m) for m in (wide, sharp)] == [False, True]
    rows = pole_table((wide, sharp)).rows
    assert rows[0][2:4] == rows[0][6:8] == ("not determined", "–")
    assert rows[1][6:8] == ("0.1440", "0.0040")


def test_a_gain_where_the_maps_are_flat_is_not_determined(data, fit, monkeypatch):
    from sysid.linear.modes import Gain
    from sysid.notebook import poles

    for value, std, said in ((0.0, 0.0, "the maps are flat there"), (1.0, 2.0, "larger than the value")):
        found = Gain(value, std, 0.0)
        monkeypatch.setattr(poles, "gain", lambda *_, g=found, **__: g)
        text = poles.gain_fact(fit, data)[1]
        assert text.startswith("not determined at u = 0: ")
        assert said in text


def test_warnings_are_told_and_at_most_three(fit, joint):
    warned = replace(fit, warnings=tuple(f"number {k}" for k in range(5)))
    assert str(warned).count("Warning: number") == 3
    assert str(joint).count("Warning:") == 3


def test_a_fit_knows_its_record_and_its_file_does_not(data, fit, tmp_path):
    assert fit.record is data
    read = sysid.load(fit.save(tmp_path / "fit.json"))
    assert read.record is None
    written = (tmp_path / "fit.json").read_text(encoding="utf-8")
    assert not any(repr(float(v)) in written for v in data.y[::50, 0])  # names and units are kept, samples are not
    np.testing.assert_array_equal(read.theta, fit.theta)
    assert "on its own record" not in str(read)
    assert len(str(read).splitlines()) < card.LINES
    for call in (read.plot, read.noise_model, read.refine, lambda: read.report(tmp_path / "x.html")):
        with pytest.raises(sysid.InputError, match="has no record; give one"):
            call()
    assert read.plot(data).axes
    np.testing.assert_allclose([m.frequency for m in read.modes()], [m.frequency for m in fit.modes()])


def test_a_search_hands_over_a_fit_that_knows_its_record(data):
    space = sysid.selection.space.Space(nb=(1,), nf=(1,), nk=(1,), structures=("output_error",), starts=1, grows=False)
    found = sysid.select(data, space, jobs=1, seconds=30)
    assert found.fit.record is data


def test_refine_goes_on_from_the_fit(data, fit):
    rough = np.array([p.value for p in fit.parameters]) * 0.9
    short = sysid.fit(fit.model, data, search="gradient", start=rough, options=sysid.Options(max_iterations=1))
    longer = short.refine(search="lm")
    assert fit.criteria.fpe <= longer.criteria.fpe * 1.001 < 0.9 * short.criteria.fpe  # the loss has a prior beside it
    assert longer.record is data
    other = short.refine(data[:300], search="lm")
    assert other.criteria.N == 300
    with pytest.raises(sysid.InputError, match="starts from the fit itself"):
        short.refine(starts=3)


def test_a_report_is_one_page_of_this_fit(data, fit, network, tmp_path):
    other = system("textbook").record(300, 0.05, np.random.default_rng(2))
    path = fit.report(tmp_path / "fit.html", validation=other)
    page = path.read_text(encoding="utf-8")
    assert page.startswith("<!")
    assert shown.NAME not in page
    assert f"{fit.fit_percent(other):.2f} %" in page
    assert "no validation record" not in page
    assert "Hammerstein-Wiener (nb 2, nf 2, nk 1)" in page
    assert "no validation record was given" in identified(fit, data, None).evaluation.notes[0]
    top = float(np.quantile(data.y, 0.7))
    stopped = detrend(replace(data, y=np.minimum(data.y, top)))
    (rest,) = (a for a in identified(fit, stopped, None).advice if a.topic == "rest")
    assert f"highest ({np.degrees(top):.4g} deg)" in rest.sentence  # as recorded, though the fit has no mean
    assert "NLARX (na 2" in network.report(tmp_path / "n.html").read_text(encoding="utf-8")
    assert sorted(p.name for p in tmp_path.iterdir()) == ["fit.html", "n.html"]
    with pytest.raises(sysid.InputError, match="does not exist"):
        fit.report(tmp_path / "nowhere" / "fit.html")


def test_a_report_of_a_poor_fit_names_the_call_to_try_and_it_exists(data, fit, linear):
    assert identified(fit, data, None).next is None
    assert identified(linear, data, None).next.command == "sysid.select(data, seconds=120).fit"
    stopped = replace(linear, stop=replace(linear.stop, converged=False))
    command = identified(stopped, data, None).next.command
    assert command == "fit.refine(options=sysid.Options(max_iterations=500))"
    assert eval(command, {"fit": stopped.remember(data), "sysid": sysid}).stop.converged


def test_a_long_card_ends_at_the_edge_of_the_screen():
    long = card.Card("title", [(str(k), "x") for k in range(100)], call="Next: call()")
    lines = long.text().splitlines()
    assert len(lines) <= card.LINES
    assert lines[-2:] == ["...", "Next: call()"]
    table = card.Table(("a", "b"), [(str(k), "1") for k in range(30)])
    assert table.text()[-1] == "  and 18 more"
    assert "and 18 more" in table.html()
    folded = card.Card("t", folded=[card.Table(("a",), [(str(k),) for k in range(30)], "all")]).html()
    assert ">29<" in folded


def test_no_text_of_a_card_is_markup():
    table = card.Table(("<i>", "<i>"), [("<i>", "<i>")], "<i>")
    made = card.Card("<i>", [("<i>", "<i>")], [table], ["<i>"], [table]).html()
    assert "<i>" not in made
    assert made.count("&lt;i&gt;") == 4 + 5 + 5


def test_a_class_without_a_module_is_told():
    from sysid.base.handlers import handler

    class Longer(sysid.IOData):
        pass

    assert handler(Longer(np.arange(5.0), np.arange(5.0))).__name__ == "IODataView"
    with pytest.raises(TypeError, match="no class for int"):
        handler(3)
