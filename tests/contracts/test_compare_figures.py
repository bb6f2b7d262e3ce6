"""Bars, table and caption of a verdict say the same, and shares are told only where there is a departure to share."""

from types import SimpleNamespace

import numpy as np
import pytest

from twin.compare import verdict as verdicts
from twin.compare.departure import Spectrum
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


def test_without_a_departure_bars_are_the_error_that_is_left():
    found = verdict(SHARES, chance=True)
    axes = compare_figures.effects(found)
    assert axes.get_xlabel() == "RMS of the error that is left [deg]"
    np.testing.assert_allclose(widths(axes), np.degrees([share.rms for share in found.alone]))
    assert axes.lines[0].get_xdata()[0] == pytest.approx(np.degrees(found.rms))
    assert {t.get_text() for t in axes.get_legend().get_texts()} == {"one cause moved", "nothing moved"}
    caption = compare._effect_caption(found)
    assert "%" not in caption
    assert "by more than chance" in caption
    (sentence,) = compare.verdict_sentences(found, "thigh", "log.csv")
    assert "over the first 60 s the error is 0.229 deg RMS with nothing moved" in sentence  # one noise on the page
    assert {row[1] for row in compare.effect_table(found).rows} == {"–"}


def test_the_caption_names_the_longest_bar_too():
    found = verdict(SHARES, chance=False, named=("delay",))
    assert widths(compare_figures.effects(found)) == [100 * share for share in SHARES.values()]
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
        (("load",), Remainder(0.0, white=True, uneven=("low and high voltages",)), "differ between low and high"),
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
