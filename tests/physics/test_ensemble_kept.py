"""An ensemble's folder: of another ensemble, changed by somebody, in use, after a kill and on a full disk."""

import errno
import json
import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import polars
import pytest
from ensembles import ensemble, same

from sysid.base.errors import InputError
from twin.ensemble.draws import Draws
from twin.ensemble.ensemble import Ensemble
from twin.experiment import Experiment
from twin.parameters import Parameters

HOLD = """
import sys, time
from sysid.base.locks import file_lock
with file_lock(sys.argv[1], str):
    print("held", flush=True)
    time.sleep(100)
"""


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    return Ensemble(Experiment("thigh", "aprbs", 1.0), range(4), None, tmp_path_factory.mktemp("ens") / "e", 2).run(1)


@pytest.fixture
def whole(finished, tmp_path):
    """A finished ensemble of four in two parts, in a folder of its own."""
    shutil.copytree(finished.folder, tmp_path / "e")
    return Ensemble(finished.experiment, range(4), None, tmp_path / "e", 2)


@pytest.mark.parametrize("changed", [{"part": 3}, {"rows": 40}])
def test_a_manifest_changed_by_hand_is_refused(whole, changed):
    manifest = whole.folder / "manifest.json"
    manifest.write_text(json.dumps(json.loads(manifest.read_text()) | changed))
    for use in (whole.table, whole.run):
        with pytest.raises(InputError, match="is damaged or not from an ensemble"):
            use()


def test_a_manifest_of_an_older_version_is_read(whole):
    manifest = whole.folder / "manifest.json"
    found = json.loads(manifest.read_text())
    assert found.pop("check", None)
    manifest.write_text(json.dumps(found))
    assert whole.run().table()["number"].to_list() == [0, 1, 2, 3]


def test_a_part_with_the_rows_of_another_is_named(whole):
    shutil.copy(whole.folder / "part-00000.parquet", whole.folder / "part-00001.parquet")
    with pytest.raises(InputError, match=r"part-00001\.parquet .*other rows.*delete this file and run"):
        whole.table()
    with pytest.raises(InputError, match="other rows"):
        list(whole)
    (whole.folder / "part-00001.parquet").unlink()
    assert whole.run(1).table()["number"].to_list() == [0, 1, 2, 3]


@pytest.mark.skipif(os.name != "posix", reason="Windows has no such locks")
def test_a_second_run_is_told_of_the_first_and_what_is_finished_can_be_read(whole):
    first = subprocess.Popen([sys.executable, "-c", HOLD, str(whole.folder)], stdout=subprocess.PIPE, text=True)
    try:
        assert first.stdout.readline() == "held\n"
        assert whole.run().table().height == 4  # nothing is missing, so nothing is written
        part = whole.folder / "part-00001.parquet"
        kept = part.rename(part.with_name("kept"))
        with pytest.raises(InputError, match=rf"process {first.pid}\b.*another folder"):
            whole.run(1)
        assert not part.exists()
        kept.unlink()
    finally:
        first.send_signal(signal.SIGKILL)
        first.communicate()
    assert whole.run(1).table().height == 4  # the lock ends with its process
    assert sorted(path.name for path in whole.folder.iterdir()) == [
        "manifest.json",
        "part-00000.parquet",
        "part-00001.parquet",
    ]


def test_a_part_of_another_ensemble_is_refused(whole, tmp_path):
    other = Ensemble(whole.experiment, range(10, 14), None, tmp_path / "other", 2).run(1)
    shutil.copy(other.folder / "part-00001.parquet", whole.folder)
    for use in (whole.table, lambda: list(whole)):
        with pytest.raises(InputError, match=r"part-00001.*rows of another ensemble\); delete this file and run"):
            use()


@pytest.mark.parametrize("changed", [{"duration": 2.0}, {"without": ("friction",)}, {"options": {"amplitude": 6.0}}])
def test_a_part_of_another_experiment_with_the_same_seeds_is_refused(whole, tmp_path, changed):
    other = Ensemble(replace(whole.experiment, **changed), range(4), None, tmp_path / "other", 2).run(1)
    shutil.copy(other.folder / "part-00001.parquet", whole.folder)
    for use in (whole.table, lambda: list(whole)):
        with pytest.raises(InputError, match=r"part-00001.*rows of another ensemble\); delete this file and run"):
            use()


def test_a_part_with_other_draws_is_refused(finished, tmp_path):
    spread = {"thigh.coulomb": 0.3}
    own, other = (
        Ensemble(finished.experiment, range(2), Draws(spread, seed=seed), tmp_path / f"{seed}", 1).run(1)
        for seed in (1, 2)
    )
    assert own.table()["seed"].to_list() == [0, 1]
    assert len(list(own)) == 2
    shutil.copy(other.folder / "part-00001.parquet", own.folder)
    with pytest.raises(InputError, match="rows of another ensemble"):
        own.table()


@pytest.mark.parametrize("column", ["seed", "redrawn", "angle_min_rad"])
def test_text_among_the_numbers_of_a_part_is_refused(whole, column):
    part = whole.folder / "part-00001.parquet"
    polars.read_parquet(part).with_columns(polars.lit("a").alias(column)).write_parquet(part)
    with pytest.raises(InputError, match="delete"):
        whole.table()


@pytest.mark.parametrize("meta", ["{", "[1]", None, "7"])
@pytest.mark.parametrize("row", [0, 1])
def test_a_damaged_header_in_a_part_is_refused(finished, tmp_path, meta, row):
    ensemble = Ensemble(finished.experiment, range(3), None, tmp_path / "e", 3).run(1)
    part = ensemble.folder / "part-00000.parquet"
    found = polars.read_parquet(part)
    texts = [meta if k == row else text for k, text in enumerate(found["meta"])]
    found.with_columns(polars.Series("meta", texts, dtype=polars.String)).write_parquet(part)
    with pytest.raises(InputError, match=rf"part-00000.parquet has a damaged meta in row {row}; delete this file"):
        list(ensemble)


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
