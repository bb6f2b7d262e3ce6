"""Fits of the app against drawn records whose truth is known, and against the same call as the command line's."""

import subprocess
import sys

import numpy as np
import pytest
from app_served import wait, write_process
from scipy.signal import lfilter

import sysid
from sysid.base.errors import InputError
from sysid.base.quantities import percent
from sysid.structures import OutputError, ProcessModel
from sysid.workflow.identification import identify_file
from sysid.workflow.setting import Setting as Wanted
from twin.app.desk import Desk
from twin.app.entries import AUTO, Setting
from twin.app.figures import overlay, tab_of
from twin.app.jobs import Jobs
from twin.app.session import Session
from twin.app.words import words_of_page
from twin.parameter_file import read as read_parameters
from twin.parameters import Parameters

K, T, TD = 0.5, 1.0, 1.0
WRONG = Setting(structure="output_error", settings={"nb": 1, "nf": 1, "nk": 1}, starts=1)  # its delay is too small


@pytest.fixture(scope="module")
def desk(tmp_path_factory):
    """A session with two records of one plant, and a model of the wrong delay."""
    folder = tmp_path_factory.mktemp("fits")
    made = Desk(Session.open(folder / "session"), Jobs(2))
    for k in (1, 2):
        made.add_log(f"plant{k}.csv", write_process(folder / f"copy{k}.csv", K, T, TD, seed=k))
    wait(made)
    made.fit("d1", WRONG)
    wait(made)
    yield made
    made.close()


def last(desk):
    """The newest model with its key, once all jobs are over without an error."""
    wait(desk)
    assert [job.error for job in desk.jobs.all] == [""] * len(desk.jobs.all)
    return list(desk.session.models.items())[-1]


def parameters(desk, key):
    fit = sysid.load(desk.session.file("models", key, "model.json"))
    return dict(zip(fit.model.names, fit.theta, strict=True))


def test_a_step_that_was_tried_brings_what_it_says(desk):
    before = desk.session.models["m1"]
    assert before.verdict.word == "poor"
    assert before.verdict.number == percent(before.fit_validation)
    step = next(step for step in before.steps if step.words.startswith("output error"))
    assert step.words.startswith("output error (1,1,1")
    assert step.words.endswith(f" instead of {before.verdict.number}")
    assert "--" not in " ".join([*(s.words + s.why for s in before.steps), before.verdict.sentence, *before.notes])
    desk.take_step("m1", step)
    key, model = last(desk)
    assert f", {percent(model.fit_validation)} instead of" in step.words
    values = parameters(desk, key)
    pole = -values["linear.f1"]
    assert -0.1 / np.log(pole) == pytest.approx(T, rel=0.02)
    assert values["linear.b0"] / (1.0 - pole) == pytest.approx(K, rel=0.01)
    assert model.verdict.word == "good"
    assert not model.steps


def test_the_steps_are_those_of_the_same_call_and_the_numbers_too(desk):
    log = desk.session.log("d1")
    result = identify_file(log, Wanted(OutputError(1, 1, 1), starts=1), trials=None)
    model = desk.session.models["m1"]
    assert model.fit_validation == result.evaluation.validation_fit
    assert [step.why for step in model.steps] == [step.why for step in (result.next, result.also) if step]


def test_several_records_are_one_fit_and_others_judge_it(desk, tmp_path):
    setting = Setting(structure="process", settings={"kind": "P1D"}, starts=1)
    desk.fit("d1", setting, ["d2"])
    key, model = last(desk)
    assert model.records == ("d1", "d2")
    assert model.N == 600  # half of each
    logs = [desk.session.log("d1"), desk.session.log("d2")]
    expected = identify_file(logs, Wanted(ProcessModel("P1D"), starts=1)).evaluation
    assert model.fit_validation == expected.validation_fit
    desk.fit("d1", setting, (), ["d2"])
    key, model = last(desk)
    assert model.records == ("d1", "d2")
    values = parameters(desk, key)
    assert [values[f"plant.{name}"] for name in ("K", "T1", "Td")] == pytest.approx([K, T, TD], rel=0.02)
    assert desk.overlaid([key], "d1") == ([], [key])  # its run goes over two records
    (tmp_path / "again.py").write_bytes(desk.content("models", key, "script.py"))
    done = subprocess.run([sys.executable, "again.py"], cwd=tmp_path, capture_output=True, text=True)
    assert f"fit on the validation data: {model.fit_validation!r} %" in done.stdout, done.stderr


def test_what_is_held_keeps_its_value_and_what_is_bounded_its_bounds(desk):
    held = {"fixed": {"plant.Td": 0.9}, "bounds": {"plant.K": (None, 0.45)}}
    desk.fit("d1", Setting(structure="process", settings={"kind": "P1D"}, starts=1, **held))
    key, _ = last(desk)
    values = parameters(desk, key)
    assert values["plant.Td"] == 0.9
    assert values["plant.K"] <= 0.45 + 1e-9
    assert "plant.Td" in desk.content("models", key, "script.py").decode()
    desk.refine(key, "d2")
    key, refined = last(desk)
    values = parameters(desk, key)
    assert refined.setting.start is not None
    assert [values[f"plant.{name}"] for name in ("K", "T1", "Td")] == pytest.approx([K, T, TD], rel=0.02)
    desk.run("d1", key, 3)
    wait(desk)
    study = desk.session.studies["s1"]
    assert study.verdict.word == "good"
    assert any(text.startswith("Predicted 3 sample(s) ahead from measured outputs: 9") for text in study.sentences)
    assert {"run", "prediction"} == set(desk.figures("studies", "s1"))


def test_a_search_finds_the_plant(desk):
    desk.fit("d1", Setting(structure=AUTO, starts=1, seconds=25.0))
    _, model = last(desk)
    assert model.asked == AUTO
    best = 100.0 * (1.0 - 0.02 / np.std(desk.record("d1").y[300:]))  # what the noise leaves
    assert best - 1.0 < model.fit_validation < best + 1.0


def test_what_was_done_last_is_taken_back(desk):
    shown, models = desk.session.head.shown, dict(desk.session.models)
    files = sorted(desk.files("models", "m1"))
    desk.prepare("d1", start=5.0)
    desk.remove("models", "m1")
    desk.remove("data", "d1")
    assert "m1" not in desk.session.models
    assert desk.history.last == "the deletion of d1"
    assert desk.history.undo() == "the deletion of d1"
    assert desk.record("d1").N == 600
    desk.history.undo()
    assert desk.session.models == models
    assert sorted(desk.files("models", "m1")) == files
    desk.history.undo()
    assert desk.session.data["d1"].prepare.start is None
    assert desk.session.head.shown == shown
    while desk.history.last:
        desk.history.undo()
    with pytest.raises(InputError, match="nothing to undo"):
        desk.history.undo()


def test_sentences_name_the_controls_of_the_page():
    said = words_of_page(
        "/s/d1/log.csv: give --split 0.5 or --structure auto, not --unknown", {"/s/d1/log.csv": "a.csv"}
    )
    assert said == "a.csv: give 'estimation part' 0.5 or 'Search for a structure', not --unknown"


def test_several_inputs_and_outputs_are_one_model(desk, tmp_path):
    """y1 = 0.5 u1 / (1 + s) and y2 = 0.3 u2 - 0.2 u1, each through a lag of its own, as drawn."""
    rng = np.random.default_rng(7)
    u = np.repeat(rng.uniform(-5.0, 5.0, (2, 30)), 20, axis=1)
    poles = np.exp([-0.1, -0.2])
    y1 = lfilter([0.0, 0.5 * (1.0 - poles[0])], [1.0, -poles[0]], u[0])
    y2 = lfilter([0.0, 1.0 - poles[1]], [1.0, -poles[1]], 0.3 * u[1] - 0.2 * u[0])
    table = np.column_stack([0.1 * np.arange(600), *u, y1, y2]) + 0.01 * rng.standard_normal((600, 5)) * [0, 0, 0, 1, 1]
    np.savetxt(tmp_path / "mimo.csv", table, "%.8g", ",", header="time_s,a_V,b_V,p,q", comments="")
    key = desk.add_log("mimo.csv", tmp_path / "mimo.csv")
    wait(desk)
    desk.choose_columns(key, "a_V,b_V", "p,q", None, None)
    wait(desk)
    assert desk.record(key).u.shape == desk.record(key).y.shape == (600, 2)
    for job in [job for job in desk.jobs.all if job.error]:  # which columns they are was not beyond doubt
        desk.jobs.forget(job)
    desk.fit(key, Setting(structure="output_error", settings={"nb": 1, "nf": 1, "nk": 1}, starts=1))
    model_key, model = last(desk)
    assert model.fit_validation == pytest.approx(100.0 * (1.0 - np.mean(0.01 / np.std([y1, y2], axis=1))), abs=1.0)
    assert {"free-run-1", "free-run-2", "residuals-1", "residuals-2"} <= set(desk.figures("models", model_key))
    assert tab_of("free-run-2") == "Free run 2"
    runs = desk.runs(model_key)
    np.testing.assert_allclose(runs.run, np.column_stack([y1, y2]), atol=0.05)
    assert [name for name, _ in runs.outputs] == ["p", "q"]
    drawn = overlay({"m": runs})
    assert {trace["yaxis"] for trace in drawn["data"]} == {"y", "y2"}


@pytest.mark.nightly  # minutes; what the page asks for has a quick test below, and what the verbs find has others
def test_a_log_of_the_twin_departs_from_it_by_noise_alone_and_calibrates_to_its_own_values(tmp_path):
    own = Desk(Session.open(tmp_path / "session"), Jobs(1))
    try:
        for seed, excitation in ((3, "aprbs"), (4, "prbs")):
            own.make(joint="thigh", duration=20.0, Ts=0.05, seed=seed, excitation=excitation)
            wait(own)
        own.study("d1", "compare", "thigh")
        own.study("d1", "calibrate", "thigh", ["d2"])
        wait(own)
        compared, calibrated = own.session.studies.values()
        assert (compared.verdict.word, calibrated.verdict.word) == ("good", "usable")
        assert compared.verdict.sentence.startswith("No departure that matters")
        assert float(calibrated.verdict.number.split()[0]) > 97.0
        found = read_parameters(own.session.file("studies", "s2", "parameters.toml"))
        assert found["thigh.no_load_speed"] == pytest.approx(Parameters()["thigh.no_load_speed"], rel=0.05)
    finally:
        own.close()


def test_a_study_is_the_call_of_the_command_line(desk, monkeypatch):
    """The request that the page makes of the twin: which task, joint and logs; what it gives back is taken in."""
    asked = []
    monkeypatch.setattr(desk.jobs, "submit", lambda title, request, hear, key: asked.append((title, request)))
    desk.study("d1", "compare", "thigh")
    desk.study("d1", "calibrate", "thigh", ["d2"])
    (_, compare), (title, calibrate) = asked
    assert (compare["task"], compare["joint"], compare["logs"]) == ("compare", "thigh", [str(desk.session.log("d1"))])
    assert title == "thigh calibrating the twin"
    assert calibrate["logs"] == [str(desk.session.log(key)) for key in ("d1", "d2")]
    assert [entry["name"] for entry in calibrate["entries"]] == ["plant2.csv"]
