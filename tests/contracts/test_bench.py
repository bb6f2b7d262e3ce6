"""The benchmark's table and runner: no row is lost or repeated, whatever is killed."""

import json
import os
import signal
import subprocess
import sys
import time
from dataclasses import dataclass

import numpy as np
import polars as pl
import pytest
from cluster import cluster
from often import often

from sysid.base.errors import InputError
from sysid.base.files import seal
from sysid.bench import cell, suites
from sysid.bench.cell import Cell
from sysid.bench.method import FunctionMethod
from sysid.bench.methods import TABLE as METHODS
from sysid.bench.scenarios import TABLE as FAMILIES
from sysid.bench.table import BELONGS, COLUMNS, KEY, Table, read

SURE = [name for name in COLUMNS if name not in ("seconds", "memory")]
QUICK = ["--scenario", "drawn/output_error", "--method", "output_error", "--method", "from_truth", "--first", "5"]


@dataclass(frozen=True)
class Line:
    """y = a u, learnt from the first sample."""

    a: float

    def simulate(self, u, y_init):
        return self.a * u


def slow_line(data):
    time.sleep(0.1)
    return Line(float(data.y[0] @ data.u[0] / (data.u[0] @ data.u[0])))


def cells(count, fit=slow_line):
    return [
        Cell(FAMILIES["drawn"], "output_error", FunctionMethod("line", "", fit), seed, 9.0) for seed in range(count)
    ]


def bench(path, *more):
    return [sys.executable, "-m", "twin.cli", "bench", "run", *QUICK, "--out", str(path), *more]


@pytest.mark.nightly
@pytest.mark.parametrize("seed", often(2, 1))
def test_a_run_that_is_killed_goes_on_without_losing_or_repeating_a_row(tmp_path, seed):
    """SIGKILL at random moments, each time after another row; the table then equals that of a run in one piece."""
    rng, path = np.random.default_rng(seed), tmp_path / "b.parquet"
    command, before = bench(path, "--seeds", "12", "--workers", "1"), 0
    for _ in range(5):
        with subprocess.Popen(command, stderr=subprocess.PIPE) as running:
            deadline = time.monotonic() + 120.0
            while len(Table(path).row_keys()) == before and running.poll() is None and time.monotonic() < deadline:
                time.sleep(0.02)
            time.sleep(rng.uniform(0.0, 0.1))
            running.kill()
        done = len(Table(path).row_keys())
        assert before < done <= 24
        before = done
    subprocess.run(command, check=True, capture_output=True)
    rows = read(path)
    assert len(rows) == 24 == len(rows.unique(list(KEY)))
    assert not path.with_suffix(".journal").exists()
    whole = tmp_path / "whole.parquet"
    subprocess.run(bench(whole, "--seeds", "12", "--workers", "1"), check=True, capture_output=True)
    assert rows.select(SURE).equals(read(whole).select(SURE))


def test_a_row_in_journal_and_table_counts_once_and_half_a_line_not_at_all(tmp_path):
    table = Table(tmp_path / "t.parquet")
    with table.writing():
        for each in cells(3):
            table.add(cell.run_cell(each))
    rows = table.rows().to_dicts()
    journal = tmp_path / "t.journal"
    newer = rows[1] | {"fit": 12.5}
    journal.write_text(json.dumps(seal(newer, BELONGS)) + "\n" + json.dumps(rows[2] | {"seed": 77})[:-20])
    assert len(table.rows()) == 3  # killed between the table and the end of its journal
    assert table.rows().filter(pl.col("seed") == rows[1]["seed"])["fit"].to_list() == [12.5]
    assert cell.run_cells(cells(4), Table(table.path), 1) == 1  # as another process would
    assert len(table.rows()) == 4
    assert not journal.exists()


def test_two_runs_cannot_write_one_table(tmp_path):
    table = Table(tmp_path / "t.parquet")
    with table.writing(), pytest.raises(InputError, match="another run writes"):
        cell.run_cells(cells(1), Table(tmp_path / "t.parquet"), 1)
    assert cell.run_cells(cells(1), table, 1) == 1


def test_files_that_are_no_tables_are_refused(tmp_path):
    with pytest.raises(InputError, match=r"ends in \.parquet"):
        Table(tmp_path / "t.csv")
    with pytest.raises(InputError, match="qpal bench run"):
        read(tmp_path / "none.parquet")
    (tmp_path / "x.parquet").write_text("no")
    with pytest.raises(InputError, match="no results table"):
        read(tmp_path / "x.parquet")
    pl.DataFrame({"a": [1]}).write_parquet(tmp_path / "y.parquet")
    with pytest.raises(InputError, match="no column scenario"):
        read(tmp_path / "y.parquet")


def test_whatever_a_method_does_there_is_a_row(tmp_path):
    def crash(data):
        raise RuntimeError("out of luck")

    def short(data):
        class Half:
            def simulate(self, u, y_init):
                return u[: len(u) // 2]

        return Half()

    def never(data):
        while True:
            time.sleep(0.01)

    def wild(data):
        class Wild:
            def simulate(self, u, y_init):
                return np.full(len(u), np.nan)

        return Wild()

    said = []
    for fit in (crash, short, never, wild):
        row = cell.run_cell(Cell(FAMILIES["drawn"], "output_error", FunctionMethod("x", "", fit), 1, 0.1))
        assert list(row) == list(COLUMNS)
        said.append((row["status"], row["fit"]))
    assert said[0] == ("crashed: RuntimeError: out of luck", None)
    assert "1000 samples for 2000" in said[1][0]
    assert said[2][0].startswith("stopped after 0")
    assert said[3] == ("ok", -1e9)


def test_the_executor_gives_the_same_on_two_processes(tmp_path):
    chosen = suites.cells([suites.Part(("drawn/wiener",), ("from_truth", "wiener"), 2)], 20.0, FAMILIES, METHODS, 3)
    for workers in (1, 2):
        cell.run_cells(chosen, Table(tmp_path / f"{workers}.parquet"), workers)
    assert read(tmp_path / "1.parquet").select(SURE).equals(read(tmp_path / "2.parquet").select(SURE))


@pytest.mark.nightly
def test_a_cluster_that_loses_a_worker_loses_no_row(tmp_path):
    pytest.importorskip("distributed")
    with cluster(tmp_path) as (address, workers):
        _lose_one(tmp_path, address, workers)


def _lose_one(tmp_path, address, workers):
    table, path = Table(tmp_path / "c.parquet"), tmp_path / "c.journal"
    running = subprocess.Popen(
        bench(tmp_path / "c.parquet", "--seeds", "40", "--scheduler", address), stderr=subprocess.PIPE
    )
    deadline = time.monotonic() + 120.0
    while time.monotonic() < deadline and not (path.exists() and len(path.read_text().splitlines()) >= 10):
        assert running.poll() is None, running.stderr.read()
        time.sleep(0.02)
    os.kill(workers[0].pid, signal.SIGKILL)  # in the middle of the run
    at = len(table.rows())
    _, said = running.communicate(timeout=240)
    assert running.returncode == 0, said
    assert 10 <= at < 80
    whole = Table(tmp_path / "whole.parquet")
    chosen = suites.cells(
        [suites.Part(("drawn/output_error",), ("output_error", "from_truth"), 40)],
        suites.SUITES["quick"].seconds,
        FAMILIES,
        METHODS,
        5,
    )
    cell.run_cells(chosen, whole, 1)
    assert table.rows().select(SURE).equals(whole.rows().select(SURE))
