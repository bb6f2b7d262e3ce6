"""A search that the time ends has the best so far and says so; a budget that is not met changes nothing."""

import json
from types import SimpleNamespace

import numpy as np
import pytest

import twin
from sysid.base.errors import InputError
from sysid.data.record import IOData
from sysid.joint import clock as clocks
from sysid.joint.clock import Clock, TimeIsUp
from sysid.joint.posterior import fit_joint
from sysid.solver import iterate
from sysid.solver.iterate import Options
from sysid.structures import ActuatedJoint, NonlinearArx, OutputError
from sysid.workflow.evaluation import evaluate
from sysid.workflow.setting import Setting
from twin.calibrate import search
from twin.calibrate.calibration import calibrate
from twin.calibrate.problem import Free, Record, Simulations
from twin.calibrate.search import USUAL, find_optimum
from twin.cli import main

NONE = 1e-9  # [s] that every search overruns
AMPLE = 1e9
T = np.arange(0.0, 6.0, 0.02)


@pytest.fixture
def ticks(monkeypatch):
    """A clock that goes on by a second whenever the search of a joint or a calibration looks at it: once a search."""
    now = [0.0]

    def monotonic():
        now[0] += 1.0
        return now[0]

    for module in (clocks, search):
        monkeypatch.setattr(module, "time", SimpleNamespace(monotonic=monotonic))
    return now


@pytest.fixture(scope="module")
def log():
    options = {"half_period": 8.0, "first": 0.6, "shrink": 0.3}
    return twin.Experiment("thigh", "sweep", 40.0, 0.05, seed=5, options=options).run()


@pytest.fixture(scope="module")
def file(log, tmp_path_factory):
    return str(log.save(tmp_path_factory.mktemp("log") / "thigh.csv"))


def ramp_hold(values):
    """A mass on dry friction, pulled by a spring; see `tests/recovery/test_calibrate_core.py`."""
    F, v = values.T[:, :, None]
    return np.maximum(v * T - F / 10.0, 0.0)


def problem():
    y = ramp_hold(np.array([[4.0, 1.3]]))[0] + 1e-3 * np.random.default_rng(5).standard_normal(len(T))
    return Simulations(
        (Free("F", 0.0, 0.0, 50.0, "N", 1.0), Free("v", 1.0, 0.01, 10.0, "m/s", 0.5)), [Record("a", y, 0.02, ramp_hold)]
    )


def test_a_stage_that_the_time_ends_gives_what_was_there_and_later_ones_do_not_begin(ticks):
    clock, heard = Clock(5.0), []
    tell = clock.hears(heard.append)

    def stage(searches):
        for k in range(searches):
            tell(f"search {k}")
        return "done"

    assert clock.within("the first", stage, "given up", 1) == "done"
    assert clock.within("the second", stage, "given up", 9) == "given up"
    assert clock.within("the third", lambda: pytest.fail("it begins"), "left out") == "left out"
    assert clock.left == ["the second", "the third"]
    assert heard == ["search 0", "search 0", "search 1", "search 2"]  # the last one ended late
    assert clock.sentence() == (
        "the search was stopped after 5 s, before the second and the third: a better joint may exist; give it more "
        "time, for example --seconds 10"
    )
    with pytest.raises(TimeIsUp):
        tell("too late, and of no stage")
    assert Clock().hears(None) is None
    assert Clock().sentence() == ""


def test_a_joint_without_time_is_a_plain_one_fitted_to_the_whole_record(log):
    joint = fit_joint(log.io(), seconds=NONE)
    assert joint.parts == ()
    assert "before its end stops were chosen and its parts were searched: a better joint" in joint.stopped
    assert joint.warnings[0] == joint.stopped
    assert not any("only one of" in said for said in joint.warnings)  # the others had no time
    assert joint.fit.fit_percent(log.io()) > 90.0


@pytest.mark.parametrize("seconds", [3.0, 20.0])
def test_a_search_of_a_joint_ends_at_any_time_with_a_joint(seconds, log, ticks):
    """Looks at the clock are counted, so that the time is over at the same place of every run."""
    joint = fit_joint(log.io(), seconds=seconds)
    assert joint.stopped
    assert joint.fit.fit_percent(log.io()) > 90.0
    assert ticks[0] < seconds + 15.0


def test_a_budget_that_is_not_met_changes_nothing(log):
    data = log.io().select(0, 500)
    free, ample = (fit_joint(data, parts=("stribeck",), seconds=s) for s in (np.inf, AMPLE))
    assert np.array_equal(free.fit.theta, ample.fit.theta)
    assert (free.parts, free.agreed, free.warnings) == (ample.parts, ample.agreed, ample.warnings)
    assert free.stopped == ample.stopped == ""
    for recipe in (OutputError(1, 2, 1), NonlinearArx(1, 2, 1)):
        usual, limited = (
            evaluate(Setting(recipe, starts=2, seconds=s), data.select(0, 250), data.select(250, 500))
            for s in (np.inf, AMPLE)
        )
        assert np.array_equal(usual.fit.theta, limited.fit.theta)
        assert usual.notes == limited.notes


def test_a_calibration_without_time_stays_at_its_start_and_with_a_little_goes_part_of_the_way(ticks, monkeypatch):
    monkeypatch.setattr(iterate, "time", search.time)
    none = find_optimum(problem(), np.random.default_rng(0), options=Options(max_seconds=0.0, deadline=0.0))
    assert none.late
    assert (none.stop.iterations, none.descents) == (0, 0)
    assert np.array_equal(none.p, problem().start)
    assert none.cost == none.first
    some = find_optimum(problem(), np.random.default_rng(0), options=_limit(ticks, 6.0))
    assert some.late
    assert not some.stop.converged
    assert some.descents == 1  # the other starts were left
    assert some.cost < none.cost
    task = problem()
    whole = find_optimum(task, np.random.default_rng(0), options=_limit(ticks, 1e6))
    assert not whole.late
    assert whole.descents == 2
    assert task.central


def _limit(ticks, seconds):
    return Options(
        USUAL.max_iterations, USUAL.tolerance, USUAL.max_halvings, max_seconds=seconds, deadline=ticks[0] + seconds
    )


def test_a_calibration_says_that_it_was_stopped_and_what_to_do(file, tmp_path, capsys):
    words = ["calibrate", file, "--free", "coulomb,no_load_speed", "--fix", "dead_band", "--seconds", "1e-9"]
    code = main([*words, "--out", str(tmp_path / "o")])
    said = " ".join(capsys.readouterr().out.split())
    summary = json.loads((tmp_path / "o" / "summary.json").read_text())
    assert code == (0 if summary["converged"] else 1)
    assert summary["reason"].startswith("it was stopped after 1e-09 s, before it converged; the next step would be")
    assert summary["next_step"] == "Run it again with --seconds 2e-09, or without --seconds, for all of the search."
    assert summary["seconds"] == 1e-9
    assert summary["search"]["iterations"] == 0
    assert summary["next_step"] in said
    assert (tmp_path / "o" / "thigh.toml").is_file()


def test_a_design_and_a_fit_say_that_they_were_stopped(file, tmp_path, capsys):
    out = ["--seconds", "1e-9", "--json", "--out", str(tmp_path / "o")]
    assert main(["design", file, "--for", "ends", *out]) == 0
    notes = json.loads(capsys.readouterr().out)["notes"]
    assert notes[0].startswith("the search was stopped after 1e-09 s, before its end stops were chosen")
    assert main(["identify", file, "--structure", "actuated_joint", *out]) == 0
    summary = json.loads(capsys.readouterr().out)
    assert any("the search was stopped after 1e-09 s" in note for note in summary["notes"])
    assert main(["identify", file, "--structure", "hammerstein_wiener", "--seconds", "1e-9", *out[3:]]) == 0
    said = " ".join(capsys.readouterr().out.split())
    assert "the search ran out of time" in said
    assert "Next: qpal identify" in said
    assert "--structure hammerstein_wiener --orders 2,3,1 --seconds 2e-09" in said
    summary = json.loads((tmp_path / "o" / "summary.json").read_text(encoding="utf-8"))
    assert any("the fit was stopped after 1e-09 s with the best so far" in note for note in summary["notes"])
    assert summary["setting"]["seconds"] == 1e-9


@pytest.mark.parametrize("seconds", ["0", "-1", "nan", "inf"])
def test_a_budget_that_is_no_time_is_refused_before_the_file_is_read(seconds, capsys):
    for words in (["calibrate", "no.csv"], ["design", "no.csv"], ["identify", "no.csv"]):
        assert main([*words, "--seconds", seconds]) == 2
        assert f"--seconds is {seconds}; give a positive number, or leave it out" in capsys.readouterr().err


def test_a_budget_that_is_no_time_is_refused_by_calls_too(log):
    data: IOData = log.io()
    for call in (
        lambda: fit_joint(data, seconds=0.0),
        lambda: fit_joint(data, seconds=float("nan")),
        lambda: Setting(ActuatedJoint(), seconds=-1.0),
        lambda: calibrate([log], "thigh", seconds=0.0),
    ):
        with pytest.raises(InputError, match="give a positive"):
            call()
