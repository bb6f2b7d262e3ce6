"""A row's numbers, from models whose errors are known beforehand."""

import json
from dataclasses import dataclass

import numpy as np
import pytest
import scipy.signal

import sysid
from sysid.base.criteria import fit_percent
from sysid.base.poles import pairs
from sysid.bench import cell
from sysid.bench.cell import Cell
from sysid.bench.contract import Data
from sysid.bench.method import FunctionMethod
from sysid.bench.methods import library
from sysid.bench.scenarios import TABLE as FAMILIES
from sysid.bench.task import Task, Truth
from sysid.blocks import Saturation, TransferFunction
from sysid.data.record import IOData
from sysid.model.chain import Chain
from sysid.selection.table import BLOCKS, Row, Selection
from sysid.structures import OutputError

POLES = np.array([0.9, 0.7 + 0.2j, 0.7 - 0.2j])


@dataclass(frozen=True)
class Known:
    """A saturated lag with a given run of errors on two tests; `make` is the same for every seed."""

    name: str = "known"
    about: str = ""

    def scenarios(self):
        return ["lag"]

    def make(self, scenario, seed):
        chain = Chain((Saturation(role="input"), TransferFunction(1, 1, 0)))
        theta = np.array([-0.5, 0.8, 0.2, -0.8, 0.0])
        rng = np.random.default_rng(seed)
        parts = {}
        for name, N in (("train", 300), ("a", 200), ("b", 100)):
            u = rng.standard_normal(N)
            parts[name] = IOData(u, chain.simulate(theta, u) + 0.1 * (-1.0) ** np.arange(N), 0.5)
        clean = {k: chain.simulate(theta, parts[k].u[:, 0]) for k in "ab"}
        tests = {k: parts[k] for k in "ab"}
        truth = Truth(clean, 0.1, np.array([0.8 + 0j]), chain, theta)
        return Task(parts["train"], tests, 20, "V", (1, 1, 0), truth)


@dataclass(frozen=True)
class Shifted:
    """The true plant, its output shifted by `by`."""

    task: Task
    by: float
    poles: np.ndarray
    details: dict

    def simulate(self, u, y_init):
        assert len(y_init) == 20
        return self.task.truth.chain.simulate(self.task.truth.theta, u) + self.by


def row(by=0.0, poles=(0.8,), details=None):
    def fit(data, task):
        return Shifted(task, by, np.array(poles), details or {})

    return cell.run_cell(Cell(Known(), "lag", FunctionMethod("x", "", fit, sees_truth=True), 4, 5.0))


def test_errors_of_every_test_and_of_all_samples_together():
    found, task = row(by=0.3), Known().make("lag", 4)
    # noise of +-0.1 in turn and a shift of 0.3: the mean square is 0.1 over any even number of samples
    assert json.loads(found["errors"]) == pytest.approx({"a": np.sqrt(0.1), "b": np.sqrt(0.1)})
    assert found["rmse"] == pytest.approx(np.sqrt(0.1))
    expected = [100 * (1 - np.sqrt(0.1) / task.tests[k].y[20:, 0].std()) for k in "ab"]
    assert found["fit"] == pytest.approx(np.mean(expected))
    oracle = [fit_percent(task.tests[k].y[20:, 0], task.truth.y[k][20:]) for k in "ab"]
    assert found["oracle"] == pytest.approx(np.mean(oracle))
    assert found["noise"] == pytest.approx(0.01)


def test_map_error_is_that_of_the_steady_state():
    task = Known().make("lag", 4)
    spread = np.concatenate([task.truth.y[k] for k in "ab"]).std()
    assert row(by=0.3)["map_error"] == pytest.approx(0.3 / spread, rel=1e-9)
    u, y, ends = cell.staircase(task)
    np.testing.assert_allclose(y[ends], np.clip(u[ends], -0.5, 0.8), atol=2e-4)  # gain 0.2 / (1 - 0.8)


def test_pole_error_in_the_s_plane():
    assert row(poles=(0.3, 0.75))["pole_error"] == pytest.approx(abs(np.log(0.75) / np.log(0.8) - 1))
    assert row(poles=())["pole_error"] is None
    twisted = np.array([0.7 - 0.2j, 0.9, 0.7 + 0.2j])
    which, of = pairs(twisted, POLES)
    np.testing.assert_array_equal(twisted[which], POLES[of])
    assert cell.pole_error(np.array([0.5]), np.array([0.25]), 3.0) == pytest.approx(0.5)
    assert cell.pole_error(np.array([0.9]), POLES[:2], 1.0) == pytest.approx(np.nan, nan_ok=True)


def test_intervals_count_a_pair_once_and_a_real_pole_by_its_real_part():
    claims = np.array([[0.71, -0.2, 0.005, 0.1], [0.9, 0.0, 0.01, 0.0], [0.71, 0.2, 0.005, 0.1]])
    found = cell.interval_score(claims, POLES)
    assert (found["intervals"], found["held"]) == (3, 2)  # the real part of the pair misses by 0.01
    assert found["width"] == pytest.approx(
        np.median([0.01 / 0.1, 0.005 / np.hypot(0.3, 0.2), 0.1 / np.hypot(0.3, 0.2)])
    )
    assert cell.interval_score(np.array([[0.9, 0, np.nan, 0]]), np.array([0.9 + 0j]))["intervals"] == 0
    claimed = row(details={"intervals": {"pole": [[0.81, 0.0, 0.02, 0.0]]}})
    assert (claimed["intervals"], claimed["held"]) == (1, 1)


def test_missing_samples_are_not_scored():
    task = Known().make("lag", 4)
    missing = np.zeros((200, 1), dtype=bool)
    missing[50:60] = True
    y = task.tests["a"].y.copy()
    y[50:60] = np.nan
    holes = IOData(task.tests["a"].u, y, 0.5, missing=missing)
    hidden = Task(task.train, {"a": holes}, 20, "V", truth=Truth({"a": task.truth.y["a"]}, 0.1))
    from sysid.bench.method import Outcome

    found = cell.scores(hidden, Outcome("ok", {"a": task.truth.y["a"]}))
    assert found["rmse"] == pytest.approx(0.1)


def test_a_scenario_without_its_records_is_a_row():
    found = cell.run_cell(Cell(FAMILIES["drawn"], "none", FunctionMethod("x", "", abs), 0, 1.0))
    assert found["status"].startswith("no data: unknown scenario")
    assert found["fit"] is None


@pytest.mark.parametrize(
    "details",
    [
        {"poles": "abc"}, {"poles": [1, 2, 3]}, {"poles": [[np.nan, 0.0]]}, {"intervals": None}, {"intervals": [1.0]},
        {"intervals": {"pole": [None, None]}}, {"intervals": {"pole": [[1.0, 2.0]]}}, {"loss": "small"},
        {"loss": 10**400}, {"loss": [1.0, 2.0]}, {"stop": "\ud800"}, {"structure": object()},
    ],
)  # fmt: skip
def test_what_a_method_says_of_itself_never_ends_a_run(details, tmp_path):
    """The row is there, can be written and read, and keeps what was right."""
    from sysid.bench.table import COLUMNS, Table

    found = row(details=details)
    assert found["status"] == "ok"
    table = Table(tmp_path / "t.parquet")
    with table.writing():
        table.add({name: found[name] for name in COLUMNS})
    assert table.rows()["fit"].to_list() == pytest.approx([found["fit"]])


def test_poles_that_are_no_numbers_are_left_out():
    assert row(poles=(np.nan, 0.5))["pole_error"] is None
    assert row(poles=(np.inf,))["pole_error"] is None
    assert row(poles=(0.8,))["pole_error"] == pytest.approx(0.0)


@pytest.mark.parametrize("left", [0, 9])
def test_a_row_of_auto_tells_that_its_budget_ended_the_search(left, monkeypatch):
    """Two such rows may differ from machine to machine."""
    rng = np.random.default_rng(0)
    u = rng.standard_normal(200)
    y = scipy.signal.lfilter([0.0, 0.4], [1.0, -0.6], u)
    data = Data((u,), (y,), (np.zeros(200, dtype=bool),), 1.0, (1, 1, 1), 1e4, 0)

    def quick(data, seconds, **_):
        fit = sysid.fit(sysid.structures.output_error(1, 1, 1), data, starts=1)
        none = Row(OutputError(), 99.0, 3, 1, np.zeros(BLOCKS), True)
        return Selection((none,), none, fit, budget=seconds, left_out=left)

    monkeypatch.setattr(library, "select", quick)
    stop = library.auto(data).details["stop"]
    assert (stop == "the budget of 8000 s ended the search before 9 of its candidates") == bool(left)
