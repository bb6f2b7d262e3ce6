"""A gain of the wrong sign is said, and only beyond doubt; passed tests do not vouch for a model that fits nothing."""

import re
from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import lfilter

from sysid import IOData
from sysid.data.preprocess import quick_start
from sysid.diagnosis.direction import confirmed, direction
from sysid.diagnosis.residuals import residual_tests
from sysid.report.verdict import tests_in_words as in_words
from sysid.structures import Hammerstein, OutputError
from sysid.systems import system
from sysid.workflow.evaluation import evaluate, evaluate_fit
from sysid.workflow.remarks import WRONG, gain_remarks
from sysid.workflow.setting import Setting


def held(seed: int, n: int = 1200, hold: int = 10) -> np.ndarray:
    return np.repeat(np.random.default_rng(seed).uniform(-1, 1, -(-n // hold)), hold)[:n]


def noise(seed: int, n: int = 1200) -> np.ndarray:
    return np.random.default_rng([7, seed]).normal(size=n)


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize(
    "plant",
    [([0, 0.3], [1, -0.7]), ([0, 0.05], [1, -1.0]), ([0] * 6 + [0.2], [1, -0.8]), ([0, 0.5, 0.2], [1, -1.5, 0.7])],
)
def test_the_record_shows_the_sign_of_lags_integrators_and_delays(plant, sign):
    """20 seeds of each, with a tenth of noise."""
    b, a = plant
    ways = []
    for seed in range(20):
        y = sign * lfilter(b, a, held(seed))
        ways.append(direction(IOData(held(seed), y + 0.1 * np.std(y) * noise(seed), 1.0)))
    assert set(ways) == {sign}


def test_the_plants_of_the_paper_one_of_which_has_a_negative_gain():
    for name, sign in (("textbook", 1), ("paper_thigh", -1), ("paper_shoulder", 1), ("paper_shank", 1)):
        for seed in range(5):
            assert direction(system(name).record(1000, 0.05, np.random.default_rng(seed))) == sign


def test_a_record_that_leaves_a_doubt_has_no_sign():
    for seed in range(10):
        u = held(seed)
        for y in (np.abs(lfilter([0, 0.3], [1, -0.7], u)), noise(seed), np.zeros(1200)):
            assert direction(IOData(u, y + 0.01 * noise(seed + 50), 1.0)) == 0


def test_an_input_of_few_frequencies_is_taken_for_nothing_worse():
    """A lag of a third order behind its input by more than 90 degrees: windows alone are wrong, models are not."""
    t = np.arange(1200)
    u = sum(np.cos(2 * np.pi * f * t + k) for k, f in enumerate(np.linspace(0.04, 0.07, 12)))
    y = lfilter([0, 0, 0, 1.0], np.poly([0.96, 0.94, 0.9]), u)
    data = IOData(u, y + 0.01 * np.std(y) * noise(1), 1.0)
    assert direction(data) == -1
    assert not confirmed(data, -1)
    assert gain_remarks(data, data, -y, np.array([0.0, 1.0])) == []
    good = IOData(held(1), lfilter([0, 0.3], [1, -0.7], held(1)), 1.0)
    assert confirmed(good, 1)


def sound(sign: float = 1.0) -> tuple[IOData, IOData]:
    u = held(3)
    y = sign * lfilter([0, 0.3], [1, -0.7], u)
    return quick_start(IOData(u, y + 0.02 * noise(3), 0.1, u_name="voltage", y_name="angle", u_unit="V", y_unit="rad"))


def mirrored(estimation: IOData, validation: IOData):
    """An evaluation of a model of the plant with the other sign."""
    turned = [replace(part, y=-part.y) for part in (estimation, validation)]
    setting = Setting(OutputError(1, 1, 1), starts=1)
    fit = evaluate(setting, *turned).fit
    return evaluate_fit(setting, fit, estimation, validation)


def test_a_model_of_the_other_sign_is_told_off_and_a_good_one_is_not():
    e = mirrored(*sound())
    wrong = [note for note in e.notes if WRONG in note]
    assert len(wrong) == 2
    assert "in the estimation data angle rises when voltage rises" in wrong[0]
    gain = float(re.search(r"(\S+) deg/V, has", wrong[1])[1])
    assert gain == pytest.approx(np.degrees(-1.0), rel=0.005)
    assert WRONG not in " ".join(evaluate(Setting(OutputError(1, 1, 1), starts=1), *sound(-1.0)).notes)


def test_passed_tests_do_not_vouch_for_a_model_that_fits_nothing():
    e = mirrored(*sound())
    assert e.validation_fit < 0
    tests = residual_tests(noise(1), noise(2))
    assert tests.white
    assert tests.independent
    for given, fit, said in ((tests, -212.0, True), (tests, 40.0, False), (tests, 90.0, False)):
        words = in_words(replace(e, tests=given, validation_fit=fit))
        assert ("does not vouch for the model" in words) is said
        assert f"(residuals: autocorrelation beyond its 99 % bound at {given.whiteness_outside} of 25 lags" in words
        assert ("−212.00 %" in words) is said
    slow = residual_tests(lfilter([1], [1, -0.95], noise(1)), noise(2))
    assert not slow.white
    assert slow.independent
    words = in_words(replace(e, tests=slow, validation_fit=30.0))
    assert "does not vouch" in words
    assert "what is left is noise with memory (residuals: " in words
    assert "as large as the output" not in words  # which is a fit of 0 %


@pytest.mark.parametrize(
    ("recipe", "todo"),
    [
        (OutputError(1, 1, 1), "lower the orders or inspect"),
        (Hammerstein(1, 1, 1, "dead_zone"), "lower the orders, choose smaller maps or inspect"),
    ],
)
def test_parts_that_differ_want_smaller_maps_only_of_a_model_with_maps(recipe, todo):
    data, other = (IOData(noise(1), lfilter([0, g], [1, -0.5], noise(1)), 0.1) for g in (1.0, 2.0))
    (note,) = (n for n in evaluate(Setting(recipe, starts=1), data, other).notes if "the two parts differ" in n)
    assert todo in note


def test_tests_that_both_fail_need_no_voucher():
    e = mirrored(*sound())
    neither = residual_tests(lfilter([1], [1, -0.95], noise(2)), noise(2))
    assert "vouch" not in in_words(replace(e, tests=neither, validation_fit=-212.0))
