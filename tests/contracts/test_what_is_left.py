"""A model is not called good beside an error that noise does not explain, although the input explains none of it."""

import re

import numpy as np
import pytest
from scipy.signal import lfilter

import sysid
from sysid import IOData
from sysid.report.answer import GOOD, POOR, USABLE
from sysid.report.identify_answer import answer
from sysid.structures import Armax, OutputError
from sysid.workflow.identification import identify_file
from sysid.workflow.setting import Setting
from sysid.workflow.what_is_left import MANY, left_of
from twin.cli import main

N = 1000
NOISE = 0.1


def noise(seed: int, n: int = N) -> np.ndarray:
    return NOISE * np.random.default_rng(seed).standard_normal(n)


def written(path: str, inputs: dict[str, np.ndarray], y: np.ndarray) -> str:
    header = ",".join(["t [s]", *inputs, "y [degC]"])
    rows = np.column_stack([np.arange(len(y)), *inputs.values(), y])
    np.savetxt(path, rows, delimiter=",", header=header, comments="", fmt="%.9g")
    return path


def levels(seed: int, low: float = -1.0, high: float = 1.0, hold: int = 40) -> np.ndarray:
    return np.repeat(np.random.default_rng(seed).uniform(low, high, N // hold), hold)


def lag(u: np.ndarray) -> np.ndarray:
    return 5.0 * lfilter([0.0, 0.05], [1.0, -0.95], u)


@pytest.fixture(autouse=True)
def in_a_folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)


def test_the_error_is_told_in_noises_of_a_reading():
    slow = 0.9 * np.sqrt(2.0) * np.sin(np.arange(N) / 40.0)
    left = left_of(IOData(u=levels(0), y=slow + noise(0), Ts=1.0), np.zeros(N), 0)
    assert left.noise == pytest.approx(NOISE, rel=0.1)
    assert left.times == pytest.approx(np.sqrt(9.0**2 + 1.0), rel=0.1)
    assert not left.constant("y", "")
    fine = left_of(IOData(u=levels(0), y=lag(levels(0)) + noise(0), Ts=1.0), lag(levels(0)), 0)
    assert not fine.many
    assert not fine.constant("y", "")


def test_the_rounding_of_a_reading_is_noise_of_it():
    y, step = 20.0 * lag(levels(1)), 0.3
    left = left_of(IOData(u=levels(1), y=np.round(y / step) * step, Ts=1.0), y, 0)
    assert left.noise >= 0.99 * step / np.sqrt(12.0)
    assert left.times < 1.5


@pytest.mark.parametrize("offsets", [(-1.5,), (-1.0, 1.0)])
def test_another_zero_is_told_as_a_constant(offsets):
    runs = [IOData(u=levels(k), y=lag(levels(k)) + noise(k) + c, Ts=1.0) for k, c in enumerate(offsets)]
    data = IOData.merge(*runs)
    said = left_of(data, np.concatenate([lag(levels(k)) for k in range(len(offsets))]), 2).constant("y", "degC")
    assert ("a constant −1.5" in said) is (len(offsets) == 1)
    assert ("a constant in each experiment, from −" in said) is (len(offsets) == 2)
    assert said.endswith("only noise")


def test_a_tank_that_a_line_does_not_follow_is_usable_and_another_structure_is_named():
    """Level of a tank with a pump and a valve: what flows out is the valve times the root of the level."""
    pump, valve, h, y = levels(2, 35.0, 75.0, 50), levels(3, 40.0, 70.0, 50), 30.0, []
    for p, v in zip(pump, valve, strict=True):
        y.append(h)
        for _ in range(10):
            h = max(h + 0.1 * (0.02 * p - 0.0036 * v * np.sqrt(h)), 0.0)
    path = written("tank.csv", {"pump [%]": pump, "valve [%]": valve}, np.array(y) + noise(4))
    given = {"input": "pump [%],valve [%]", "output": "y [degC]"}
    result = identify_file(path, Setting(OutputError(1, 1, 1), starts=1), **given)
    e, said = result.evaluation, answer(result)
    assert e.judged_fit >= 80.0
    left = left_of(e.validation, e.validation_output, e.fit.n_init)
    assert left.size > MANY * left.noise
    assert said.word == USABLE
    assert "times the noise of a reading" in said.sentence
    assert "--structure hammerstein_wiener" in said.next or "--structure state_space" in said.next


def test_a_right_model_under_coloured_noise_of_the_size_of_a_reading_is_good_with_and_without_a_search():
    """Its residuals have memory, which no structure explains: the word does not depend on a search that was made."""
    u = levels(5, hold=10)
    y = lag(u) + lfilter([1.0], [1.0, -0.6], noise(6))
    result = identify_file(written("a.csv", {"u [V]": u}, y), Setting(OutputError(1, 1, 1), starts=1))
    assert not result.evaluation.tests.white
    assert "--structure auto" not in answer(result).next
    assert answer(result).word == GOOD


def test_a_saved_model_on_a_record_with_another_zero(capsys):
    for name, seed, zero in (("mon.csv", 7, 20.0), ("tue.csv", 8, 18.5)):
        written(name, {"u [V]": levels(seed)}, 4.0 * lag(levels(seed)) + zero + noise(seed))
    given = ["--structure", "output_error", "--orders", "1,1,1", "--starts", "1", "--trials", "0", "--out", "m"]
    assert main(["identify", "mon.csv", *given]) == 0
    assert "● good" in capsys.readouterr().out
    assert main(["run", "m/model.json", "tue.csv", "--out", "r"]) == 0
    said = " ".join(capsys.readouterr().out.split())
    assert "◐ usable: of the record" in said
    assert re.search(r"The error is a constant −1\.[45]\d* degC: another zero; apart from it only noise\.", said)


def test_a_constant_with_more_than_noise_beside_it_may_be_no_zero():
    """A slow error beside a constant: the model may lack something; with noise alone beside it, it is a zero."""
    slow = 0.4 * np.sin(np.arange(N) / 40.0)
    for error, slowly in ((2.0 + slow, True), (np.full(N, 2.0), False)):
        said = left_of(IOData(u=levels(0), y=error + noise(0), Ts=1.0), np.zeros(N), 0).constant("y", "degC")
        assert float(re.match(r"the error is a constant (\S+) degC", said)[1]) == pytest.approx(2.0, abs=0.1)
        assert ("or something slow that the model lacks" in said) == slowly


@pytest.mark.parametrize("offset", ["free", "each"])
def test_the_difference_between_logs_is_nothing_that_a_model_explains(capsys, offset):
    """Noise about three levels, beside an input that does nothing: 97 % about the common mean, about none of each."""
    zeros = (0.0, 50.0, -30.0)
    logs = [written(f"w{k}.csv", {"u": levels(k)}, zero + 10.0 * noise(10 + k)) for k, zero in enumerate(zeros)]
    options = ["--structure", "output_error", "--orders", "1,1,1", "--starts", "1", "--offset", offset]
    main(["identify", *logs, *options, "--trials", "0", "--out", "o"])
    out = capsys.readouterr().out
    number, mark = re.match(r"(−?\d+\.\d+) % (\S+ \w+)", out).groups()
    assert POOR in mark
    assert abs(float(number.replace("−", "-"))) < 10.0
    fit, tables = sysid.load("o/model.json"), [np.loadtxt(log, delimiter=",", skiprows=1) for log in logs]
    parts = [IOData(table[:, 1], table[:, 2], fit.Ts) for table in tables]
    merged, each = fit.fit_percent(IOData.merge(*parts)), [fit.fit_percent(part) for part in parts]
    assert min(each) - 0.1 < merged < max(each) + 0.1  # as of one log at a time


def test_a_model_that_follows_each_of_several_logs_is_good(capsys):
    logs = [written(f"g{k}.csv", {"u": levels(k)}, 40.0 * k + lag(levels(k)) + noise(k)) for k in range(3)]
    options = ["--structure", "output_error", "--orders", "1,1,1", "--starts", "1", "--offset", "each"]
    main(["identify", *logs, *options, "--trials", "0", "--out", "o"])
    first, *rest = capsys.readouterr().out.splitlines()
    assert GOOD in first
    (note,) = [line for line in rest if "levels of the outputs differ" in line]
    assert note.endswith("where each file has a zero of its own, --offset each gives it one.")


@pytest.mark.parametrize("drift", [0.0, 3.0])
def test_a_prediction_of_an_unstable_plant_is_not_good_beside_a_slow_error(drift):
    """A pole at 1.02, held by feedback of readings whose zero drifts by some of their noise, later."""
    rng, goal, x = np.random.default_rng(5), levels(6, -4.0, 4.0, hold=100), 0.0
    u, y = np.zeros(N), np.zeros(N)
    zero = np.interp(np.arange(N), [0, N // 2, N], [0.0, 0.0, drift * 0.02])
    for k in range(N):
        y[k] = x + zero[k] + 0.02 * rng.standard_normal()
        u[k] = 3.0 * (goal[k] - y[k]) + 0.3 * rng.standard_normal()
        x = 1.02 * x + 0.03 * u[k]
    path = written("held.csv", {"u [V]": u}, y)
    said = answer(identify_file(path, Setting(Armax(1, 1, 1), starts=1)))
    assert said.word == (USABLE if drift else GOOD)
    assert ("error one step ahead is" in said.sentence) is bool(drift)
    assert ("times that on the estimation data" in said.sentence) is bool(drift)
