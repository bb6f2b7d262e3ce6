"""What is said to try next was tried: its gain is what its command then prints, on plants whose answer is known."""

import json
import shlex
from contextlib import suppress
from dataclasses import replace

import numba
import numpy as np
import pytest
from often import by_day, often
from scipy.signal import cont2discrete, lfilter

import sysid.workflow.identification as identification
from sysid.base.compiled import CompilationRefusedError, kernel, refusing_compilation
from sysid.base.errors import InputError
from sysid.base.quantities import number
from sysid.report.identify_answer import answer
from sysid.structures import Hammerstein, OutputError, ProcessModel
from sysid.workflow.changes import changed_setting, command
from sysid.workflow.identification import identify_file
from sysid.workflow.next_step import proposals
from sysid.workflow.setting import Setting
from sysid.workflow.trials import gain_of, tried
from twin.cli import main

TS, N = 0.1, 600
ENOUGH = ["--trials", "300"]  # for whatever is tried, on a machine that has compiled nothing


def steps_of(seed: int, hold: int = 20) -> np.ndarray:
    return np.repeat(np.random.default_rng(seed).uniform(-1.0, 1.0, N // hold), hold)


def lags(u: np.ndarray, *times: float, delay: int = 0) -> np.ndarray:
    """The response of first-order lags in series, gain 2, to u held over each sample."""
    den = np.ones(1)
    for T in times:
        den = np.convolve(den, [T, 1.0])
    b, a, _ = cont2discrete(([2.0], den), TS)
    return np.concatenate([np.zeros(delay), lfilter(b.ravel(), a, u)])[: len(u)]


def swinging(u: np.ndarray) -> np.ndarray:
    """The response of a pair of complex poles, gain 2, which no process of two lags is."""
    b, a, _ = cont2discrete(([2.0], [0.25, 0.2, 1.0]), TS)
    return lfilter(b.ravel(), a, u)


def bent(u: np.ndarray) -> np.ndarray:
    return np.sign(u) * np.minimum(np.abs(u), 0.3) + u**2


FIRST = ["output_error", "--orders", "1,1,1"]
# The plant, what is asked for, and an option of the answer with what it has to say; None where it is the default.
CASES = {
    "orders": (swinging, FIRST, "--orders", "2,2,1"),
    "delay": (lambda u: lags(u, 0.3, delay=7), FIRST, "--orders", "1,1,8"),
    "map": (lambda u: lags(bent(u), 1.0), FIRST, "--structure", "hammerstein_wiener"),
    "offset": (
        lambda u: lags(u, 1.0) + 25.0,
        ["output_error", "--orders", "1,1,1", "--offset", "none"],
        "--offset",
        None,
    ),
    "too few lags": (lambda u: lags(u, 1.0, 0.6, delay=3), ["process", "--kind", "P1D"], "--kind", "P2D"),
    "an oven": (
        lambda u: lags(u, 3.0, 1.0, delay=9),
        ["hammerstein", "--orders", "1,1,1", "--starts", "1"],
        "--structure",
        "process",
    ),
    "too many lags": (lambda u: lags(u, 1.0, delay=3), ["process", "--kind", "P2D"], "--kind", None),
}


def written(y: np.ndarray, u: np.ndarray, seed: int) -> str:
    noise = 0.02 * np.std(y) * np.random.default_rng(seed + 100).standard_normal(N)
    rows = np.column_stack([TS * np.arange(N), u, y + noise])
    np.savetxt("log.csv", rows, delimiter=",", header="time [s],u [V],y [degC]", comments="", fmt="%.9g")
    return "log.csv"


def identified(arguments: list[str], capsys) -> dict:
    assert main(["identify", *arguments, "--json", "--out", "out"]) == 0
    return json.loads(capsys.readouterr().out)


@pytest.fixture(autouse=True)
def _folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)


# By day one case of each kind of step: orders are a delay's, and an oven has what a map and too few lags have.
@pytest.mark.parametrize("seed", often(5, 1))
@pytest.mark.parametrize("case", by_day(CASES, *(set(CASES) - {"an oven", "delay"})))
def test_the_gain_that_is_quoted_is_what_the_command_prints(case, seed, capsys):
    plant, asked, option, wanted = CASES[case]
    u = steps_of(seed)
    first = identified([written(plant(u), u, seed), "--structure", *asked, *ENOUGH], capsys)
    step = first["next"]
    words = shlex.split(step["command"])
    said = words[words.index(option) + 1] if option in words else None
    assert said == wanted
    then = identified([*words[2:], "--trials", "0"], capsys)
    fits = [s["fit_percent"]["validation"] for s in (first, then)]
    promised = {"fit_percent": pytest.approx(fits[1]), "instead_of": pytest.approx(fits[0]), "after_s": None}
    assert step["gain"] == promised
    if case == "too many lags":
        assert "is not determined" in step["why"]
        assert then["criteria"]["bic"] < first["criteria"]["bic"]
    else:
        assert fits[1] > fits[0] + 0.5


def fitted(recipe, y=None, seed=0, **options):
    u = steps_of(seed)
    return identify_file(written(lags(u, 1.0, 0.5) if y is None else y, u, seed), Setting(recipe, starts=1), **options)


@pytest.mark.parametrize(("recipe", "trials"), [(OutputError(2, 2, 1), None), (OutputError(1, 1, 1), 0.0)])
def test_a_good_fit_costs_nothing_more_and_no_budget_tries_nothing(recipe, trials, monkeypatch):
    fits, whole = [], identification.evaluate
    monkeypatch.setattr(identification, "evaluate", lambda *a, **k: fits.append(a) or whole(*a, **k))
    result = fitted(recipe, trials=trials)
    assert len(fits) == 1
    assert (result.next is None) is (recipe.nf == 2)


def test_what_does_not_help_is_not_said_and_what_was_not_tried_is_said_so():
    result = fitted(OutputError(1, 1, 1))
    steps = proposals(result)
    assert [step.change.get("structure") for step in steps if not step.guess] == ["auto"]
    outcome = tried(result, steps, lambda *_: result.evaluation, 100.0)
    assert [step.command for step in outcome] == [command(result, structure="auto", starts=2)]
    assert outcome[0].gain is None
    shown = answer(replace(result, next=outcome[0]))
    assert shown.next.startswith("Next, not tried, it takes up to 110 s: qpal identify")

    def refused(*_):
        raise InputError("no such model")

    assert tried(result, steps, refused, 100.0) == outcome


@pytest.mark.parametrize("seconds", ["-1", "nan"])
def test_a_budget_is_seconds(seconds, capsys):
    written(steps_of(0), steps_of(0), 0)
    assert main(["identify", "log.csv", "--trials", seconds]) == 2
    assert "give seconds, 0 to try nothing, or leave it out" in capsys.readouterr().err


def test_a_joint_takes_no_time_from_what_fits_in_a_short_budget():
    result, asked = fitted(OutputError(1, 1, 1)), []
    joint = replace(proposals(result)[-1], change={"structure": "actuated_joint"}, guess=False)

    def attempt(setting, *_):
        asked.append(setting.recipe.name)
        return result.evaluation

    (step,) = tried(result, [joint, *(s for s in proposals(result) if s.guess)], attempt, 2.0)
    assert "actuated_joint" not in asked
    assert "output_error" in asked
    assert step.missed == "it needs more time than this fit took"
    tried(result, [joint], attempt, 10.0)
    assert asked[-1] == "actuated_joint"


def sizes(result) -> list:
    """What is proposed but processes."""
    return [step for step in proposals(result) if step.change.get("structure") != ProcessModel.name]


def test_a_search_that_its_time_ends_has_its_gain_after_that_time():
    """It is not the least that the whole search brings: that fits the estimation data better, not these."""
    result, better = fitted(OutputError(1, 1, 1)), fitted(OutputError(2, 2, 1)).evaluation
    taken = []

    def slow(setting, split, detrend):
        taken.append((setting, split, detrend))
        return replace(better, fit=replace(better.fit, seconds=setting.seconds))

    (step,) = tried(result, sizes(result), slow, 100.0)
    (seconds,) = {setting.seconds for setting, *_ in taken if setting.seconds == step.gain.after}
    after = f"{better.judged_fit:.2f} % after {number(seconds, 2)} s of its search instead of "
    assert f"Next, {after}{result.evaluation.judged_fit:.2f} %: qpal" in step.line("Next")
    assert step.as_dict()["gain"]["after_s"] == seconds
    assert all(0.0 < setting.seconds <= 100.0 and split is None for setting, split, _ in taken)


def test_two_steps_at_most_are_said_and_of_equal_ones_the_smallest_model_first():
    result = fitted(OutputError(1, 1, 1))
    small, large = (fitted(recipe).evaluation for recipe in (OutputError(2, 2, 1), OutputError(3, 3, 1)))
    outcome = tried(result, sizes(result), lambda s, *_: large if s.recipe.nb == 2 else small, 100.0)
    assert "--orders 1,2,1" in outcome[0].command
    assert len(outcome) <= 2


def test_of_a_model_with_maps_the_linear_one_of_its_orders_is_tried_before_other_sizes():
    result, taken = fitted(Hammerstein(1, 2, 2, "saturation")), []
    (step,) = [each for each in proposals(result) if each.change.get("structure") == "output_error"]
    assert step.command.endswith("--structure output_error --orders 1,2,2")

    def attempt(setting, *_):
        taken.append(setting.recipe)
        return result.evaluation

    tried(result, [each for each in proposals(result) if each.guess], attempt, 100.0)
    # A delay in place of many orders: with one time constant before two.
    assert taken[:3] == [ProcessModel("P1D"), ProcessModel("P2D"), OutputError(1, 2, 2)]
    assert taken[2] == changed_setting(result, **step.change).recipe


def test_a_split_is_judged_on_the_samples_that_both_have_not_seen():
    result, other = fitted(OutputError(1, 1, 1)), fitted(OutputError(2, 2, 1), split=0.7)
    (step, *_) = proposals(result)
    gain = gain_of(result, replace(step, change={"split": 0.7}), other.evaluation)
    assert gain.fit == other.evaluation.validation_fit
    assert gain.instead == pytest.approx(result.evaluation.fit.fit_percent(other.evaluation.validation))
    assert gain.instead != pytest.approx(result.evaluation.validation_fit)
    assert gain.in_words().startswith("on the last 30 %, ")


def test_a_smaller_kind_that_bic_does_not_prefer_is_not_said():
    """Though it predicts nearly as well."""
    u = steps_of(0)
    result, fewer = (fitted(ProcessModel(kind), lags(u, 1.0, 0.12, delay=3)) for kind in ("P2D", "P1D"))
    assert result.evaluation.judged_fit - 0.5 < fewer.evaluation.judged_fit
    assert result.evaluation.fit.criteria.bic < fewer.evaluation.fit.criteria.bic - 10.0
    (step,) = proposals(fitted(ProcessModel("P2D"), lags(u, 1.0, delay=3)))
    assert "--kind" not in step.command  # P1D is the default
    assert gain_of(result, step, fewer.evaluation) is None


def test_nothing_is_compiled_within_a_budget_that_nobody_gave(tmp_path, monkeypatch):
    monkeypatch.setattr(numba.config, "CACHE_DIR", str(tmp_path))  # an earlier run has left nothing

    @kernel
    def twice(x):
        return 2.0 * x

    with refusing_compilation() as refused, pytest.raises(CompilationRefusedError):
        twice(1.0)
    assert len(refused) == 1
    assert twice(1.0) == 2.0
    result = fitted(OutputError(1, 1, 1))

    def compiling(*_):
        with suppress(CompilationRefusedError):  # as a search over starts may do
            kernel(lambda x: x + 1.0)(1.0)
        return fitted(OutputError(2, 2, 1)).evaluation

    (step,) = tried(result, proposals(result), compiling, None)
    assert step.gain is None
    assert tried(result, proposals(result), compiling, 100.0)[0].gain is not None
