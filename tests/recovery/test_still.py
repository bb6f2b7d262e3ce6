"""Signals that do not move are named, each by what is wrong; no command follows that the record refuses."""

import json

import numpy as np
import pytest

from sysid import IOData
from sysid.diagnosis.advice import advise
from sysid.excitations import Aprbs
from twin.cli import main

TS, N, DIES = 0.1, 1000, 350


def plant(seed=0):
    u = Aprbs(8.0, 0.5, 5.0).generate(N, TS, np.random.default_rng(seed))
    y = np.zeros(N)
    for t in range(1, N):
        y[t] = 0.95 * y[t - 1] + 0.05 * u[t - 1]
    return u, y + 0.01 * np.random.default_rng(seed + 1).standard_normal(N)


def records():
    """What stands still, and the sentence that says so."""
    u, y = plant()
    dead = y.copy()
    dead[DIES:] = y[DIES]
    return {
        "input": (np.full(N, 5.0), y, r"u is 5 in all 1000 samples"),
        "output": (u, np.full(N, 0.3), r"y is 0.3 in all 1000 samples"),
        "sensor": (u, dead, rf"y stands at -?[\d.]+ from {DIES * TS:g} s to 100 s, 65 % of the record"),
    }


@pytest.mark.parametrize("which", ["input", "output", "sensor"])
def test_what_does_not_move_is_named(which):
    import re

    u, y, said = records()[which]
    found = [a for a in advise(IOData(u, y, Ts=TS)) if a.severity == "warning" and a.topic == "data"]
    assert len(found) == 1
    assert re.search(said, found[0].sentence), found[0].sentence
    assert not any("too few" in a.sentence or "nb + nf at most 0" in a.action for a in advise(IOData(u, y, Ts=TS)))


def test_a_rest_at_an_end_a_hold_of_the_input_and_noise_are_no_dead_sensor():
    u, y = plant()
    rest, hold = u.copy(), u.copy()
    ended = np.minimum(y, np.quantile(y, 0.3))  # at its upper end most of the time, in many stretches
    hold[400:] = u[400]
    held = np.concatenate([y[:400], np.full(N - 400, y[400])])
    for a, b in ((rest, ended), (hold, held), (u, y), (u, np.round(y))):
        assert not [f for f in advise(IOData(a, b, Ts=TS)) if "stands at" in f.sentence]


@pytest.mark.parametrize("which", ["input", "output", "sensor", "one row"])
def test_info_sends_nobody_to_a_command_that_is_refused(which, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    u, y, _ = records().get(which, records()["sensor"])
    n = 1 if which == "one row" else N
    rows = np.column_stack([np.arange(n) * TS, u[:n], y[:n]])
    np.savetxt("log.csv", rows, delimiter=",", header="time_s,voltage_V,angle_rad", comments="", fmt="%.9g")
    assert main(["identify", "log.csv", "--starts", "1", "--out", "fit"]) == 2
    capsys.readouterr()
    assert main(["info", "log.csv", "--out", "out"]) == (1 if which == "one row" else 0)
    said = " ".join(capsys.readouterr().out.split())
    assert "qpal identify log.csv Report" not in said
    assert json.loads((tmp_path / "out/summary.json").read_text(encoding="utf-8"))["next"] is None
    if which == "sensor":
        assert f"Next: use the part in which it moves: qpal identify log.csv --range 0:{DIES * TS:g}" in said
    if which in ("input", "output"):
        assert f"Next: record again while the {which} moves" in said


def test_a_remedy_in_python_says_that_it_is_python():
    u = np.sign(plant()[0])
    y = plant()[1]
    (levels,) = (a for a in advise(IOData(u, y, Ts=TS)) if a.topic == "levels")
    assert ": in Python, sysid.excitations.Aprbs(" in levels.of_file("log.csv").action
