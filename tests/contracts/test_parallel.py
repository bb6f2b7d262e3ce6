"""The one executor: the same results here, on processes and on a cluster."""

import signal
import subprocess
import sys
import time

import numpy as np
import polars as pl
import pytest
from cluster import cluster

import twin
from sysid.base import parallel
from sysid.base.errors import InputError
from sysid.base.parallel import in_order, results
from sysid.selection.select import select
from sysid.selection.space import Space
from sysid.systems import system


def test_results_carry_the_number_of_their_job():
    jobs = list(range(-20, 20))
    for workers in (1, 2):
        assert in_order(abs, jobs, workers) == [abs(job) for job in jobs]
    assert sorted(results(abs, [-3, 5], 2)) == [(0, 3), (1, 5)]
    assert list(results(abs, [], 2)) == []


def test_ctrl_c_of_a_terminal_reaches_no_worker():
    """It would print a traceback beside the sentence of the process that started it, which ends its workers itself."""
    assert in_order(signal.getsignal, [signal.SIGINT] * 4, 2) == [signal.SIG_IGN] * 4
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler


def test_a_function_of_a_script_that_knows_the_facades_runs_in_worker_processes(tmp_path):
    """Its globals hold sysid and twin, which lazy_loader may have given a class of their own."""
    script = tmp_path / "script.py"
    script.write_text(
        "import sysid, twin\nfrom sysid.base.parallel import in_order\n"
        "def named(k): return sysid.__name__ + twin.__name__ + str(k)\n"
        "if __name__ == '__main__': print(in_order(named, [1, 2], 2))\n"
    )
    done = subprocess.run([sys.executable, script], capture_output=True, text=True, check=False, timeout=300)
    assert done.stdout.strip() == "['sysidtwin1', 'sysidtwin2']", done.stderr


GROWS = """
import time, warnings
from sysid.base.parallel import in_order

def grow(k):
    time.kept = [*getattr(time, "kept", ()), bytearray(b"x") * 200_000_000]  # in a module: the function is sent anew
    time.sleep(1.1)
    return k

if __name__ == "__main__":
    warnings.simplefilter("error")
    print(in_order(grow, range(10), 2))
"""


@pytest.mark.nightly
def test_a_worker_that_has_grown_is_replaced_also_where_warnings_are_errors(tmp_path):
    """joblib ends it after 300 MB and warns in a thread, which the error would end: the run would wait for ever."""
    pytest.importorskip("psutil")  # joblib looks at the memory of workers only with it
    script = tmp_path / "script.py"
    script.write_text(GROWS)
    done = subprocess.run([sys.executable, script], capture_output=True, text=True, check=False, timeout=100)
    assert done.stdout.strip() == str(list(range(10))), done.stderr


def test_no_scheduler_is_a_sentence(monkeypatch):
    pytest.importorskip("distributed")
    monkeypatch.setattr(parallel, "GREETING", 1.0)
    with pytest.raises(InputError, match=r"no Dask scheduler at tcp://127\.0\.0\.1:1 "):
        list(results(abs, [1, 2], scheduler="tcp://127.0.0.1:1"))
    with pytest.raises(InputError, match="1 or more"):
        list(results(abs, [1, 2], workers=0))


def test_a_cluster_without_workers_is_a_sentence(tmp_path, monkeypatch):
    """Before the run and in the middle of it, where its jobs would wait without end."""
    pytest.importorskip("distributed")
    empty, one = tmp_path / "empty", tmp_path / "one"
    empty.mkdir()
    one.mkdir()
    monkeypatch.setattr(parallel, "PATIENCE", 1.0)
    with cluster(empty, count=0) as (address, _), pytest.raises(InputError, match=r"no worker for 1 s.*dask worker"):
        list(results(abs, [1], scheduler=address))
    monkeypatch.setattr(parallel, "PATIENCE", 20.0)
    with cluster(one, count=1) as (address, (worker,)):
        found = results(time.sleep, [0.0, 600.0], scheduler=address)
        assert next(found) == (0, None)
        worker.kill()
        monkeypatch.setattr(parallel, "PATIENCE", 1.0)
        with pytest.raises(InputError, match="no worker for 1 s"):
            next(found)


def test_search_and_ensemble_are_the_same_on_a_cluster(tmp_path):
    pytest.importorskip("distributed")
    data = system("textbook").record(600, 0.01, np.random.default_rng(1))
    space = Space(
        (1, 2), (1, 2), (1,), ("saturation",), ("piecewise_linear",), 1, 1, ("hammerstein_wiener",), grows=False
    )
    draws = twin.Draws({"thigh.coulomb": 0.3})

    def ensemble(name):
        return twin.Ensemble(twin.Experiment("thigh", duration=4.0), range(6), draws, tmp_path / name, part=2)

    here, alone = select(data, space, jobs=1, seconds=3600.0), ensemble("here").run()
    with cluster(tmp_path) as (address, _):
        there, shared = select(data, space, scheduler=address, seconds=3600.0), ensemble("there").run(scheduler=address)
    assert there.as_dict() == here.as_dict()
    np.testing.assert_array_equal(there.fit.theta, here.fit.theta)
    for ours, theirs in zip(alone, shared, strict=True):
        np.testing.assert_array_equal(ours.y, theirs.y)
    assert isinstance(shared.table(), pl.DataFrame)
    assert shared.table().equals(alone.table())
