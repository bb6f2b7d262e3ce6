"""Progress of a fit: every search is told, and the bar only moves forward and never to the end."""

import re
import sys
import time
from types import ModuleType

import numpy as np
import pytest
from numba import njit
from numba.core import event

import sysid.base.compiled  # noqa: F401  # its listener
from sysid.base.errors import InputError
from sysid.data.record import IOData
from sysid.structures import ActuatedJoint
from sysid.workflow import identification
from sysid.workflow.identification import identify_file
from sysid.workflow.setting import Setting
from twin.cli import console, main
from twin.cli.console import Rounds, Searches, Steps, _Lines


def test_a_joint_tells_each_search_of_its_fit(tmp_path):
    rng = np.random.default_rng(0)
    u = np.repeat(rng.uniform(-10.0, 10.0, 15), 20)
    data = IOData(u, np.cumsum(u) + rng.normal(size=300), 0.05)
    file = tmp_path / "log.csv"
    np.savetxt(file, np.column_stack([data.u, data.y]), delimiter=",", header="voltage [V],angle [rad]", comments="")
    seen: list[tuple[float, str]] = []
    steps = Steps(lambda done, name: seen.append((done, name)))
    steps("fitting")
    setting = Setting(ActuatedJoint(load="none", stops="none"), starts=1)
    identify_file(file, setting, Ts=0.05, progress=Searches(steps))
    done, names = zip(*seen[1:], strict=True)
    assert len(done) > 10
    assert 0.0 < done[0] <= done[-1] < 1.0
    assert list(done) == sorted(set(done))
    assert names[0].startswith("search 1, actuated joint: loss")


def test_a_search_with_a_budget_moves_with_the_time_and_with_its_candidates(monkeypatch):
    now = [100.0]
    monkeypatch.setattr(console.time, "monotonic", lambda: now[0])
    seen: list[tuple[float, str]] = []
    steps = Steps(lambda done, name: seen.append((done, name)), (0.1, 0.8, 0.1))
    steps("reading")
    steps.tick()  # nothing that goes by time
    steps("fitting")
    rounds = Rounds(steps, 6, 110.0)
    rounds.begin()
    assert seen[-1] == (pytest.approx(0.1), "round 1 of a search of up to 110 s")
    for _ in range(11):
        now[0] += 5.0
        steps.tick()
    assert seen[-1][0] == pytest.approx(0.1 + 0.8 * 55.0 / 110.0)
    rounds(3, 40, "wiener(2,3,1)")
    assert seen[-1] == (pytest.approx(0.5), "round 1: 3 of 40, wiener(2,3,1)")
    now[0] += 500.0
    steps.tick()
    steps.part(0.1, "search 1, actuated joint")  # what comes after the budget does not move it back
    done = [place for place, _ in seen]
    assert done == sorted(done)
    assert done[-1] < 0.9
    steps("drawing")
    assert seen[-1] == (pytest.approx(0.9), "drawing")
    steps.tick()
    assert seen[-1] == (pytest.approx(0.9), "drawing")


def test_without_a_terminal_a_long_run_tells_a_line_now_and_then(monkeypatch, capsys):
    monkeypatch.setattr(console, "_SLOW", (0.05, 0.1))
    with console.progress(2, (0.5, 0.5), lines=True) as step:
        step("reading a.csv")
        step("fitting")
        step.part(0.5, "search 3, actuated joint")
        time.sleep(0.4)
    lines = capsys.readouterr().err.splitlines()
    assert 2 <= len(lines) <= 4
    assert re.fullmatch(r"qpal: 0 s, 75 %: search 3, actuated joint", lines[0])
    time.sleep(0.2)
    with console.progress(2) as step:
        step("reading a.csv")
        time.sleep(0.2)
    assert capsys.readouterr().err == ""  # a verb that does not ask for lines, and none after the end


def test_the_progress_of_a_structure_search_moves_before_its_first_candidate_is_done(tmp_path, monkeypatch, capsys):
    """The search itself is replaced by one that tells nothing for a second and then stops."""

    def silent(file, setting, input, output, ts, time_column, split, detrend, fitting, **_):
        fitting()
        time.sleep(1.0)
        raise InputError("the end")

    monkeypatch.setattr(identification, "identify_file", silent)
    monkeypatch.setattr(console, "_SLOW", (0.1, 0.2))
    given = ["identify", "log.csv", "--structure", "auto", "--seconds", "2", "--out", str(tmp_path / "a")]
    assert main(given) == 2
    lines = [line for line in capsys.readouterr().err.splitlines() if " %: " in line]
    shares = [int(re.search(r"(\d+) %", line)[1]) for line in lines]
    assert len(shares) >= 4
    assert shares == sorted(set(shares))
    assert 3 <= shares[0] < 20 < shares[-1] < 60
    assert "round 1 of a search of up to 2 s" in lines[0]
    assert main([*given, "--json"]) == 2
    assert capsys.readouterr().err == "qpal: the end\n"


def test_work_of_known_length_tells_the_time_that_is_left(monkeypatch, capsys):
    now = [100.0]
    monkeypatch.setattr(console.time, "monotonic", lambda: now[0])
    known, unknown = console._Lines(200.0, known=True), console._Lines(200.0)
    said = []
    for gone, done in ((10.0, 2.0), (20.0, 50.0), (90.0, 10.0), (300.0, 200.0)):
        now[0] = 100.0 + gone
        for lines in (known, unknown):
            lines.update(done, "12 robots")
            lines.write()
        said += capsys.readouterr().err.splitlines()
    assert said == [
        "qpal: 10 s, 1 %: 12 robots",  # too little is done to tell
        "qpal: 10 s, 1 %: 12 robots",
        "qpal: 20 s, 25 %: 12 robots, about 60 s left",
        "qpal: 20 s, 25 %: 12 robots",
        "qpal: 90 s, 5 %: 12 robots, about 28 min left",
        "qpal: 90 s, 5 %: 12 robots",
        "qpal: 300 s, 100 %: 12 robots, about 0 s left",
        "qpal: 300 s, 100 %: 12 robots",
    ]


def test_the_time_that_is_left_does_not_grow_while_a_step_is_silent(monkeypatch, capsys):
    now = [100.0]
    monkeypatch.setattr(console.time, "monotonic", lambda: now[0])
    lines = console._Lines(200.0, known=True)
    for gone, left in ((20.0, ", about 60 s left"), (50.0, ", about 30 s left"), (90.0, "")):
        now[0] = 100.0 + gone
        lines.update(50.0, "12 robots")
        lines.write()
        assert capsys.readouterr().err == f"qpal: {gone:.0f} s, 25 %: 12 robots{left}\n"


def test_more_steps_than_were_expected_are_not_more_than_all(capsys):
    lines = _Lines(4)
    lines.update(6.0, "iteration 9")
    lines.write()
    assert ", 100 %: iteration 9" in capsys.readouterr().err


def test_a_first_compilation_is_told_while_it_lasts(capsys):
    lines = _Lines(4)

    class During(event.Listener):
        def on_start(self, event):
            lines.write()

        def on_end(self, event):
            pass

    @njit  # without a cache on disk
    def double(x):
        return 2.0 * x

    with event.install_listener("numba:compile", During()):
        double(1.0)
    double(1.0)
    lines.write()
    told = capsys.readouterr().err.splitlines()
    assert told[0].endswith("compiling, once on this machine")
    assert "compiling" not in told[-1]


def test_a_line_is_written_while_the_module_that_watches_the_compiler_is_being_imported(monkeypatch):
    monkeypatch.setitem(sys.modules, "sysid.base.compiled", ModuleType("sysid.base.compiled"))
    assert not console._compiles()
