"""Bars, table and caption of a verdict say the same, and shares are told only where there is a departure to share."""

from types import SimpleNamespace

import numpy as np
import pytest

from sysid.diagnosis.residuals import residual_tests
from sysid.plots.residual_tests import residuals_figure
from twin.compare import verdict as verdicts
from twin.compare.comparison import Comparison
from twin.compare.departure import NAMES, Spectrum, by_regime
from twin.compare.remainder import Remainder
from twin.compare.verdict import Share, Verdict
from twin.report import compare, compare_figures

NONE = Remainder(0.0, white=True, uneven=())
SHARES = {"delay": 0.15, "backlash": 0.01, "end_stop": 1.0, "friction": 0.68}


def verdict(shares, chance, named=(), left=NONE):
    """Effects in the order of BIC, of which the later ones move more values."""
    rms, noise = 0.0040, 0.0030
    leaves = {name: np.sqrt(rms**2 - share * (rms**2 - noise**2)) for name, share in shares.items()}
    alone = tuple(Share(name, share, leaves[name]) for name, share in shares.items())
    own = tuple(share for share in alone if share.effect in named)
    return Verdict(rms, noise, alone, own, (), chance, 60.0, 100, {}, left)


def widths(axes):
    return [bar.get_width() for bar in axes.patches]


def comparison(found, error, spectra=None, unseen=()):
    """A comparison of the thigh with this verdict and error."""
    u, y, none = np.ones(len(error)), np.zeros(len(error)), dict.fromkeys(NAMES, np.zeros(len(error), bool))
    tests = residual_tests(error, u)
    regimes = by_regime(error, none)
    alike = ("thigh", u, y + error, y, 0.05, 0, 1e-3, none, regimes, spectra, tests, ())
    return Comparison("twin", "the twin", *alike, verdict=found, unseen=unseen)


def test_without_a_departure_one_sentence_stands_for_bars_that_are_alike():
    found = verdict(SHARES, chance=True)
    result = comparison(found, 1e-3 * np.random.default_rng(0).standard_normal(200))
    sections = {section.title: section for section in compare.page(result, "log.csv").sections}
    assert not sections["Physical effects"].pictures
    assert not sections["Physical effects"].tables
    assert "the best one, end stops, leaves 0.172 deg" in sections["Physical effects"].paragraphs[1]
    (sentence,) = compare.verdict_sentences(found, "thigh", "log.csv")
    assert "over the first 60 s the error is 0.229 deg RMS with nothing moved" in sentence  # one noise on the page


def test_a_constant_input_shows_no_frequency_response_and_no_correlation_with_it():
    result = comparison(verdict(SHARES, chance=True), 1e-3 * np.random.default_rng(0).standard_normal(200))
    sections = {section.title: section for section in compare.page(result, "log.csv").sections}
    assert not sections["Frequency response"].pictures
    assert "its input is constant" in sections["Frequency response"].paragraphs[0]
    assert len(residuals_figure(result.tests).panels) == 1


def test_no_departure_says_what_the_log_does_not_show():
    found = verdict(SHARES, chance=True)
    result = comparison(found, np.zeros(200), unseen=("the lower end (26 deg away)", "downward motion"))
    last = compare.sentences(result, "log.csv")[-1]
    assert (
        last == "The log does not show the lower end (26 deg away) and downward motion, and tells nothing about that."
    )


def test_one_reading_far_off_is_said_with_its_time_and_what_to_do():
    error = 1e-3 * np.random.default_rng(0).standard_normal(400)
    error[300] += np.radians(30.0)
    structured = verdict(SHARES, True, left=Remainder(0.02, white=False, uneven=()))
    _, outlier, following = compare.sentences(comparison(structured, error), "log.csv")
    assert outlier.startswith("One sample, at 15 s, is 30")
    assert following.startswith("Next: put the mean of both neighbours in place of it in the log, and compare again: ")
    assert following.endswith(f": qpal compare log.csv --joint {comparison(structured, error).joint}")


def test_the_caption_names_the_longest_bar_too():
    found = verdict(SHARES, chance=False, named=("delay",))
    telling = {name: share for name, share in SHARES.items() if name != "backlash"}  # 1 % is no bar
    assert widths(compare_figures.effects(found)) == [100 * share for share in telling.values()]
    grid = compare.effect_table(found)
    assert len(grid.rows) == len(telling)
    assert grid.note == "Moved alone, these explain less than 3 %: backlash."
    caption = compare._effect_caption(found)
    assert "The best alone is delay, 15 %; end stops, 100 %, stands behind it because it moves more values" in caption


def test_one_bar_that_is_best_and_longest_is_named_once():
    caption = compare._effect_caption(verdict({"load": 0.97, "friction": 0.9}, False, ("load",)))
    assert caption.endswith("The best alone is load, 97 %.")


@pytest.mark.parametrize(
    ("named", "left", "says"),
    [
        ((), Remainder(0.002, white=False, uneven=()), "No cause lowers the error by more than chance and 0.05 deg,"),
        (("load",), Remainder(0.002, white=False, uneven=()), "came nearest (97 %), but 0.115 deg RMS is left"),
        (("load",), Remainder(0.0, white=True, uneven=("low and high voltages",)), "low voltages ask for other values"),
    ],
)
def test_a_cause_that_leaves_something_is_not_named(named, left, says):
    found = verdict({"load": 0.97, "friction": 0.9}, not named, named, left)
    assert found.first is None
    texts = compare.verdict_sentences(found, "thigh", "log.csv")
    assert texts[0].startswith("The leg does something that the twin does not have")
    assert says in texts[1]
    assert texts[-1].startswith("Next: play on the leg")
    assert "qpal simulate --joint thigh" in texts[-1]
    assert "--log input.csv" in texts[-1]  # a file to play
    assert "calibrate" not in " ".join(texts)  # which would move values that are right


@pytest.mark.parametrize(("known", "last"), [(".####.#...", 5.0), ("##########", 10.0), ("..........", 10.0)])
def test_responses_end_before_the_first_unknown_frequency(known, last):
    frequency = np.arange(1.0, 11.0)
    radius = np.where([mark == "#" for mark in known], 0.5, 2.0)
    noisy = Spectrum(frequency, np.exp(-2j * frequency), radius, "test")
    sure = Spectrum(frequency, np.exp(-0.1j * frequency), 0.1 + 0 * frequency, "test")
    figure = compare_figures.spectra_figure(SimpleNamespace(spectra=(noisy, sure), kind="twin", label="twin"))
    assert {item.x[-1] for panel in figure.panels for item in panel.items} == {last}


def test_an_effect_that_makes_nothing_better_leaves_what_nothing_moved_leaves(monkeypatch):
    def searched(trials, searches, y):
        for search, cost in zip(searches, (0.25, 0.36, 0.2499), strict=True):
            search.cost = cost

    monkeypatch.setattr(verdicts, "fit_all", searched)
    monkeypatch.setattr(verdicts, "restart", lambda *_: None)
    monkeypatch.setattr(verdicts, "remainder", lambda *_: NONE)
    log, y = SimpleNamespace(N=100, Ts=0.1), np.random.default_rng(0).normal(size=100)
    follower = SimpleNamespace(joint="thigh", y=y, log=log)
    found = verdicts.explain(SimpleNamespace(follower=follower, simulated=0), effects=("friction", "delay"))
    assert found.chance
    assert {share.effect: share.rms for share in found.alone} == {"friction": 0.5, "delay": np.sqrt(0.2499)}
