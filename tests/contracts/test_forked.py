"""A forked process has none of polars' threads: what needs them is refused there at once, and the rest works."""

import multiprocessing
import os
import re
import subprocess
import sys
import time
from queue import Empty

import numpy as np
import pytest

import sysid
import twin
from sysid.base.errors import InputError
from sysid.bench import table
from sysid.formats import read_table, write_table

pytestmark = [
    pytest.mark.skipif(not hasattr(os, "fork"), reason="this system has no fork"),
    pytest.mark.filterwarnings("ignore:.*fork.*:DeprecationWarning"),
    pytest.mark.filterwarnings("ignore:.*fork.*:RuntimeWarning"),
]
REFUSED = r"forked after its parent had used polars.*multiprocessing\.get_context\('spawn'\)"
COLUMNS = {"t": np.arange(50) * 0.01, "u": np.sin(np.arange(50)), "y": np.cos(np.arange(50))}


def in_fork(work, context="fork"):
    """What `work()` gives in a forked process, or the sentence that it raises there; it has 30 s."""
    fork = multiprocessing.get_context(context)
    answer = fork.Queue()
    process = fork.Process(target=_answer, args=(answer, work))
    process.start()
    try:
        return answer.get(timeout=30)
    except Empty:
        pytest.fail("the forked process waits for ever")
    finally:
        process.kill()
        process.join()


def _answer(answer, work):
    try:
        answer.put(work())
    except InputError as error:
        answer.put(str(error))


@pytest.fixture
def log(tmp_path):
    """A log that this process has read, so that polars has its threads."""
    path = write_table(tmp_path / "log.csv", COLUMNS)
    read_table(path)
    return path


def test_logs_are_refused_at_once(log, tmp_path):
    began = time.monotonic()
    assert_refused(in_fork(lambda: float(sysid.read(log).y.sum())))
    assert time.monotonic() - began < 20
    for suffix in (".csv", ".parquet"):
        assert_refused(in_fork(lambda suffix=suffix: str(write_table(tmp_path / f"new{suffix}", COLUMNS))))
    assert sorted(path.name for path in tmp_path.iterdir()) == ["log.csv"]
    assert_refused(in_fork(lambda: in_fork(lambda: float(sysid.read(log).y.sum()))))


def test_texts_that_came_from_the_parent_are_refused(tmp_path):
    path = tmp_path / "dates.csv"
    path.write_text("t,u,y\n" + "".join(f"{k},{k}.5x,1\n" for k in range(9)))
    texts = read_table(path).columns[1]
    assert in_fork(lambda: list(texts)[:2]) == ["0.5x", "1.5x"]
    assert_refused(in_fork(lambda: texts.numbers().sum()))


def test_ensembles_and_benchmark_tables_are_refused_and_leave_nothing(log, tmp_path):
    ensemble = twin.Ensemble(twin.Experiment("thigh", duration=1.0), range(2), None, tmp_path / "many")
    assert_refused(in_fork(lambda: len(ensemble.run(threads=1))))
    assert not (tmp_path / "many").exists()
    ensemble.run(threads=1)
    assert_refused(in_fork(lambda: ensemble.table().height))
    assert_refused(in_fork(lambda: len(list(ensemble))))

    def add():
        with table.Table(tmp_path / "t.parquet").writing() as found:
            return len(found.row_keys())

    assert_refused(in_fork(add))
    assert not list(tmp_path.glob("*t.*"))


def test_what_needs_no_threads_works(log, tmp_path):
    """Arrays are read by a process of their own, and a fit has no table."""
    archive = write_table(tmp_path / "log.mat", COLUMNS)
    assert in_fork(lambda: float(read_table(archive).numbers("y").sum())) == pytest.approx(COLUMNS["y"].sum(), abs=0)
    data = sysid.read(log)
    assert in_fork(lambda: len(sysid.fit(sysid.structures.output_error(1, 1, 1), data).theta)) == 3


LATER = """
import multiprocessing, sys
if "polars" in sys.argv: import polars
import sysid
def child(answer): answer.put(float(sysid.read(sys.argv[1]).y.sum()))
if __name__ == "__main__":
    if "used" in sys.argv: polars.read_csv(b"1,2\\n3,4\\n")
    context = multiprocessing.get_context("spawn" if "spawn" in sys.argv else "fork")
    if "spawn" in sys.argv: sysid.read(sys.argv[1])
    answer = context.Queue()
    process = context.Process(target=child, args=(answer,))
    process.start()
    process.join(60)
    print("waits" if process.is_alive() else answer.get(timeout=5) if process.exitcode == 0 else "refused")
    process.kill()
"""


@pytest.mark.parametrize(
    ("before", "reads"),
    [
        ((), True),
        pytest.param(("polars",), True, marks=pytest.mark.nightly),
        (("spawn",), True),
        (("polars", "used"), False),
    ],
)
def test_a_process_forked_before_the_threads_began_reads(before, reads, log, tmp_path):
    (tmp_path / "later.py").write_text(LATER)
    command = [sys.executable, "-W", "ignore", tmp_path / "later.py", log, *before]
    done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=200)
    if reads:
        assert float(done.stdout) == pytest.approx(sysid.read(log).y.sum(), abs=1e-12), done.stderr
    else:
        assert done.stdout.strip() == "refused"
        assert "was forked after its parent had used polars" in done.stderr


def assert_refused(found):
    assert isinstance(found, str), found
    assert re.search(REFUSED, found), found
