"""The border of the benchmark: whatever a method gives back or raises, a row says so, and rows of others stand."""

import contextlib
import json
import subprocess
import sys
import textwrap
import time
from pathlib import Path

import numpy as np
import pytest
from often import FULL

from sysid.base.errors import InputError
from sysid.bench import contract
from sysid.bench.cell import Cell, run_cells
from sysid.bench.method import FunctionMethod
from sysid.bench.method_file import load
from sysid.bench.scenarios import TABLE as FAMILIES
from sysid.bench.table import Table

ROOT = Path(__file__).resolve().parents[2]
GOOD = """
    import numpy as np

    class Zero:
        def simulate(self, u, y_init):
            return 0.0 * u

    """
# The body of a file after GOOD, and how its row begins.
FILES = {
    "def fit(data): return Zero()": "ok",
    "class E(Exception):\n    def __str__(self): raise E\ndef fit(data): raise E": "crashed: a value of type E",
    "def fit(data): raise SystemExit(0)": "crashed: SystemExit: 0",
    "def fit(data): return fit(data)": "crashed: RecursionError: maximum recursion depth",
    "def fit(data):\n    print('x' * 10**7)\n    return Zero()": "ok",
    "def fit(data):\n    with open('done.json', 'w') as f: f.write('{\"status\": 3}')\n    import os; os._exit(0)": (
        "crashed: ValueError: its status is a value of type int"
    ),
    "def fit(data):\n    with open('done.json', 'w') as f: f.write('[' * 10**6)\n    import os; os._exit(0)": (
        "crashed: RecursionError"
    ),
    "def fit(data):\n    import os; os.mkfifo('done.json'); os._exit(0)": "crashed: exit status 0: no output",
    "def fit(data):\n    import os; os.mkfifo('runs.npz')\n"
    "    with open('done.json', 'w') as f: f.write('{\"status\": \"ok\"}')\n    os._exit(0)": (
        "crashed: its answer cannot be read"
    ),
    "def fit(data):\n    z = Zero(); z.details = [1, 2]; z.poles = 'many'\n    return z": "ok",
    "def fit(data):\n    z = Zero(); z.simulate = lambda u, y: (0.0 for _ in u)\n    return z": (
        "crashed: ValueError: simulate gave a value of type generator"
    ),
}


@pytest.mark.parametrize("part", [pytest.param(1, marks=pytest.mark.nightly), 12])
def test_answers_of_every_odd_kind_are_rows(part, tmp_path):
    if part == 1 and not FULL:
        pytest.skip("nightly")
    out = tmp_path / "counts.json"
    options = ["--only", "methods", "--seed", "1", "--scale", str(1 / part), "--out", str(out)]
    done = subprocess.run([sys.executable, "scripts/attacks.py", *options], cwd=ROOT, capture_output=True, text=True)
    assert done.returncode in (0, 1), done.stderr
    counts = json.loads(out.read_text())["classes"]["methods"]
    assert counts["bad"] == 0, counts["samples"]
    assert min(counts["ended"]["ok"], counts["ended"]["crashed"]) > 0.2 * counts["cases"]  # felt, and not deadly


def test_files_that_answer_with_anything_are_rows(tmp_path):
    methods = []
    for k, body in enumerate(FILES):
        (tmp_path / f"m{k}.py").write_text(textwrap.dedent(GOOD) + body + "\n")
        methods.append(load(tmp_path / f"m{k}.py"))
    table = Table(tmp_path / "t.parquet")
    run_cells([Cell(FAMILIES["drawn"], "output_error", method, 1, 1.0) for method in methods], table, 2)
    said = {row["method"]: row for row in table.rows().to_dicts()}
    for k, begin in enumerate(FILES.values()):
        assert said[f"m{k}"]["status"].startswith(begin), list(FILES)[k]
        assert (said[f"m{k}"]["fit"] is not None) == (begin == "ok")
    assert said["m9"]["stop"] == "its details are a value of type list; give a dictionary"


@pytest.mark.parametrize("text", ["(" * 10**5, "-" * 10**5 + "1", "x = 1\n" * 10**6, "\0", "REQUIREMENTS = 2**[]"])
def test_a_file_that_python_cannot_take_is_a_sentence(tmp_path, text):
    (tmp_path / "m.py").write_text(text)
    with pytest.raises(InputError, match=r"m\.py"):
        load(tmp_path / "m.py")


def test_a_method_that_takes_every_exception_for_a_bad_start_is_stopped():
    def fit(data):
        while True:
            with contextlib.suppress(Exception):
                time.sleep(0.01)

    row = _row(fit)
    assert row["status"].startswith("stopped after")
    assert row["seconds"] < 5.0


def test_a_method_that_writes_into_what_it_gets_changes_no_record():
    def fit(data):
        class Writes:
            def simulate(self, u, y_init):
                run = 1.0 * u
                u[:], y_init[:] = 0.0, 1e9
                return run

        return Writes()

    def reads(data):
        class Reads:
            def simulate(self, u, y_init):
                return 1.0 * u

        return Reads()

    assert _row(fit)["fit"] == _row(reads)["fit"]


def test_a_method_that_moves_the_process_elsewhere_leaves_the_table_in_its_place(tmp_path, monkeypatch):
    import os

    monkeypatch.chdir(tmp_path)

    def fit(data):
        os.chdir("/")
        np.seterr(all="raise")
        raise ValueError("moved")

    cells = [Cell(FAMILIES["drawn"], "output_error", FunctionMethod("x", "", fit), seed, 1.0) for seed in (1, 2)]
    run_cells(cells, Table("t.parquet"), 1)
    assert len(Table("t.parquet").rows()) == 2
    assert np.geterr()["over"] != "raise"


@pytest.mark.parametrize(
    ("values", "said"),
    [
        (np.zeros((3, 2)), r"6 samples for 3"),
        (np.zeros((1, 3)), ""),
        (np.zeros(3, dtype=complex), "array of complex128"),
        ([None, 1.0, "2"], ""),
        (["1", "2", "3"], "simulate gave a value of type list"),
        (np.ma.masked_all(3), ""),
        (3.0, "simulate gave a value of type float"),
    ],
)
def test_a_run_is_numbers_of_the_length_of_its_input(values, said):
    if said:
        with pytest.raises(ValueError, match=said):
            contract.checked_run(values, 3)
    else:
        assert contract.checked_run(values, 3).shape == (3,)


def _row(fit):
    from sysid.bench.cell import run_cell

    return run_cell(Cell(FAMILIES["drawn"], "output_error", FunctionMethod("x", "", fit), 1, 0.2))
