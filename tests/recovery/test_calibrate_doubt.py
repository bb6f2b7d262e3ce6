"""A calibration says which values its logs do not determine: first, plainly, and in the file that it writes."""

import json
from types import SimpleNamespace

import numpy as np
import pytest

import twin
from twin.calibrate import advice
from twin.calibrate.calibration import _moved_sentence
from twin.calibrate.problem import Free
from twin.calibrate.result import Score, Value
from twin.cli import main
from twin.report import calibrate as report
from twin.report import calibrate_answer

SURE = Value("thigh.no_load_speed", "m/s", 0.0144, 0.0144, 0.0148, 0.0146, 0.0150, 0.9)
WIDE = Value("thigh.coulomb", "N", 30.0, 30.0, 17.9, 0.0, 203.6, 0.1)  # 10 N off is plausible
EDGE = Value("thigh.asymmetry", "1", 0.1, 0.1, 0.9, 0.88, 0.9, 0.1)
ABSENT = Value("thigh.stribeck", "1", 0.3, 0.3, 0.0, 0.0, 0.1, 0.5)  # 0 is an effect that is not there

FAR = Value("foot_mass", "kg", 0.05, 0.05, 0.24, 0.201, 0.287, 0.02)  # wide, but nothing in it was plausible before
EVERY = "Every calibrated parameter is determined; 1 other keeps its value, which these logs cannot tell"


def result(*values, correlation=None, logs=("a.csv",)):
    n = len(values)
    return SimpleNamespace(
        joint="thigh",
        values=values,
        correlation=np.eye(n) if correlation is None else np.array(correlation),
        found=SimpleNamespace(stop=SimpleNamespace(iterations=7), descents=1, late=False),
        agreements=(),
        by_run={},
        typical={},
        differing=[],
        converged=True,
        reason="small steps",
        next_step=lambda: "",
        scores=(),
        level=0.95,
        fixed={"thigh.stroke": "No log rests there."},
        provenance={"logs": logs, "without": []},
        moved=("thigh.stroke",),
        parameters=twin.Parameters({"thigh.coulomb": 17.9, "thigh.stroke": 0.07}),
    )


@pytest.mark.parametrize(
    ("value", "words"),
    [
        (SURE, ""),
        (WIDE, "anything from 0 to 204 N"),
        (EDGE, "on the upper end of its range, 0.900"),
        (ABSENT, ""),
        (FAR, ""),
    ],
)
def test_why_a_value_is_not_determined(value, words):
    assert advice.reason_undetermined(value) == words


def test_logs_tell_every_parameter_only_where_all_are_determined():
    every = "These logs tell every parameter that was free."
    for values, is_all in (((FAR, SURE), True), ((WIDE, SURE), False)):
        told = report.undetermined_sentences(SimpleNamespace(**{**vars(result(*values)), "fixed": {}}))
        assert (told == [every]) is is_all
        assert is_all or told[0].startswith("thigh.coulomb: anything from 0 to 204 N. To tell it, ")


def test_the_first_sentence_says_what_not_to_use():
    first, *rest = report.sentences(result(SURE, WIDE, EDGE))
    assert first.startswith("These logs do not determine all: thigh.coulomb (anything")
    assert first.endswith("So do not use the file for these.")
    assert not any("search" in text for text in rest)  # it converged; its words are the last of the page
    assert report.sentences(result(WIDE))[0].endswith("So do not use the file.")
    assert report.search_sentence(result(SURE)).startswith("The search converged after ")


@pytest.mark.parametrize(
    ("values", "held_out", "fits", "word", "sentence"),
    [
        ((SURE,), True, (60.0, 95.0), "good", f"{EVERY}."),
        ((SURE,), False, (60.0, 95.0), "usable", f"{EVERY}; no log was held out"),
        ((SURE,), True, (60.0, 70.0), "poor", "The twin follows log to 70.00 % only: it lacks something"),
        ((SURE,), True, (95.0, 90.0), "poor", "On log, which was held out, the twin is worse than before"),
        ((SURE, WIDE), True, (60.0, 95.0), "usable", "Not determined: coulomb; do not use the file for it."),
        ((WIDE,), True, (60.0, 95.0), "poor", "These logs determine none of the parameters: do not use the file."),
    ],
)
def test_the_first_screen_has_the_word_of_the_rules(values, held_out, fits, word, sentence):
    made = result(*values)
    made.scores = (Score("log", held_out, 0.1, 0.1, *fits),)
    made.runs = (SimpleNamespace(name="log", held_out=held_out, tests=None),)
    assert calibrate_answer.word(made) == word
    assert calibrate_answer.sentence(made).startswith(sentence)
    if sentence.startswith(EVERY):
        made.fixed = {}
        assert calibrate_answer.sentence(made).startswith("Every parameter is determined")


def test_values_that_act_alike_are_named_in_pairs():
    r = [[1.0, -0.999, 0.5], [-0.999, 1.0, 0.2], [0.5, 0.2, 1.0]]
    (said,) = advice.sentences(result(SURE, ABSENT, SURE, correlation=r))
    assert "thigh.no_load_speed and thigh.stribeck (−0.999)" in said
    assert said.count(" and ") == 1


def test_the_next_step_is_not_to_use_the_file():
    step = advice.next_step(result(SURE, WIDE, logs=["my log.csv"]))
    assert step.startswith(
        "Next: qpal calibrate 'my log.csv' --joint thigh --fix coulomb; or, to determine them: let it"
    )
    assert "--fix" not in advice.next_step(result(WIDE))  # nothing would be left
    assert advice.next_step(result(SURE)) == ""


def test_the_file_says_it_beside_each_value(tmp_path):
    text = advice.write(result(SURE, WIDE), tmp_path / "thigh.toml").read_text(encoding="utf-8")
    assert "# These logs do not determine all: thigh.coulomb" in text
    assert "coulomb = 17.9  # NOT DETERMINED by the logs; N; 95 % interval 0 to 200; was 30.00" in text
    assert "stroke = 0.07  # m; not calibrated, set beyond the angles of the logs" in text


def test_an_end_that_was_moved_out_of_the_way_is_told():
    before, after = twin.Parameters(), twin.Parameters({"thigh.stroke": 0.07})
    assert "It is set to 0.07 m (from 0.064)" in _moved_sentence("thigh.stroke", ("thigh.stroke",), before, after)
    assert _moved_sentence("thigh.backlash", ("thigh.stroke",), before, after) == ""


def test_the_end_of_a_wide_interval_is_a_bound_and_no_overflow():
    """Warnings are errors here."""
    free = Free("coulomb", 30.0, 0.0, 500.0, "N", 10.0)
    assert free.outer(1e6) == 500.0
    assert free.outer(free.inner(499.0)) == pytest.approx(499.0)


def test_a_file_that_is_not_to_be_used_is_no_success(tmp_path, monkeypatch, capsys):
    """The search converges; whether its interval says more than was plausible before is what decides."""
    log = tmp_path / "log.csv"
    twin.Experiment("thigh", "aprbs", 30.0, 0.02, 1).run().save(log)
    words = ["calibrate", str(log), "--joint", "thigh", "--free", "no_load_speed", "--out"]
    codes = {}
    for plausible in (advice.PLAUSIBLE, 1e-9):
        monkeypatch.setattr(advice, "PLAUSIBLE", plausible)
        codes[plausible] = main([*words, str(tmp_path / str(plausible))])
        assert json.loads((tmp_path / str(plausible) / "summary.json").read_text(encoding="utf-8"))["converged"]
    assert list(codes.values()) == [0, 1]
    assert "So do not use the file." in " ".join(capsys.readouterr().out.split())
