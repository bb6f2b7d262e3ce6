"""An ensemble's folder that somebody changed, or that another process writes to."""

import json
import os
import shutil
import signal
import subprocess
import sys
from dataclasses import replace

import polars
import pytest

from sysid.base.errors import InputError
from twin.ensemble.draws import Draws
from twin.ensemble.ensemble import Ensemble
from twin.experiment import Experiment

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
