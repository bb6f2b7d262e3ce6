"""Ensembles: the logs of single runs whatever the split, drawn parameters, and what goes wrong in one simulation."""

import math
import subprocess
import sys
import tempfile
from pathlib import Path

import mujoco
import numpy as np
import pytest
from ensembles import ensemble, same
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from mujoco.batch import MODEL_FIELDS, Batch, SimulationError
from often import FULL

from sysid.base.errors import InputError
from twin import Ensemble, Experiment
from twin.ensemble.draws import ROWS, WHOLE, Draws, whole_box
from twin.ensemble.members import COMPILED
from twin.hardware.linkage import end_angles
from twin.log import Log
from twin.parameters import JOINTS, Parameters
from twin.plant import stepping
from twin.plant.leg import bench
from twin.plant.stepping import attempt, step

DRAWS = Draws({"thigh.coulomb": 0.3, "thigh.stall_force": 0.2, "supply_voltage": 0.1}, ["adc_bits"], ["pot_supply"])
# A drawn drive, drawn models, all joints, and the position loop with its own noise.
CASES = {
    "seeds": (Experiment("shoulder", "aprbs", 1.5), None),
    "drawn": (Experiment("thigh", "aprbs", 1.5), DRAWS),
    "servo": (Experiment("shank", "sweep", 1.5, mode="servo", options={"half_period": 0.5}), DRAWS),
    "leg": (Experiment("leg", "aprbs", 1.5, Ts=0.05), DRAWS),
}
SIZE = 5


@pytest.fixture(scope="module")
def alone() -> dict[str, list[Log]]:
    """Every case's logs, each simulated by itself."""
    found = {}
    for name, (experiment, draws) in CASES.items():
        whole = Ensemble(experiment, range(3, 3 + SIZE), draws, "unused")
        found[name] = [whole.case(i).run() for i in range(SIZE)]
    return found


@given(name=st.sampled_from(list(CASES)), part=st.integers(1, SIZE + 1), threads=st.integers(1, 3), block=st.booleans())
@settings(max_examples=16, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_logs_are_those_of_single_runs_at_any_split(
    alone: dict[str, list[Log]], name: str, part: int, threads: int, block: bool
) -> None:
    experiment, draws = CASES[name]
    with tempfile.TemporaryDirectory() as folder, pytest.MonkeyPatch.context() as patch:
        if block:  # of few steps: the cuts fall elsewhere
            patch.setattr(stepping, "BLOCK", 2**14)
        logs = list(Ensemble(experiment, range(3, 3 + SIZE), draws, folder, part).run(threads))
    assert len(logs) == SIZE
    for number, (log, single) in enumerate(zip(logs, alone[name], strict=True)):
        assert same(log, single)
        assert log.meta == {**single.meta, "number": number, "trouble": ""}
        assert (log.joint, log.Ts) == (single.joint, single.Ts)


def test_table_has_a_row_an_experiment(tmp_path: Path) -> None:
    experiment, draws = CASES["drawn"]
    whole = Ensemble(experiment, [5, 2, 9], draws, tmp_path).run()
    table = whole.table()
    assert table["number"].to_list() == [0, 1, 2]
    assert table["seed"].to_list() == [5, 2, 9]
    for number, log in enumerate(whole):
        row = table.row(number, named=True)
        assert (row["angle_min_rad"], row["angle_max_rad"]) == (log.y.min(), log.y.max())
        assert row["trouble"] == ""
        p = whole.case(number).p
        assert all(row[name] == p[name] for name in DRAWS.names)
        assert p.changed().keys() == set(DRAWS.names)


def model_fields(values: dict[str, float]) -> dict[str, np.ndarray]:
    model = bench("leg", Parameters(values))
    return {
        name: np.array(getattr(model.opt if name.startswith("opt.") else model, name.removeprefix("opt.")))
        for name in MODEL_FIELDS
    }


def moved_fields(values: dict[str, float]) -> set[str]:
    """The fields of the compiled leg that these values change."""
    nominal, changed = model_fields({}), model_fields(values)
    return {name for name in MODEL_FIELDS if not np.array_equal(nominal[name], changed[name])}


def test_rows_said_to_lie_outside_the_model_do_not_enter_it() -> None:
    outside = [row for row in ROWS.values() if not row.compiled]
    assert {row.name for row in outside} | set(COMPILED) == set(ROWS)
    for side in ("lower", "upper"):
        assert moved_fields({row.name: getattr(row, side) for row in outside}) == set()


@pytest.mark.parametrize("name", COMPILED)
def test_rows_said_to_enter_the_model_do(name: str) -> None:
    row = ROWS[name]
    assert moved_fields({name: row.nominal + 0.02 * (row.upper - row.nominal)})


def test_uniform_draws_fill_the_bounds_evenly() -> None:
    n, base = 2000, Parameters()
    draws = Draws({"thigh.coulomb": 0.2}, ["gravity", "pwm_bits"], ["thigh.stall_force"], seed=3)
    drawn = [draws.draw(base, i).parameters for i in range(n)]
    row = ROWS["thigh.stall_force"]
    shares = {
        "thigh.coulomb": [(p["thigh.coulomb"] - 24.0) / 12.0 for p in drawn],
        "gravity": [p["gravity"] / 20.0 for p in drawn],
        "thigh.stall_force": [
            math.log(p["thigh.stall_force"] / row.lower) / math.log(row.upper / row.lower) for p in drawn
        ],
    }
    for values in shares.values():
        assert 0 <= min(values) <= max(values) <= 1
        # Kolmogorov and Smirnov's distance of n uniform numbers, 1.95 / sqrt(n) in one case of 1000
        steps = np.arange(1, n + 1) / n
        assert np.abs(np.sort(values) - steps).max() < 1.95 / math.sqrt(n)
    assert {p["pwm_bits"] for p in drawn} == set(range(4, 17))
    assert all(p.changed().keys() <= set(draws.names) for p in drawn)


def test_a_rows_draw_depends_on_its_number_and_seed_alone() -> None:
    base = Parameters()
    few, many = Draws(uniform=["gravity"]), Draws(uniform=["gravity", "thigh.coulomb", "delay"])
    first = [few.draw(base, i).parameters["gravity"] for i in range(5)]
    assert first == [many.draw(base, i).parameters["gravity"] for i in range(5)]
    assert len(set(first)) == 5
    assert first != [Draws(uniform=["gravity"], seed=1).draw(base, i).parameters["gravity"] for i in range(5)]


def test_draws_that_are_no_leg_are_drawn_again_and_counted() -> None:
    box, again = whole_box(), 0
    for i in range(50):
        drawn = box.draw(Parameters(), i)
        assert drawn == box.draw(Parameters(), i)
        for joint in JOINTS:
            end_angles(drawn.parameters, joint)  # raises for what is no leg
        again += drawn.redrawn
        assert all(float(drawn.parameters[name]).is_integer() for name in WHOLE)
    assert again > 0


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        ({"uniform": "gravity"}, "is the string 'gravity'; give a list"),
        ({"uniform": ["colour"]}, "unknown parameter 'colour'"),
        ({"spread": {"gravity": -0.1}}, "the spread of gravity is -0.1"),
        ({"spread": {"gravity": float("nan")}}, "the spread of gravity is nan"),
        ({"spread": {"gravity": 0.1}, "uniform": ["gravity"]}, "gravity is given in two ways of drawing"),
        ({"log_uniform": ["gravity"]}, "the lower bound of gravity is 0, which has no logarithm"),
        ({"seed": -1}, "seed of the draws is -1"),
    ],
)
def test_bad_draws_are_refused(arguments: dict, says: str) -> None:
    with pytest.raises(InputError, match=says):
        Draws(**arguments)


@pytest.mark.parametrize(
    ("changes", "says"),
    [
        ({"experiment": "thigh"}, "experiment is a str; give a twin.Experiment"),
        ({"draws": {"gravity": 0.1}}, "draws is a dict"),
        ({"draws": Draws({"thigh.servo_ki": 0.1})}, "thigh.servo_ki is 0, so a relative spread has no effect"),
        ({"seeds": []}, "there are no seeds"),
        ({"seeds": [1, -1]}, "a seed is -1"),
        ({"seeds": [1.5]}, "a seed is 1.5"),
        ({"part": 0}, "part is 0"),
    ],
)
def test_bad_ensembles_are_refused_before_the_run(tmp_path: Path, changes: dict, says: str) -> None:
    with pytest.raises(InputError, match=says):
        ensemble(tmp_path, **changes)
    assert not list(tmp_path.iterdir())


def test_bad_calls_are_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="threads is -1"):
        ensemble(tmp_path).run(-1)
    with pytest.raises(InputError, match="experiment 4 is not in the ensemble; give a number from 0 to 3"):
        ensemble(tmp_path).case(4)
    with pytest.raises(InputError, match="has no ensemble yet"):
        ensemble(tmp_path / "new").table()


def test_an_experiment_on_which_mujoco_gives_up_is_a_row(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)  # where MuJoCo writes its own log
    prepare = Experiment.prepare

    def poisoned(self: Experiment, model: mujoco.MjModel | None = None) -> stepping.Run:
        run = prepare(self, model)
        if self.seed == 1:
            run.qpos[:] = np.nan
        if self.seed == 2:
            raise InputError("no such signal")
        return run

    monkeypatch.setattr(Experiment, "prepare", poisoned)
    whole = ensemble(tmp_path / "runs").run()
    trouble = whole.table()["trouble"].to_list()
    assert trouble[0] == trouble[3] == ""
    assert trouble[1].startswith("MuJoCo stopped: Nan, Inf or huge value in QPOS")
    assert trouble[2] == "no such signal"
    logs = list(whole)
    monkeypatch.setattr(Experiment, "prepare", prepare)
    assert all(same(logs[i], whole.case(i).run()) for i in (0, 3))
    assert all(np.isnan(logs[i].y).all() and np.isnan(logs[i].y_true).all() for i in (1, 2))
    assert [log.meta["trouble"] for log in logs] == trouble


def test_an_error_in_one_simulation_is_not_the_others(monkeypatch: pytest.MonkeyPatch) -> None:
    runs = [Experiment("thigh", "aprbs", 1.0, seed=seed).prepare() for seed in range(3)]
    whole = step(runs, 0.1, 0.5)

    class Failing(Batch):
        def rollout(self, *arguments, **options):
            found = super().rollout(*arguments, **options)
            if 1 in options["ids"]:
                raise SimulationError(np.array([1]), "out of memory")
            return found

        def error(self, sim: int) -> str:
            return "out of memory"

    monkeypatch.setattr(stepping, "Batch", Failing)
    monkeypatch.setattr(stepping, "BLOCK", 2**14)
    shown, trouble = attempt(runs, 0.1, 0.5)
    assert trouble == ["", "MuJoCo stopped: out of memory", ""]
    assert np.isnan(shown[1]).all()
    assert np.array_equal(shown[[0, 2]], whole[[0, 2]])
    with pytest.raises(SimulationError, match=r"in 1 of 3 simulations \(1\); .* out of memory"):
        step(runs, 0.1, 0.5)


LARGEST = """
import resource, sys
from twin import Ensemble, Experiment
from twin.ensemble.draws import Draws
draws = Draws({"thigh.coulomb": 0.3})
whole = Ensemble(Experiment("thigh", "aprbs", 1.0), range(int(sys.argv[1])), draws, sys.argv[2], 16).run(2)
assert sum(log.N for log in whole) == 10 * len(whole)
print(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss)
"""


@pytest.mark.nightly
@pytest.mark.slow
@pytest.mark.skipif(sys.platform != "linux", reason="counts memory as Linux does")
def test_memory_does_not_grow_with_the_ensemble(tmp_path: Path) -> None:
    def kilobytes(n: int) -> int:
        command = [sys.executable, "-c", LARGEST, str(n), str(tmp_path / str(n))]
        return int(subprocess.run(command, capture_output=True, text=True, check=True).stdout)

    few, many = (500, 2000) if FULL else (100, 400)
    # 300 models and logs more are 10 MB and more; what is allowed is what allocators keep back.
    assert kilobytes(many) < kilobytes(few) + 8_000
