"""Whether runs of one leg agree, on linear problems with known answers, and values that each run has of its own."""

from types import SimpleNamespace

import numpy as np
import pytest
from scipy.stats import norm

import twin
from sysid.base.errors import InputError
from sysid.base.parallel import one_blas_thread
from twin.calibrate.agreement import CHANCE, agreement
from twin.calibrate.calibration import calibrate
from twin.calibrate.problem import Free, Record, Simulations
from twin.calibrate.result import Calibration
from twin.log import Log
from twin.report.agreement import sentences

TS, N, NOISE = 0.05, 400, 0.02


@pytest.fixture(scope="module", autouse=True)
def one_thread():
    with one_blas_thread():
        yield


def legs(rng, runs, changes=0.0, bent=0.1):
    """Runs of a response a y + b y^3 + own offset, where y goes to and fro; all bend alike over place, which no
    parameter explains. `changes` (runs,) are those of a from run to run."""
    records = []
    for k, change in enumerate(np.broadcast_to(changes, runs)):
        y = np.sin(np.cumsum(rng.uniform(0.5, 1.5) * TS * np.ones(N)) + rng.uniform(0.0, 6.0))
        columns = np.column_stack([y, y**3, np.ones(N)])
        measured = columns @ [1.0 + change, 0.5, 0.1] + bent * np.sin(5.0 * y) + NOISE * rng.standard_normal(N)
        own = (Free("c", 0.0, -50.0, 50.0, "1", 10.0),)
        records.append(Record(str(k), measured, TS, lambda values, columns=columns: values @ columns.T, own))
    return Simulations([Free(name, 0.0, -50.0, 50.0, "1", 10.0) for name in "ab"], records, NOISE)


def judged(task):
    """The agreement at the optimum of a linear problem."""
    e, J = task.linearise(task.start)
    p = task.start + np.linalg.lstsq(J, e, rcond=None)[0]
    e, J = task.linearise(p)
    return agreement(task, p, e, J, 0.95)


def test_runs_of_one_leg_are_called_different_as_seldom_as_is_said():
    rng = np.random.default_rng(1)
    rows = [row for _ in range(60) for row in judged(legs(rng, 3))]
    assert sum(row.differ for row in rows) <= 3  # CHANCE is 1 in 100 draws
    assert 0.05 < np.mean([row.chance < 0.1 for row in rows]) < 0.16
    assert CHANCE == 0.01


def test_a_run_with_another_value_is_called_odd_and_its_value_holds():
    rng, odd, held = np.random.default_rng(2), 0, 0
    for _ in range(20):
        which = int(rng.integers(4))
        a, b = judged(legs(rng, 4, 0.1 * (np.arange(4) == which)))
        odd += a.odd == which and a.rest_agrees and a.squares > b.squares
        held += a.low[which] - a.low[which - 1] > 0.0  # the interval of the odd run lies higher
    assert odd >= 18
    assert held >= 19


def test_two_runs_differ_as_by_ordinary_least_squares():
    """Without anything that the response lacks, the difference of two slopes beside a common b has a closed form."""
    task = legs(np.random.default_rng(3), 2, [0.0, 0.01], bent=0.0)
    a, _ = judged(task)
    first, second = (record.respond(np.eye(3)).T for record in task.records)
    none = np.zeros(N)
    X = np.vstack(
        [
            np.column_stack([first[:, 0], none, first[:, 1], first[:, 2], none]),
            np.column_stack([none, second[:, 0], second[:, 1], none, second[:, 2]]),
        ]
    )
    theta = np.linalg.lstsq(X, np.concatenate([record.y for record in task.records]), rcond=None)[0]
    contrast = np.array([-1.0, 1.0, 0.0, 0.0, 0.0])
    z = contrast @ theta / (NOISE * np.sqrt(contrast @ np.linalg.inv(X.T @ X) @ contrast))
    assert 3.0 < z < 10.0
    assert norm.isf(a.chance / 2) == pytest.approx(z, rel=0.1)
    assert float(np.diff(a.values)[0]) == pytest.approx(theta[1] - theta[0], rel=0.05)


def test_a_run_that_does_not_show_a_parameter_says_nothing():
    rng = np.random.default_rng(4)
    task = legs(rng, 3)
    blind = np.column_stack([np.zeros(N), np.zeros(N), np.ones(N)])
    y = 0.1 + NOISE * rng.standard_normal(N)
    still = Record("still", y, TS, lambda values: values @ blind.T, (Free("c", 0.0, -50.0, 50.0, "1", 10.0),))
    a, _ = judged(Simulations(task.shared, [*task.records, still], NOISE))
    assert a.told.tolist() == [True, True, True, False]
    assert not a.differ


def test_one_run_has_nothing_to_agree_with():
    assert judged(legs(np.random.default_rng(5), 1)) == ()


def test_the_words_name_the_odd_run_and_the_next_command():
    rng = np.random.default_rng(6)
    rows = judged(legs(rng, 3, [0.0, 0.2, 0.0]))
    first, *_, last = sentences(words_of(rows))
    assert first.startswith("The logs do not agree: a is 0.9")
    assert "tu.csv is farthest from the others; without it the others agree" in first
    assert "qpal calibrate mo.csv tu.csv 'we day.csv' --joint thigh --by-run a" in last
    assert sentences(words_of(judged(legs(rng, 3))))[0].startswith("The 3 logs agree: none of the 2 values")


def words_of(rows):
    """What a report needs of a calibration."""
    result = SimpleNamespace(agreements=rows, provenance={"logs": ["mo.csv", "tu.csv", "we day.csv"]})
    result.joint, result.by_run, result.differing = "thigh", {}, Calibration.differing.fget(result)
    return result


def test_each_run_may_have_its_own_zero_and_speed():
    """Two days of a shoulder: another supply and a sensor that was mounted anew; the friction is the same."""
    names, truth = ("coulomb",), (1.0, 0.93)
    logs = []
    for k, share in enumerate(truth):
        nominal = twin.Parameters()
        p = nominal.replace(
            {"shoulder.no_load_speed": share * nominal["shoulder.no_load_speed"], "shoulder.coulomb": 1.2}
        )
        options = {"half_period": 1.5, "first": 0.6, "shrink": 0.3}
        log = twin.Experiment("shoulder", "sweep", 8.0, 0.05, seed=k, parameters=p, options=options).run()
        logs.append(Log(log.u, log.y + np.deg2rad(1.5 * k), 0.05, None, "shoulder", {}))
    result = calibrate(logs, "shoulder", names=names, by_run=("no_load_speed", "zero"))
    nominal = twin.Parameters()["shoulder.no_load_speed"]
    for share, value in zip(truth, result.by_run["shoulder.no_load_speed"], strict=True):
        assert value.value == pytest.approx(share * nominal, rel=0.01)
    assert np.degrees(result.by_run["zero"][1].value) == pytest.approx(1.5, abs=0.1)
    assert result.by_run["zero"][0].value == 0.0
    assert result["coulomb"].value == pytest.approx(1.2, rel=0.1)
    assert result.parameters["shoulder.no_load_speed"] == pytest.approx(np.mean(truth) * nominal, rel=0.01)


def test_values_by_run_that_cannot_be_are_sentences():
    log = twin.Experiment("shoulder", "sweep", 4.0, 0.05, options={"half_period": 1.0}).run()
    with pytest.raises(InputError, match="give the logs of two runs"):
        calibrate([log], "shoulder", by_run=("zero",))
    with pytest.raises(InputError, match=r"both fixed and free in each run"):
        calibrate([log, log], "shoulder", fixed=("coulomb",), by_run=("coulomb",))
    with pytest.raises(InputError, match="parameter of the shoulder"):
        calibrate([log, log], "shoulder", by_run=("nothing",))
