"""Sentences of the first screen: names as they are, whole lists, and nothing said twice."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.signal import lfilter

import sysid
from sysid.base.quantities import capital
from sysid.data.record import IOData
from sysid.diagnosis.advice import advise
from sysid.report import identify_answer
from sysid.report.sections import criteria_grid
from sysid.structures import Hammerstein, OutputError
from sysid.workflow.evaluation import has_ample_samples
from sysid.workflow.identification import identify_file
from sysid.workflow.setting import Setting
from sysid.workflow.steps import NextStep
from twin.cli import main

RNG = np.random.default_rng(21)
U = RNG.uniform(0.0, 60.0, 30).repeat(20)
Y = 20.0 + lfilter([0.0, 0.2], [1.0, -0.9], U) + 0.2 * RNG.normal(size=len(U))


def first_lines(name: str, rows: np.ndarray, capsys) -> list[str]:
    np.savetxt(name, rows, delimiter=",", header="t [s],heater [%],temp [degC]", comments="", fmt="%.5g")
    main(["info", name, "--out", "seen"])
    return capsys.readouterr().out.splitlines()


@pytest.mark.parametrize("name", ["gaps.csv", "my gaps, 2.csv"])
def test_a_sentence_that_begins_with_a_file_keeps_its_name(name, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    rows = np.delete(np.column_stack([np.arange(len(U)), U, Y]), np.s_[300:340], axis=0)
    assert first_lines(name, rows, capsys)[1].startswith(f"{name}, row 302")


def test_words_get_a_capital_and_names_of_files_do_not():
    told = [capital(text) for text in ("a.csv: no clock", "logs/day1.parquet is read", "temp rests")]
    assert told == ["a.csv: no clock", "logs/day1.parquet is read", "Temp rests"]


@pytest.mark.parametrize(
    ("n", "said"), [(1, "1 isolated outlier, "), (3, "3 isolated outliers, "), (15, "15 isolated outliers, ")]
)
def test_a_list_of_outliers_ends_with_how_many_more_there_are(n, said, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    places = np.sort(np.random.default_rng(5).choice(np.arange(20, 580, 7), n, replace=False))
    y = Y.copy()
    y[places] = -999.0
    (found,) = [a.sentence for a in advise(IOData(U, y, 1.0, y_name="temp")) if "isolated outlier" in a.sentence]
    listed = ", ".join(map(str, places[:5])) + (f" and {n - 5} more" if n > 5 else "")
    assert said in found
    assert f" of samples: {listed};" in found
    second = first_lines("outlier.csv", np.column_stack([np.arange(len(U)), U, y]), capsys)[1]
    assert second.endswith((f"{listed}.", "more below)."))


def test_a_search_that_did_not_converge_is_said_once(monkeypatch):
    e = SimpleNamespace(unseen=True, notes=(), joint=None, tests=None, evaluation=None, judged_fit=90.0)
    step = NextStep("the search did not converge (5 starts)", "qpal identify a.csv --starts 20")
    result = SimpleNamespace(evaluation=e, next=step, advice=())
    for name, value in {"_wrong": [], "_bad": False, "_spoilt": False, "rounded": False}.items():
        monkeypatch.setattr(identify_answer, name, lambda *_, value=value: value)
    monkeypatch.setattr(identify_answer.verdict, "no_joint", lambda e: False)
    left = "the search did not converge, and the error is 11 times the noise of a reading"
    monkeypatch.setattr(identify_answer, "systematic", lambda e: left)
    assert identify_answer.sentence(result) == f"{capital(left)}."
    monkeypatch.setattr(identify_answer, "systematic", lambda e: "the error is slow")
    assert identify_answer.sentence(result) == "The error is slow; the search did not converge (5 starts)."


def test_a_gap_has_one_next_step_which_is_read(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    rows = np.delete(np.column_stack([np.arange(len(U)), U, Y]), np.r_[200:240, 500:540], axis=0)
    said = first_lines("gaps.csv", rows, capsys)
    (step,) = [line for line in said if line.startswith("Next")]
    assert step == "Next: keep the longest piece, 260 of 520 rows, with --range 240:499"
    assert said[1].endswith("where most are 1 s (within 1%), and at most 3 in a row are filled.")
    assert main(["info", "gaps.csv", "--range", "240:499", "--out", "kept"]) == 0
    assert capsys.readouterr().out.startswith("260 samples")


def test_an_interval_that_is_too_narrow_is_said_where_it_stands(monkeypatch):
    """In the cell of each interval, and of no other cell; the title stays what it is."""
    e = SimpleNamespace(values=[1])
    rows = [("gain", "2", "1 to 3", "mm/V"), ("delay", "–", "not determined", "s"), ("kp", "4", "fixed", "")]
    monkeypatch.setattr(identify_answer, "_physical", lambda _: rows)
    monkeypatch.setattr(identify_answer, "_errors", lambda _: [("error", "0.1", "–", "mm")])
    shown = {}
    for narrow in ("Too narrow: so", ""):
        monkeypatch.setattr(identify_answer.verdict, "too_narrow", lambda _, narrow=narrow: narrow)
        grid = identify_answer.values(e)
        assert grid.headings == ("", "value", "95 % interval", "unit")
        shown[bool(narrow)] = [row[2] for row in grid.rows]
    assert shown[False] == ["1 to 3", "not determined", "fixed", "–"]
    assert shown[True] == ["wider than 1 to 3", "not determined", "fixed", "–"]


@pytest.mark.parametrize(
    ("name", "unit", "stops"),
    [
        ("angle", "rad", True), ("level", "m", True), ("y", "", True), ("valve_position", "share", True),
        ("level", "share", False), ("flow", "m^3/s", False), ("flow", "l/min", False), ("p", "bar", False),
        ("temp", "degC", False), ("p", "kPa", False), ("angle", "furlong", False),
    ],
)  # fmt: skip
def test_only_what_may_be_a_place_has_end_stops(name, unit, stops):
    """The same record, which is cut off at both sides, in other units."""
    y = np.clip(np.cumsum(np.repeat(np.random.default_rng(2).uniform(-1.0, 1.0, 60), 10)), -3.0, 3.0)
    u = np.gradient(y) + 0.3 * np.repeat(np.random.default_rng(3).normal(size=60), 10)
    (found,) = [a for a in advise(IOData(u, y, 0.1, y_name=name, y_unit=unit)) if a.topic == "rest"]
    assert found.severity != "fine"
    assert ("end stop" in found.sentence, "actuated_joint" in found.command) == (stops, stops)


def test_the_number_of_parameters_is_called_what_it_is_and_one_output_has_one_fit(tmp_path):
    """A smooth map of 25 points counts less than its points, which "free parameters" would not say."""
    rng = np.random.default_rng(8)
    u, w = (np.repeat(rng.uniform(-1.0, 1.0, 60), 10) for _ in "uw")
    y = lfilter([0.0, 0.2], [1.0, -0.8], np.tanh(2.0 * u)) + 0.02 * rng.normal(size=600)
    np.savetxt(tmp_path / "a.csv", np.column_stack([u, w, y, y + w]), delimiter=",", header="u,w,y,z", comments="")
    one = identify_file(tmp_path / "a.csv", Setting(Hammerstein(1, 1, 1), starts=1), "u", "y", 1.0).evaluation
    rows = {row[0]: row[1] for row in criteria_grid(one).rows}
    d, listed = one.fit.criteria.d, sum(parameter.free for parameter in one.fit.parameters)
    assert d < listed
    assert rows["effective number of parameters d / samples N"] == f"{d} / 300"
    for outputs, names in (("y", []), ("y,z", ["y", "z"])):
        several = identify_file(tmp_path / "a.csv", Setting(OutputError(1, 1, 1), starts=1), "u,w", outputs, 1.0)
        labels = [row[0] for row in criteria_grid(several.evaluation).rows]
        assert [label for label in labels if "the same of" in label] == [
            f"the same of {n}, validation data" for n in names
        ]


def first_sentence(left: str, why: str, monkeypatch, independent: bool = True) -> str:
    """The sentence of a usable model with this finding and this reason for its next step."""
    tests = SimpleNamespace(independent=independent, white=False)
    e = SimpleNamespace(unseen=True, notes=(), joint=None, tests=tests, evaluation=None, judged_fit=95.0)
    found = SimpleNamespace(evaluation=e, next=NextStep(why, "qpal identify a.csv"), advice=())
    for name, value in {"_wrong": [], "_bad": False, "_spoilt": False, "rounded": False, "systematic": left}.items():
        monkeypatch.setattr(identify_answer, name, lambda *_, value=value: value)
    return identify_answer.sentence(found)


def test_a_sentence_names_one_remedy_and_says_nothing_twice(monkeypatch):
    slow, goal = (
        "the error is slow and 27 times the noise of a reading",
        "the input is a goal, and there is no loop",
    )
    said = first_sentence(f"{slow}; a larger model may explain it", goal, monkeypatch)
    assert said == f"T{slow[1:]}; {goal}."
    incomplete = "the residuals are coloured, so the model is incomplete"
    dependent = first_sentence("", incomplete, monkeypatch, independent=False)
    assert dependent == "What is left still depends on the input."
    assert first_sentence(slow, incomplete, monkeypatch).endswith(f"; {incomplete}.")


def test_what_to_see_in_a_picture_is_in_it(monkeypatch):
    monkeypatch.setattr(identify_answer, "word", lambda _: "usable")
    for independent, see in (
        (True, "errors that look like noise."),
        (False, "errors that come with the input: the model"),
    ):
        e = SimpleNamespace(unseen=True, tests=SimpleNamespace(independent=independent))
        assert f"What to see: {see}" in identify_answer._caption(SimpleNamespace(evaluation=e))


def test_inputs_before_a_record_do_not_make_its_model_too_large():
    """A record that is cut out of a run, of a plant with a delay: each input that the delay still holds is a number."""
    u = np.repeat(np.random.default_rng(6).uniform(-1.0, 1.0, 60), 15)
    y = lfilter([0.1], [1.0, -0.9], np.concatenate([np.zeros(20), u[:-20]]))
    y += 0.005 * np.random.default_rng(7).normal(size=len(y))
    fit = sysid.fit(sysid.structures.process("P1D"), IOData(u[220:], y[220:], 1.0), starts=1)
    assert fit.criteria.d > 20
    own = 5  # gain, time constant, delay, zero and state
    for samples, ample in ((100 * own + 1, True), (100 * own - 100, False)):
        assert has_ample_samples(replace(fit, criteria=replace(fit.criteria, N=samples))) is ample
