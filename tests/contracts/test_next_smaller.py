"""The next step is the smallest model that brings as much, and says what it is better by, on plants that are known."""

import re
import shlex
from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import lfilter

from sysid.base.errors import InputError
from sysid.structures import Armax, Arx, BoxJenkins, Hammerstein, NonlinearStateSpace, OutputError, ProcessModel
from sysid.workflow import next_step, trials
from sysid.workflow.identification import identify_file
from sysid.workflow.next_step import proposals
from sysid.workflow.results import Identification
from sysid.workflow.setting import Setting
from sysid.workflow.steps import Gain, NextStep
from sysid.workflow.trials import tried
from twin.cli import main

N = 600
TRIED = ["--starts", "1", "--trials", "300"]  # for whatever is tried, on a machine that has compiled nothing


@pytest.fixture(autouse=True)
def in_a_folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)


def lag(u: np.ndarray, gain: float, time: float, delay: int = 0) -> np.ndarray:
    """The response of a first-order lag with a delay, in samples of 1 s."""
    a = np.exp(-1.0 / time)
    return np.concatenate([np.zeros(delay), lfilter([0.0, gain * (1.0 - a)], [1.0, -a], u)])[: len(u)]


def steps_of(seed: int, hold: int = 30) -> np.ndarray:
    return np.repeat(np.random.default_rng(seed).uniform(0.0, 60.0, N // hold), hold)


def written(path: str, inputs: list[np.ndarray], y: np.ndarray, seed: int = 100) -> str:
    noise = 0.2 * np.random.default_rng(seed).standard_normal(N)
    names = ["heater [%]", "fan [V]"][: len(inputs)]
    header = ",".join(["t [s]", *names, "temp [degC]"])
    np.savetxt(path, np.column_stack([np.arange(N), *inputs, y + noise]), delimiter=",", header=header, comments="")
    return path


def told(arguments: list[str], capsys) -> tuple[float, list[str]]:
    """The fit [%] that `identify` prints, and its lines on what is next."""
    assert main(["identify", *arguments, "--out", "out"]) == 0
    out = capsys.readouterr().out
    found = re.search(r"^([\d.]+) %", out, re.MULTILINE)
    assert found is not None
    return float(found[1]), re.findall(r"^(?:Next|Or),? (.*)$", out, re.MULTILINE)


def followed(line: str, capsys) -> float:
    """The fit [%] of the command of such a line."""
    words = shlex.split(line[line.index("qpal ") :])
    return told([*words[2:], "--trials", "0"], capsys)[0]


def first_order(seed: int = 3) -> str:
    u = steps_of(seed)
    return written("log.csv", [u], 20.0 + lag(u, 1.5, 20.0, delay=9))


@pytest.mark.nightly  # what is tried and which of equal ones is said are quick tests below
def test_a_plant_of_one_time_constant_leads_to_that_and_not_to_two(capsys):
    fit, lines = told([first_order(), "--structure", "hammerstein", "--orders", "1,1,1", *TRIED], capsys)
    assert lines[0].endswith("--structure process")  # the default kind is P1D
    assert not any("P2D" in line for line in lines)
    assert followed(lines[0], capsys) > fit + 0.5


def test_a_smaller_model_of_the_same_fit_says_that_it_is_smaller(capsys):
    fit, (line, *_) = told([first_order(), "--structure", "process", "--kind", "P2D", *TRIED], capsys)
    found = re.match(r"(?:the same fit|([\d.]+) % instead of ([\d.]+) %) with (\d+) parameters? fewer: ", line)
    assert found is not None
    assert found[1] is None or float(found[1]) < float(found[2]) == fit
    assert int(found[3]) >= 1
    assert followed(line, capsys) > fit - 0.5


@pytest.mark.nightly
def test_several_inputs_lead_to_the_linear_model_before_larger_ones(capsys):
    u, w = steps_of(3), steps_of(4, hold=20) / 12.0
    path = written("log.csv", [u, w], 20.0 + lag(u, 1.5, 40.0) + lag(w, -4.0, 15.0))
    columns = ["--input", "heater [%],fan [V]", "--output", "temp [degC]"]
    for asked in (["hammerstein_wiener"], ["state_space", "--orders", "1,1,0"]):
        fit, lines = told([path, *columns, "--structure", *asked, *TRIED], capsys)
        assert "--structure output_error" in lines[0], asked
        assert followed(lines[0], capsys) > fit


ZEROS = (20.0, 28.0, 12.0)


def days(bent: bool = False) -> list[str]:
    """Three logs of one plant, whose zeros differ."""
    paths = []
    for k, zero in enumerate(ZEROS):
        u = steps_of(5 + k)
        y = zero + lag(np.minimum(u, 30.0) if bent else u, 1.2, 15.0, delay=2)
        paths.append(written(f"day{k}.csv", [u], y, 100 + k))
    return paths


@pytest.mark.nightly
@pytest.mark.parametrize("bent", [False, True], ids=["linear", "nonlinear"])
def test_logs_of_several_zeros_lead_to_a_zero_of_each(bent, capsys):
    fit, lines = told([*days(bent), "--structure", "hammerstein_wiener", *TRIED], capsys)
    assert "--offset each" in lines[0]
    assert ("--structure process" in lines[0]) is not bent
    assert followed(lines[0], capsys) > fit + 0.5


def fitted(recipe, *paths: str, **options) -> Identification:
    return identify_file(paths, Setting(recipe, starts=1), **options)


def order_of_trials(result: Identification) -> list[tuple[str, str]]:
    """The structures and zeros that are tried, in their order, where none of them helps."""
    taken = []

    def attempt(setting: Setting, *_):
        taken.append((setting.recipe.name, getattr(setting.recipe, "offset", "")))
        raise InputError("not this one")

    tried(result, proposals(result), attempt, 100.0)
    return taken


def test_of_equal_processes_the_smaller_is_said_alone(monkeypatch):
    """Also where the larger predicts the same samples better by a hair that is no chance."""
    path = first_order()
    result = fitted(Hammerstein(1, 1, 1), path)
    found = {kind: fitted(ProcessModel(kind), path).evaluation for kind in ("P1D", "P2D")}
    assert found["P1D"].fit.criteria.bic < found["P2D"].fit.criteria.bic
    found["P2D"] = replace(found["P2D"], validation_fit=found["P1D"].validation_fit + 0.01)
    monkeypatch.setattr(trials, "larger", lambda *_: True)
    steps = [step for step in proposals(result) if step.change.get("structure") == ProcessModel.name]
    outcome = tried(result, steps, lambda setting, *_: found[setting.recipe.kind], 100.0)
    assert [step.change["kind"] for step in outcome] == ["P1D"]


@pytest.mark.parametrize("recipe", [Hammerstein(1, 1, 1), NonlinearStateSpace(1, 1, 0)], ids=["maps", "states"])
def test_the_linear_model_of_several_inputs_is_tried_before_a_state_space(recipe):
    u, w = steps_of(3), steps_of(4, hold=20) / 12.0
    path = written("log.csv", [u, w], 20.0 + lag(u, 1.5, 40.0, delay=5) + lag(w, -4.0, 15.0))
    result = fitted(recipe, path, input="heater [%],fan [V]", output="temp [degC]")
    others = [name for name, _ in order_of_trials(result) if name != recipe.name]
    assert others[0] == OutputError.name


def test_logs_of_several_zeros_are_tried_with_a_zero_of_each():
    result = fitted(Hammerstein(1, 1, 1), *days())
    taken = order_of_trials(result)
    assert {("process", "each"), ("hammerstein", "each")} <= set(taken)
    (own,) = [step for step in proposals(result) if step.change == {"offset": "each"}]
    assert not own.guess  # it has evidence, so it is said also where no time was left to try it
    assert ("process", "each") not in order_of_trials(fitted(Hammerstein(1, 1, 1), days()[0]))


@pytest.mark.parametrize(
    ("gain", "words"),
    [
        (Gain(98.741, 98.739, fewer=2), "the same fit with 2 parameters fewer"),
        (Gain(98.70, 98.74, fewer=1), "98.70 % instead of 98.74 % with 1 parameter fewer"),
        (Gain(98.74, 70.0, fewer=3), "98.74 % instead of 70.00 %"),
        (Gain(98.74, 70.0, after=2.5), "98.74 % after 2.5 s of its search instead of 70.00 %"),
    ],
)
def test_a_gain_says_what_a_step_is_better_by(gain, words):
    assert gain.in_words() == words


def test_what_the_record_points_to_is_tried_first_however_short_the_fit_was():
    """A zero of each log takes what the fit took, and came behind linear models, when no time was left."""
    result = fitted(Hammerstein(1, 1, 1), *days())
    own = [step for step in proposals(result) if step.change == {"offset": "each"}]
    taken = []

    def attempt(setting: Setting, *_):
        taken.append((setting.recipe.name, setting.seconds))
        raise InputError("not this one")

    slow = replace(result, evaluation=replace(result.evaluation, fit=replace(result.evaluation.fit, seconds=7.0)))
    tried(slow, [*(s for s in proposals(slow) if s not in own), *own], attempt)
    assert taken[0][0] == "hammerstein"
    assert taken[0][1] == pytest.approx(14.0, abs=0.5)
    many = NextStep("the search had few starting points", "qpal", {"starts": 20})
    joint = NextStep("the output goes on while a voltage acts", "qpal", {"structure": "actuated_joint"})
    servo = NextStep("the input is a goal", "qpal", {"structure": "servo_joint"})
    for steps, budget in (
        ([many], 7.0),
        ([joint], 10.0),
        ([servo], 10.0),
        ([replace(joint, guess=True)], 7.0),
        ([], 7.0),
    ):
        assert trials._usual(slow, steps) == budget


def test_a_process_is_among_what_may_be_tried_after_every_model_of_samples():
    result = fitted(OutputError(1, 1, 1), first_order())
    for recipe in (Arx(), Armax(), BoxJenkins(), OutputError(), Hammerstein()):
        setting = Setting(recipe, starts=1)
        other = replace(result, evaluation=replace(result.evaluation, setting=setting), asked=setting)
        assert [step.change["kind"] for step in next_step._process(other)] == ["P1D", "P2D"], recipe
    assert {"P1D", "P2D"} <= {step.change.get("kind") for step in proposals(result)}


def test_a_smaller_process_that_runs_as_well_as_a_predictor_is_said():
    """Errors of one step and of a free run have no common BIC: unseen free runs decide between them."""
    path = first_order()
    result, e = fitted(Armax(9, 2, 1), path), fitted(ProcessModel(), path).evaluation
    step = next(iter(next_step._process(result)))
    assert e.fit.criteria.d < result.evaluation.fit.criteria.d
    for fit, is_said in ((0.1, True), (-0.1, False)):
        other = replace(e, validation_fit=result.evaluation.validation_fit + fit)
        assert (trials.gain_of(result, step, other) is not None) is is_said


def test_a_process_is_tried_before_evidence_takes_the_time_and_whatever_is_compiled(monkeypatch):
    result = fitted(Hammerstein(1, 1, 1), *days())
    slow = replace(result, evaluation=replace(result.evaluation, fit=replace(result.evaluation.fit, seconds=4.0)))
    steps = proposals(slow)
    (own,) = [step for step in steps if step.change == {"offset": "each"}]
    others = [replace(own, command=f"qpal {k}") for k in range(3)]  # each half of the time: together more than all
    taken, compiled = [], []
    monkeypatch.setattr(trials, "compile_blocks", compiled.extend)

    def attempt(setting: Setting, *_):
        taken.append(setting.recipe.name)
        raise InputError("not this one")

    tried(slow, [*others, *steps], attempt)
    assert taken[:2] == ["hammerstein", "process"]
    assert compiled == list(ProcessModel().model().blocks)
    tried(slow, others, attempt)
    tried(slow, steps, attempt, 0.0)
    assert len(compiled) == len(ProcessModel().model().blocks)


@pytest.mark.parametrize(
    ("instead", "words"), [(98.0, "a linear model does as well"), (20.0, "a linear model predicts better")]
)
def test_a_linear_model_that_predicts_more_is_said_to_predict_better(instead, words, monkeypatch):
    path = first_order()
    result, e = fitted(Hammerstein(1, 1, 1), path), fitted(OutputError(1, 1, 6), path).evaluation
    (step,) = [s for s in proposals(result) if s.change.get("structure") == OutputError.name]
    monkeypatch.setattr(trials, "gain_of", lambda *_: Gain(98.0, instead))
    assert [s.why for s in tried(result, [step], lambda *_: e, 100.0)] == [words]
