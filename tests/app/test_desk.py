"""Logs, preparation, fits in processes of their own, cancelling, and the script that does the same."""

import re
import subprocess
import sys
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest
from app_served import desk_with_a_record, wait
from scipy.signal import lfilter

import sysid
from sysid.base.errors import InputError
from sysid.base.quantities import percent
from sysid.drawing.plotly import base_layout
from sysid.report.figures import TABLE
from sysid.workflow.identification import identify_file
from sysid.workflow.setting import Setting as Wanted
from twin.app import tasks
from twin.app.desk import Desk
from twin.app.entries import Data, Model, Prepare, Setting
from twin.app.figures import name_of, stack_panels, tab_of
from twin.app.jobs import DONE, FAILED, Jobs
from twin.app.script import script
from twin.app.session import Session

LINEAR = {"structure": "output_error", "settings": {"nb": 1, "nf": 1, "nk": 1}, "starts": 1}


@pytest.fixture(scope="module")
def desk(tmp_path_factory):
    """A session with a record, a preparation and a model."""
    made = desk_with_a_record(tmp_path_factory.mktemp("desk"))
    made.prepare("d1", start=1.0, stop=18.0, high=8.0)
    made.fit("d1", Setting(**LINEAR))
    wait(made)
    yield made
    made.close()


def test_a_log_is_read_and_advised_on(desk):
    entry = desk.session.data["d1"]
    assert entry.columns == ("time_s", "voltage_V", "angle_rad")
    data = desk.record("d1")
    assert (data.N, data.Ts, data.u_unit, data.y_unit) == (400, 0.05, "V", "rad")
    assert any("voltage_V" in text for text in entry.notes)
    assert all(job.state == DONE for job in desk.jobs.all)


def test_a_preparation_that_cannot_be_done_changes_nothing(desk):
    before = desk.session.data["d1"].prepare
    for wrong in ({"start": 50.0}, {"start": 9.0, "stop": 3.0}, {"high": 999.0}, {"missing": "x"}, {"resample": -1}):
        with pytest.raises(InputError):
            desk.prepare("d1", **wrong)
    assert desk.session.data["d1"].prepare == before == Prepare(start=1.0, stop=18.0, high=8.0)


def test_the_model_has_its_numbers_figures_and_files(desk):
    model = desk.session.models["m1"]
    assert model.fit_validation is not None
    assert 80.0 < model.fit_validation < 100.0
    assert model.d == 4  # one coefficient of B, one of F, an initial state, an offset
    assert any("Butterworth" in note for note in model.notes)
    drawn = desk.figures("models", "m1")
    assert {"free-run", "residuals", "pole-zero", "bode", "step-response"} <= set(drawn)
    assert [*drawn] == [name for name, figure in TABLE.items() if figure.tab and name in drawn]
    assert [*map(tab_of, ("pole-zero", "free-run", "run"))] == ["Poles", "Free run", "Run"]
    assert all(each["caption"] for each in drawn.values())
    runs = desk.runs("m1")
    assert runs.t[0] == 1.0
    assert abs(runs.t[-1] - 18.0) < 1e-9
    assert {"script.py", "report.html", "model.json", "model.h", "model.c", "model.py"} == set(
        desk.files("models", "m1")
    )
    assert sysid.load(desk.session.file("models", "m1", "model.json")).criteria.d == 4


def test_the_report_is_shown_whole_though_it_is_built_again(desk):
    written = desk.session.file("models", "m1", "report.html").read_text(encoding="utf-8")
    again = desk.content("models", "m1", "report.html").decode()
    assert parts(again) == parts(written)
    assert len(parts(again)) > 200
    policy = re.search(r'Security-Policy" content="([^"]*)"', again)[1]
    assert policy == re.search(r'Security-Policy" content="([^"]*)"', written)[1]
    assert "default-src 'none'" in policy


def parts(document):
    """Elements with their attributes, and texts, of what a page shows; spaces at line ends left out."""

    class Reader(HTMLParser):
        def handle_starttag(self, tag, attrs):
            found.append((tag, sorted(attrs)))

        def handle_endtag(self, tag):
            found.append(tag)

        def handle_data(self, data):
            found.extend(line.strip() for line in data.splitlines() if line.strip())

    found = []
    Reader().feed(document[document.index("<main") : document.index("</main>")])
    return found


def test_results_and_overlay_show_the_record_on_its_own_levels_and_at_its_own_times(desk):
    data = desk.prepared_record("d1")[0]
    assert np.abs(data.y.mean()) > 1e-3
    figure, runs = desk.figures("models", "m1")["free-run"]["figure"], desk.runs("m1")
    measured, model, *_, volts = figure["data"]
    degrees = 180.0 / np.pi
    for line, expected in (
        (measured, data.y[:, 0] * degrees),
        (volts, data.u[:, 0]),
        (model, runs.run[:, 0] * degrees),
    ):
        x, y = (np.array(line[axis], dtype=float) for axis in ("x", "y"))
        kept = ~np.isnan(y)
        np.testing.assert_allclose(x[kept], 1.0 + data.t, atol=1e-9)
        np.testing.assert_allclose(y[kept], expected, rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(runs.y, data.y)
    (border,) = (each["x0"] for each in figure["layout"]["shapes"])
    assert border == pytest.approx(runs.border)
    assert {each["x"] for each in figure["layout"]["annotations"] if each["xref"] == "x"} == {border}


def test_in_a_narrow_window_panels_stand_below_each_other():
    layout = base_layout(330) | {"meta": {"beside": 2}}
    layout |= {"xaxis": {}, "xaxis2": {}, "yaxis": {}, "yaxis2": {}, "annotations": [{"text": "a"}, {"text": "b"}]}
    assert stack_panels({"data": [], "layout": {**layout, "meta": {"beside": 1}}}) is None
    found = stack_panels({"data": [], "layout": layout})["layout"]
    (_, gap), (low, high) = found["yaxis2"]["domain"], found["yaxis"]["domain"]
    assert (high, found["yaxis2"]["domain"][0]) == (1.0, pytest.approx(0.0, abs=1e-12))
    assert (low - gap) * (found["height"] - 110) > 60.0  # room for numbers, label and title
    assert found["xaxis"]["domain"] == found["xaxis2"]["domain"] == [0.0, 1.0]
    assert [each["y"] for each in found["annotations"]] == [high, gap]
    assert layout["yaxis2"] == {}  # the wide one is as it was


def test_the_overlay_follows_the_chosen_record(desk):
    models = desk.session.models
    models["m2"] = models["m1"].model_copy(update={"data": "d2"})
    try:
        assert desk.overlaid({"m1", "m2"}, "d1") == (["m1"], ["m2"])
        assert desk.overlaid({"m1", "m2"}, "d2") == (["m2"], ["m1"])
        assert desk.overlaid({"m1"}, "d2") == ([], ["m1"])
    finally:
        del models["m2"]


def test_the_script_gives_the_same_fit_to_the_last_bit(desk, tmp_path):
    (tmp_path / "again.py").write_bytes(desk.content("models", "m1", "script.py"))
    done = subprocess.run([sys.executable, "again.py"], cwd=tmp_path, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    model = desk.session.models["m1"]
    first, second = done.stdout.splitlines()[:2]
    assert first == f"fit on the estimation data: {model.fit_estimation!r} %"
    assert second == f"fit on the validation data: {model.fit_validation!r} %"


@pytest.mark.parametrize(
    ("structure", "settings", "call"),
    [
        ("actuated_joint", {}, "sysid.structures.ActuatedJoint()"),
        ("hammerstein", {"nb": 1, "nf": 1, "nk": 1, "input_map": "saturation"}, "input_map='saturation'"),
        ("nlarx", {}, "sysid.structures.NonlinearArx()"),
        ("state_space", {}, "sysid.structures.NonlinearStateSpace()"),
    ],
)
def test_every_structures_script_is_python_and_names_are_no_code(desk, structure, settings, call):
    model = desk.session.models["m1"]
    model = model.model_copy(update={"setting": Setting(structure=structure, settings=settings)})
    evil = 'x"""\nimport os; os.abort()\n#'
    data = desk.session.data["d1"].model_copy(update={"name": evil, "input": evil})
    text = script(model, data, [Path("/tmp/log.csv")], [], None)
    compile(text, "script", "exec")
    assert call in text
    assert "\nimport os" not in text


def test_only_the_files_of_a_model_are_given_away(desk):
    for kind, key, name in (
        ("models", "m1", "entry.json"),
        ("models", "m1", "../../session.json"),
        ("models", "m9", "model.json"),
        ("data", "d1", "log.csv"),
        ("folder", "x", "model.json"),
    ):
        with pytest.raises(InputError):
            desk.content(kind, key, name)


def test_a_log_that_cannot_be_read_says_why_and_columns_can_be_chosen(desk, tmp_path):
    file = tmp_path / "log.csv"
    file.write_text("a,b,c\n" + "".join(f"{k % 5},{k % 7},{k % 3}\n" for k in range(60)))
    key = desk.add_log("plain.csv", file)
    job = wait(desk)["reading"]
    assert any(job.state == FAILED for job in desk.jobs.all)
    entry = desk.session.data[key]
    assert entry.columns == ("a", "b", "c")
    assert "plain.csv" in entry.problem
    with pytest.raises(InputError) as said:
        desk.record(key)
    assert str(said.value).count("plain.csv") == entry.problem.count("plain.csv")
    assert str(desk.session.folder) not in entry.problem
    with pytest.raises(InputError, match=r"plain\.csv"):
        desk.fit(key, Setting(**LINEAR))
    with pytest.raises(InputError, match="no column 'z'"):
        desk.choose_columns(key, "z", "b", None, 0.1)
    desk.choose_columns(key, "a", "b", None, 0.1)
    wait(desk)
    assert desk.session.data[key].problem == ""
    assert (desk.record(key).N, desk.record(key).Ts) == (60, 0.1)
    desk.remove("data", key)
    assert desk.session.head.shown == "d1"
    for job in desk.jobs.all[:]:
        desk.jobs.forget(job)


def test_a_record_that_was_removed_meanwhile_is_told_in_a_sentence(desk):
    for use in (
        lambda: desk.prepare("d99", range=(0.0, 1.0)),
        lambda: desk.choose_columns("d99", None, None, None, None),
    ):
        with pytest.raises(InputError, match="this session has no 'd99'"):
            use()


def test_an_error_that_nobody_foresaw_is_named_without_advice_that_does_not_help(desk):
    job = desk.jobs.submit("x", {"task": "nothing"}, lambda job, said: None)
    wait(desk)
    assert job.state == FAILED
    assert job.error.startswith("an error of qpal itself ended this job: KeyError: 'nothing'; ")
    assert not any(word in job.error for word in ("shorter", "starts", "resample"))
    desk.jobs.forget(job)


@pytest.mark.nightly
def test_a_joint_is_fitted_to_the_log_that_the_page_makes_and_all_its_files_come(tmp_path):
    """The joint meets one end of its way in this log, so only one stop is known."""
    own = Desk(Session.open(tmp_path / "session"), Jobs(1))
    try:
        own.make()
        wait(own)
        own.fit("d1", Setting(structure="actuated_joint", starts=1))
        wait(own)
        assert [job.error for job in own.jobs.all] == [""] * len(own.jobs.all)
        model = own.session.models["m1"]
        assert model.fit_estimation is not None
        assert model.fit_estimation > 90.0
        assert model.joint
        files = own.files("models", "m1")
        assert {"script.py", "report.html", "model.json", "model.h", "model.c", "model.py", "joint.xml"} == set(files)
        assert ' inf"' not in own.content("models", "m1", "joint.xml").decode()
    finally:
        own.close()


def test_settings_out_of_their_limits_are_sentences(desk):
    for wrong in ({"starts": 0}, {"split": 1.5}, {"seed": -1}):
        with pytest.raises(InputError):
            desk.setting(**wrong)
    with pytest.raises(InputError):
        desk.fit("d1", Setting(structure="nothing"))
    with pytest.raises(InputError):
        desk.fit("d1", Setting(structure="output_error", settings={"orders": 3}))
    with pytest.raises(InputError):
        desk.make(joint="tail")
    with pytest.raises(InputError):
        desk.study("d1", "compare", "")


def test_the_worker_fits_what_the_library_fits(desk):
    """Against plain calls of the library on the prepared record."""
    entry, model = desk.session.data["d1"], desk.session.models["m1"]
    record = tasks.open_record(desk.session.log("d1"), entry)
    estimation, validation = entry.prepare.preparation().apply(record.data).split(0.5)
    fit = sysid.fit(sysid.structures.output_error(1, 1, 1, offset="free"), estimation, starts=1, seed=0)
    assert fit.fit_percent(validation) == model.fit_validation


def test_the_saved_model_opens_with_the_session(desk):
    text = (desk.session.folder / "models" / "m1" / "entry.json").read_text()
    assert Model.model_validate_json(text) == desk.session.models["m1"]
    assert (
        Data.model_validate_json((desk.session.folder / "data" / "d1" / "entry.json").read_text()).name == "thigh.csv"
    )


def test_a_step_test_is_fitted_as_a_whole_as_on_the_command_line(tmp_path):
    """Against `identify` on the same file; another share that is no two parts is refused, with the one that works."""
    u = np.repeat([0.0, 1.0], [50, 150])
    y = lfilter([0.0, 0.2], [1.0, -0.9], u) + 0.01 * np.random.default_rng(1).normal(size=200)
    log, copy = tmp_path / "step.csv", tmp_path / "copy.csv"
    for path in (log, copy):
        np.savetxt(path, np.column_stack([0.02 * np.arange(200), u, y]), delimiter=",", header="t,u,y", comments="")
    own = Desk(Session.open(tmp_path / "session"), Jobs(1))
    try:
        own.add_log("step.csv", copy)
        wait(own)
        own.fit("d1", Setting(**LINEAR, split=0.8))
        own.fit("d1", Setting(**LINEAR))
        wait(own)
        refused = next(job.error for job in own.jobs.all if job.error)
        assert refused.startswith("step.csv: with 'estimation part' 0.8 the input moves in one of the two parts alone")
        assert "leave 'estimation part' out: where the halves are so too, as in a step test, all is used" in refused
        (model,) = own.session.models.values()
        result = identify_file(log, Wanted(Setting(**LINEAR).recipe(), starts=1)).evaluation
        assert model.whole
        assert model.fit_estimation == result.estimation_fit
        assert model.fit_validation is None
        assert result.notes[0].replace("--validation", "'records that judge the model'") in model.notes
        (key,) = own.session.models
        assert len(own.runs(key).t) == 200
        assert name_of(key, model) == f"{key}: {percent(model.fit_estimation)} of the record"
        (tmp_path / "again.py").write_bytes(own.content("models", key, "script.py"))
        done = subprocess.run([sys.executable, "again.py"], cwd=tmp_path, capture_output=True, text=True)
        assert done.stdout.splitlines()[0] == f"fit on the estimation data: {model.fit_estimation!r} %", done.stderr
        assert "validation data" not in done.stdout
    finally:
        own.close()
