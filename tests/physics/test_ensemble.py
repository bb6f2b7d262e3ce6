"""Ensembles: the logs of single runs whatever the split, and a folder that survives kills and full disks."""

import errno
import json
import math
import os
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

import mujoco
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from mujoco.batch import MODEL_FIELDS, Batch, SimulationError

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

FULL = os.environ.get("QPAL_FULL") == "1"
DRAWS = Draws({"thigh.coulomb": 0.3, "thigh.stall_force": 0.2, "supply_voltage": 0.1}, ["adc_bits"], ["pot_supply"])
# A drawn drive, drawn models, all joints, and the position loop with its own noise.
CASES = {
    "seeds": (Experiment("shoulder", "aprbs", 1.5), None),
    "drawn": (Experiment("thigh", "aprbs", 1.5), DRAWS),
    "servo": (Experiment("shank", "sweep", 1.5, mode="servo", options={"half_period": 0.5}), DRAWS),
    "leg": (Experiment("leg", "aprbs", 1.5, Ts=0.05), DRAWS),
}
SIZE = 5


def same(a: Log, b: Log) -> bool:
    return all(np.array_equal(getattr(a, name), getattr(b, name), equal_nan=True) for name in ("u", "y", "y_true"))


def ensemble(folder: Path, n: int = 4, **changes) -> Ensemble:
    settings = {"experiment": Experiment("thigh", "aprbs", 1.0), "seeds": range(n), "draws": None, "part": 2}
    return Ensemble(**(settings | {"folder": folder} | changes))


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


@pytest.mark.parametrize(
    ("changes", "says"),
    [
        ({"seeds": range(1, 5)}, "differs in seeds"),
        ({"experiment": Experiment("shank", "aprbs", 1.0)}, "differs in joint"),
        ({"experiment": Experiment("thigh", "aprbs", 1.0, options={"amplitude": 6.0})}, "differs in options, signals"),
        ({"draws": Draws({"gravity": 0.1})}, "differs in draws, draws_seed"),
    ],
)
def test_a_folder_of_another_ensemble_is_refused(tmp_path: Path, changes: dict, says: str) -> None:
    ensemble(tmp_path).run()
    before = {path: path.read_bytes() for path in tmp_path.iterdir()}
    with pytest.raises(InputError, match=f"has another ensemble, which {says}; choose another folder"):
        ensemble(tmp_path, **changes).run()
    assert {path: path.read_bytes() for path in tmp_path.iterdir()} == before


def test_other_folders_are_refused(tmp_path: Path) -> None:
    (tmp_path / "thesis.tex").write_text("text")
    with pytest.raises(InputError, match=r"has no manifest\.json; choose an empty or a new folder"):
        ensemble(tmp_path).run()
    whole = ensemble(tmp_path / "new").run()
    manifest = tmp_path / "new" / "manifest.json"
    found = json.loads(manifest.read_text())
    assert found["description"]["parameters"] == dict(Parameters().values)
    assert found["description"]["signals"][0]["amplitude"] == 12.0
    manifest.write_text(json.dumps(found | {"versions": {"mujoco": "3.0.0"}}))
    assert whole.table().height == 4  # finished: it can be read
    (tmp_path / "new" / "part-00001.parquet").unlink()
    with pytest.raises(InputError, match=r"was started with .*mujoco 3\.0\.0 and now"):
        whole.run()
    for text in ("{", "[]", json.dumps(found | {"fingerprint": "0"})):
        manifest.write_text(text)
        with pytest.raises(InputError, match="is damaged or not from an ensemble"):
            whole.run()


def test_a_damaged_part_is_named(tmp_path: Path) -> None:
    whole = ensemble(tmp_path).run()
    path = tmp_path / "part-00001.parquet"
    path.write_bytes(path.read_bytes()[:100])
    with pytest.raises(InputError, match=r"part-00001\.parquet cannot be read .* delete this file and run"):
        whole.table()


KILLED = """
import sys
from twin import Ensemble, Experiment
from twin.ensemble.draws import Draws
Ensemble(Experiment("thigh", "aprbs", 5.0), range(60), Draws({"thigh.coulomb": 0.3}), sys.argv[1], 3).run(1)
"""


def test_a_killed_run_goes_on_where_it_was(tmp_path: Path) -> None:
    child = subprocess.Popen([sys.executable, "-c", KILLED, str(tmp_path)])
    deadline = time.monotonic() + 120
    while len(list(tmp_path.glob("part-*"))) < 2 and time.monotonic() < deadline:
        time.sleep(0.01)
    child.send_signal(signal.SIGKILL)
    assert child.wait() == -signal.SIGKILL  # it was not done yet
    kept = {path: path.stat().st_mtime_ns for path in tmp_path.glob("part-*")}
    assert 2 <= len(kept) < 20
    (tmp_path / ".part-00019.parquet.1").write_bytes(b"half")  # as a kill within a write leaves it
    whole = Ensemble(Experiment("thigh", "aprbs", 5.0), range(60), Draws({"thigh.coulomb": 0.3}), tmp_path, part=7)
    assert whole.table().height == 3 * len(kept)
    said: list[tuple[int, int]] = []
    whole.run(2, lambda done, total: said.append((done, total)))
    assert said == [(3 * k, 60) for k in range(len(kept) + 1, 21)]  # in the parts of before
    assert {path: path.stat().st_mtime_ns for path in kept} == kept
    assert sorted(path.name for path in tmp_path.iterdir()) == [
        "manifest.json",
        *(f"part-{k:05d}.parquet" for k in range(20)),
    ]
    for number, log in enumerate(whole):
        if number % 13 == 0:
            assert same(log, whole.case(number).run())
    assert number == 59


def test_a_full_disk_is_a_sentence(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    whole, sync, calls = ensemble(tmp_path, n=6), os.fsync, []

    def full(handle: int) -> None:
        calls.append(handle)
        if len(calls) > 2:  # the manifest and a part
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        sync(handle)

    monkeypatch.setattr("os.fsync", full)
    with pytest.raises(
        InputError, match=r"part-00001.parquet cannot be written \(No space left on device\); the 1 part"
    ):
        whole.run()
    assert sorted(path.name for path in tmp_path.iterdir()) == ["manifest.json", "part-00000.parquet"]
    monkeypatch.undo()
    assert whole.table().height == len(list(whole)) == 2
    assert whole.run().table().height == 6


@pytest.fixture
def small_disk(tmp_path: Path) -> Iterator[Path]:
    place = tmp_path / "disk"
    place.mkdir()
    mounted = subprocess.run(["mount", "-t", "tmpfs", "-o", "size=64k", "tmpfs", str(place)], capture_output=True)
    if mounted.returncode:
        pytest.skip("only an administrator can make a small disk")
    yield place
    subprocess.run(["umount", str(place)], check=True)


@pytest.mark.skipif(sys.platform != "linux", reason="needs a tmpfs")
def test_a_disk_that_is_full_in_truth(small_disk: Path) -> None:
    whole = ensemble(small_disk / "runs", n=30, part=3)
    with pytest.raises(InputError, match="No space left on device"):
        whole.run()
    kept = sorted(path.name for path in (small_disk / "runs").iterdir())
    assert kept[0] == "manifest.json"
    assert 1 < len(kept) < 11
    assert all(name.startswith("part-") for name in kept[1:])
    assert same(next(iter(whole)), whole.case(0).run())


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
