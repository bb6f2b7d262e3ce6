"""One rule of good, usable and poor: every verb that has a fit gives the same word for the same fit and errors."""

from types import SimpleNamespace

import numpy as np
import pytest

from sysid.diagnosis.worth import left_by_run, worth
from sysid.report import frequency, identify_answer, saved_models_answer
from twin.compare.comparison import MODEL
from twin.report import calibrate_answer, compare_answer, mjcf

NOISE = SimpleNamespace(white=True, independent=True)
MEMORY = SimpleNamespace(white=False, independent=True)
INPUT = SimpleNamespace(white=False, independent=False)
CASES = [
    (95.0, NOISE, "good"),
    (95.0, MEMORY, "good"),
    (95.0, INPUT, "usable"),
    (99.7, INPUT, "good"),  # all that is left is within the half point that counts as nothing
    (70.0, NOISE, "usable"),  # noise limits the fit
    (70.0, MEMORY, "poor"),
    (70.0, None, "poor"),
    (90.0, None, "good"),
    (-3.0, NOISE, "poor"),
]


def identified(percent, tests):
    e = SimpleNamespace(judged_fit=percent, tests=tests, notes=(), growing=None, unseen=True, joint=None)
    return identify_answer.word(SimpleNamespace(evaluation=e, next=None, advice=()))


def run(percent, tests):
    fit = SimpleNamespace(estimation=percent, fit=SimpleNamespace(warnings=()))
    return saved_models_answer.word(SimpleNamespace(percent=percent, tests=tests, model=fit, next=None, growth=None))


def compared(percent, tests):
    made = SimpleNamespace(kind=MODEL, verdict=None, fit=percent, tests=tests, outliers=(), alignment=None)
    return compare_answer.word(made)


def calibrated(percent, tests):
    score = SimpleNamespace(log="a", held_out=True, fit_before=percent - 1.0, fit_after=percent)
    value = SimpleNamespace(name="thigh.coulomb", unit="N", low=1.0, high=1.1, value=1.05, noise_share=1.0)
    found = SimpleNamespace(
        scores=[score], runs=[SimpleNamespace(name="a", held_out=True, tests=tests)], converged=True, differing=[],
        values=[value], by_run={}, correlation=np.eye(1), joint="thigh",
    )  # fmt: skip
    return found


@pytest.mark.parametrize(("percent", "tests", "word"), CASES)
def test_every_verb_gives_the_same_word(percent, tests, word, monkeypatch):
    # What is left beside the noise of a reading: test_what_is_left.py.
    for module, names in (
        (identify_answer, ("systematic", "rounded")),
        (saved_models_answer, ("constant", "unexplained")),
    ):
        for name in names:
            monkeypatch.setattr(module, name, lambda result: "")
    monkeypatch.setattr(calibrate_answer.advice, "useless", lambda result: False)
    monkeypatch.setattr(calibrate_answer.advice, "undetermined_rows", lambda result: [])
    judged = SimpleNamespace(fit=lambda run: percent, tests=tests, held_out=True)
    monkeypatch.setattr(mjcf, "_judged", lambda result: judged)
    robot = SimpleNamespace(
        usable=True, optimum=SimpleNamespace(stop=SimpleNamespace(converged=True)), values=(), lacking=None
    )
    words = {
        "rule": worth(percent, tests),
        "identify": identified(percent, tests),
        "run": run(percent, tests),
        "compare": compared(percent, tests),
        "calibrate": calibrate_answer.word(calibrated(percent, tests)),
        "calibrate --model": mjcf.word(robot),
    }
    assert words == dict.fromkeys(words, word)


def test_what_is_not_sound_is_never_good_and_poor_stays_poor():
    assert [worth(percent, tests, sound=False) for percent, tests, _ in CASES] == [
        "usable" if word == "good" else word for *_, word in CASES
    ]


@pytest.mark.parametrize(
    ("share", "random", "word"),
    [(0.05, True, "good"), (0.05, False, "usable"), (0.3, True, "usable"), (0.3, False, "poor")],
)
def test_a_frequency_response_has_the_same_rule(share, random, word):
    result = SimpleNamespace(share=share, random=random, fit=SimpleNamespace(warnings=()))
    assert frequency.word(SimpleNamespace(result=result)) == word


def test_a_run_is_tested_where_it_was_measured_and_long_enough():
    rng = np.random.default_rng(0)
    u, e = rng.normal(size=(2, 400))
    y = u + 0.1 * e
    y[50:60] = np.nan
    assert left_by_run(u, y, u).independent
    assert not left_by_run(u, y, 0.5 * u).independent
    assert left_by_run(u[:50], y[:50], u[:50]) is None
