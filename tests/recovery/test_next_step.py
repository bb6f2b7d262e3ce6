"""What is said to try next after a poor fit: a command that runs, and that helps where the plant is known."""

import itertools
import json
import re
import shlex
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import scipy.signal
from motion import Reference
from often import often

import sysid
import twin
from sysid.base.limits import MORE_STARTS
from sysid.diagnosis.finding import Advice
from sysid.diagnosis.residuals import poor, residual_tests
from sysid.joint.posterior import _warnings
from sysid.selection.table import Selection
from sysid.structures import ActuatedJoint, OutputError
from sysid.workflow.advice_after_fit import advice_after_fit
from sysid.workflow.identification import identify_file
from sysid.workflow.next_step import _more_starts, next_step
from sysid.workflow.remarks import JOINT_RECORD, warnings_of
from sysid.workflow.setting import Setting
from twin.cli import main

TS = 0.1


def identified(arguments: list[str], capsys) -> dict:
    """The summary of `qpal identify`."""
    assert main(["identify", *arguments, "--json"]) == 0
    return json.loads(capsys.readouterr().out)


def followed(summary: dict, capsys) -> dict:
    """The summary of the command that `summary` says to try next."""
    program, verb, *arguments = shlex.split(summary["next"]["command"])
    assert (program, verb) == ("qpal", "identify")
    return identified(arguments, capsys)


def option(summary: dict, name: str) -> str | None:
    words = shlex.split(summary["next"]["command"])
    return words[words.index(name) + 1] if name in words else None


def written(path, u: np.ndarray, y: np.ndarray, seed: int, noise: float) -> str:
    rng = np.random.default_rng(seed)
    np.savetxt(path, np.column_stack([u, y + noise * np.std(y) * rng.standard_normal(len(y))]), "%.9g", ",")
    return str(path)


def levels(N: int, seed: int, hold: int = 8) -> np.ndarray:
    return np.repeat(np.random.default_rng(seed).uniform(-1.0, 1.0, -(-N // hold)), hold)[:N]


@pytest.fixture(autouse=True)
def here(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)


@pytest.mark.nightly
@pytest.mark.parametrize("seed", often(3, 1))
def test_end_stops_want_a_joint(seed, capsys):
    twin.Experiment("thigh", "sweep", 250.0, TS, seed, options={"jitter": 0.5, "shrink": 0.4}).run().save("log.csv")
    poor = identified(["log.csv", "--structure", "hammerstein_wiener", "--starts", "1"], capsys)
    assert option(poor, "--structure") == "actuated_joint"
    better = followed(poor, capsys)
    assert better["fit_percent"]["validation"] > max(90.0, poor["fit_percent"]["validation"] + 5.0)
    assert better["next"] is None


@pytest.mark.parametrize("seed", often(3, 1))
def test_an_unstable_plant_in_a_loop_wants_a_predictor(seed, capsys):
    """At the default structure, where the controller answers within the sample, which a delay of 0 would explain."""
    rng = np.random.default_rng(seed)
    goal, u, y, x = levels(1000, seed, 25), np.zeros(1000), np.zeros(1000), 0.0
    for t in range(1000):
        y[t] = x + 0.02 * rng.normal()
        u[t] = 0.6 * (goal[t] - y[t])
        x = 1.05 * x + 0.5 * u[t] + 0.02 * rng.normal()
    np.savetxt("log.csv", np.column_stack([u, y + 3.0]), "%.9g", ",")
    poor = identified(["log.csv", "--ts", "0.1", "--starts", "1"], capsys)
    assert option(poor, "--structure") == "armax"
    better = followed(poor, capsys)
    pole = max(better["poles"], key=lambda pole: pole["re"])
    assert abs(pole["re"] - 1.05) < 0.01
    assert np.ptp(pole["intervals"]["real"]) < 0.05
    assert better["fit_percent"]["validation"] < 0.0 < 60.0 < better["one_step_fit_percent"]["ahead"]["fit"]
    assert better["next"] is None


@pytest.mark.parametrize("seed", often(3, 1))
def test_a_delay_that_the_orders_cannot_hold(seed, capsys):
    u = levels(1200, seed)
    y = scipy.signal.lfilter([0.0] * 7 + [0.3], [1.0, -0.7], u)
    arguments = [written("log.csv", u, y, seed, 0.02), "--ts", "0.1", "--structure", "output_error"]
    poor = identified([*arguments, "--orders", "1,1,1"], capsys)
    assert poor["fit_percent"]["validation"] < 80.0
    # A process holds the delay with fewer parameters.
    assert option(poor, "--orders") == "1,1,7" or option(poor, "--structure") == "process"
    better = followed(poor, capsys)
    assert better["fit_percent"]["validation"] > 95.0
    assert better["next"] is None


@pytest.mark.parametrize("seed", often(3, 1))
def test_a_linear_model_of_a_bent_plant(seed, capsys):
    u = levels(1500, seed)
    y = scipy.signal.lfilter([0.0, 0.3], [1.0, -0.7], np.clip(u, -0.2, 0.2) + 2.0 * np.maximum(u, 0.0) ** 2)
    poor = identified(
        [written("log.csv", u, y, seed, 0.02), "--ts", "0.1", "--structure", "output_error", "--orders", "1,1,1"],
        capsys,
    )
    assert poor["fit_percent"]["validation"] < 90.0
    assert option(poor, "--structure") == "hammerstein_wiener"
    assert followed(poor, capsys)["fit_percent"]["validation"] > 90.0


@pytest.mark.parametrize("seed", often(3, 1))
def test_a_first_part_that_does_not_cover_the_range(seed, capsys):
    u = levels(1500, seed)
    u[:850] *= 0.15  # the first half sees the straight middle of a saturation, the second all of it
    y = scipy.signal.lfilter([0.0, 0.3], [1.0, -0.7], np.tanh(3.0 * u))
    arguments = [written("log.csv", u, y, seed, 0.01), "--ts", "0.1", "--orders", "1,1,1", "--starts", "1"]
    poor = identified([*arguments, "--structure", "hammerstein_wiener"], capsys)
    assert poor["fit_percent"]["validation"] < 80.0
    assert 0.5 < float(option(poor, "--split")) < 1.0
    assert option(poor, "--orders") == "1,1,1"
    better = followed(poor, capsys)
    assert better["fit_percent"]["validation"] > poor["fit_percent"]["validation"] + 10.0
    linear = identified([*arguments, "--structure", "output_error"], capsys)
    if option(linear, "--split"):  # it covers more, and is still poor: no part makes a saturation linear
        linear = followed(linear, capsys)
    assert linear["fit_percent"]["validation"] < 80.0
    assert option(linear, "--structure") not in ("output_error", None)


@pytest.mark.parametrize("seed", often(3, 1))
def test_what_only_noise_limits_is_not_poor(seed, capsys):
    u = levels(1500, seed)
    y = scipy.signal.lfilter([0.0, 0.3], [1.0, -0.7], u)
    arguments = [written("log.csv", u, y, seed, 0.6), "--ts", "0.1", "--structure", "output_error"]
    summary = identified([*arguments, "--orders", "1,1,1"], capsys)
    assert summary["fit_percent"]["validation"] < 80.0
    if summary["residuals"]["white"] and summary["residuals"]["independent"]:
        assert summary["next"] is None


def test_the_command_keeps_what_was_given(capsys):
    u = levels(1200, 0)
    y = scipy.signal.lfilter([0.0] * 7 + [0.3], [1.0, -0.7], u + 0.4 * u**2)  # no linear model does
    with open("my log.csv", "w", encoding="utf-8") as file:
        file.write("t,drive in,other,out\n")
        file.writelines(f"{0.1 * k:.1f},{a:.9g},0.5,{b:.9g}\n" for k, (a, b) in enumerate(zip(u, y, strict=True)))
    given = ["my log.csv", "--input", "drive in", "--output", "out", "--time", "t", "--structure", "hammerstein"]
    given += ["--orders", "1,1,1", "--input-map", "polynomial", "--search", "lm", "--split", "0.6", "--detrend", "mean"]
    given += ["--starts", "2", "--seed", "3"]
    poor = identified(given, capsys)
    expected = ["qpal", "identify", *given]
    expected[expected.index("1,1,1")] = "1,1,7"
    words = shlex.split(poor["next"]["command"])
    pairs = [set(zip(w[3::2], w[4::2], strict=True)) for w in (words, expected)]
    assert words[:3] == expected[:3]
    assert pairs[0] == pairs[1]
    assert followed(poor, capsys)["fit_percent"]["validation"] > 99.0


def test_the_console_and_the_report_say_it(capsys):
    u = levels(1200, 0)
    y = scipy.signal.lfilter([0.0] * 7 + [0.3], [1.0, -0.7], u)
    file = written("log.csv", u, y, 0, 0.02)
    for orders, said in (("1,1,1", True), ("1,1,7", False)):
        given = [file, "--ts", "0.1", "--structure", "output_error", "--orders", orders, "--out", "out"]
        assert main(["identify", *given]) == 0
        out = " ".join(capsys.readouterr().out.split())
        html = Path("out/report.html").read_text(encoding="utf-8")
        for text in (out, re.sub("<[^>]*>", "", html)):
            assert bool(re.search(r"Next, 9\d\.\d\d % instead of [−\d.]+ %: qpal identify log.csv", text)) is said
            assert ("--orders 1,1,7" in text) is said


@pytest.mark.parametrize(("left_out", "journal"), [(0, None), (7, None), (7, "a journal.jsonl")])
def test_a_search_that_had_no_time_for_all_goes_on_from_its_journal(left_out, journal):
    """The fit is of a plant that folds its input, poor as a linear model; the rest of the table is made up."""
    u = levels(1200, 0)
    written("log.csv", u, scipy.signal.lfilter([0.0, 0.3], [1.0, -0.7], u**2), 0, 0.02)
    plain = identify_file("log.csv", Setting(OutputError(), starts=1), Ts=0.1)
    assert poor(plain.evaluation.validation_fit, plain.evaluation.tests)
    path = None if journal is None else Path(journal)
    searched = Selection((), None, plain.evaluation.fit, (), 50.0, 50.0, left_out, path)
    step = next_step(replace(plain, selection=searched))
    words = shlex.split(step.command)
    if not left_out:
        assert "budget" not in step.why
        return
    assert "the budget of 50 s ended the search before 7 of its candidates" in step.why
    given = dict(itertools.pairwise(words))
    assert given["--structure"] == "auto"
    assert float(given["--seconds"]) == 150.0
    assert given.get("--resume") == journal
    assert given["--starts"] == "1", "a journal belongs to its search"


@pytest.mark.nightly
def test_a_joint_is_told_what_its_record_needs_and_not_of_orders_and_maps(here, capsys):
    """An arm under a sine; the command that its advice names designs the next record."""
    u = 6.0 * np.sin(2 * np.pi * np.arange(900) / 100 + 0.3)
    arm = {"gain": 1.5, "lag": 1.2, "rise": 1.0, "fall": 1.2, "delay": 0.4, "x0": 35.0}
    y = Reference(lambda x: 0.4 * np.cos(np.deg2rad(x)), **arm).run(u) + 0.1 * np.random.default_rng(1).normal(size=900)
    rows = np.column_stack([0.1 * np.arange(900), u, y])
    np.savetxt("arm.csv", rows, delimiter=",", header="time [s],u [V],angle [deg]", comments="", fmt="%.9g")
    said = {a["topic"]: a for a in identified(["arm.csv", "--structure", "actuated_joint"], capsys)["advice"]}
    assert said["excitation"]["sentence"] == "u has 1 frequency only"
    needs, _, line = said["excitation"]["action"].partition(": ")
    assert needs == JOINT_RECORD
    assert shlex.split(line) == ["qpal", "design", "arm.csv"]
    assert main([*shlex.split(line)[1:], "--out", "next"]) == 0
    levels = Advice("levels", "u takes 3 distinct level(s): it shows", 3, "use a model without", "note", call="f()")
    few = advice_after_fit(levels, ActuatedJoint(), 50.0)
    assert (few.sentence, few.action, few.command) == ("u takes 3 distinct level(s)", JOINT_RECORD, ())
    assert advice_after_fit(levels, OutputError(), 50.0) == levels


def test_a_joint_is_told_which_values_its_record_does_not_determine():
    fit = sysid.load(Path(__file__).parents[1] / "saved/v1/joint_jams.json")
    (plain,) = (text for text in fit.warnings if "do not determine" in text)
    assert plain.startswith("the data do not determine 2 of 5 parameters of play")
    (told,) = (text for text in warnings_of(fit, joint=True) if "do not determine" in text)
    assert told == f"the data do not determine play.drag, play.pull0; {JOINT_RECORD}: qpal design FILE"
    assert warnings_of(fit, joint=False) == list(fit.warnings)


def test_one_number_of_starts_is_proposed():
    """By the joint's own warning, and where a search did not converge."""
    joint = SimpleNamespace(fit=None, stopped="", agreed=1, tried=5)
    assert next(_warnings(joint, None)).endswith(f"try --starts {MORE_STARTS}")
    stop, recipe = SimpleNamespace(converged=False), SimpleNamespace(starts=5, held=SimpleNamespace(start=None))
    result = SimpleNamespace(evaluation=SimpleNamespace(fit=SimpleNamespace(stop=stop), setting=recipe))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("sysid.workflow.next_step.command", lambda _, starts: f"--starts {starts}")
        assert _more_starts(result).command == f"--starts {MORE_STARTS}"


def test_a_model_that_explains_nothing_is_poor_though_what_is_left_is_white():
    rng = np.random.default_rng(0)
    tests = residual_tests(rng.standard_normal(600), rng.standard_normal(600))
    assert tests.white
    assert tests.independent
    assert [poor(percent, tests) for percent in (-20.0, 0.0, 5.0, 85.0)] == [True, True, False, False]
    assert poor(float("nan"), tests)
