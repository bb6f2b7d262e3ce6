"""A few hundred damaged files of each kind, with fixed seeds; `scripts/fuzz.py` runs as many as one likes.

Both run in a process of their own: forks of one that has threads would wait for ever.
"""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest
from fuzz.mutate import BYTES, damaged, other_values
from fuzz.scripted import ENDS
from fuzz.targets import SHARES, TARGETS
from often import FULL

ROOT = Path(__file__).resolve().parents[2]
CASES = 700 if FULL else 140
ENVIRONMENT = {**os.environ, "POLARS_MAX_THREADS": "1", "PYTHONPATH": f"{ROOT}{os.pathsep}{ROOT / 'tests'}"}


@pytest.fixture(scope="module")
def counts():
    command = [sys.executable, "scripts/fuzz.py", "--cases", str(CASES), "--seed", "7"]
    done = subprocess.run(command, cwd=ROOT, env=ENVIRONMENT, capture_output=True, text=True, check=False)
    assert done.returncode in (0, 1), done.stderr
    return json.loads(done.stdout)


@pytest.mark.parametrize("name", TARGETS)
def test_damaged_files_give_right_numbers_or_a_sentence(counts, name):
    found = counts[name]
    assert found["cases"] == round(CASES * SHARES[name] / sum(SHARES.values()))
    assert found["failed"] == 0, json.dumps(found["samples"], indent=1)
    assert found["refused"] > 0.2 * found["cases"]  # the damage is felt
    assert found["same"] + found["read"] > 0.05 * found["cases"]  # and not always deadly


def test_every_way_to_end_is_told_from_the_others(tmp_path):
    program = """
import json, sys
from pathlib import Path
from fuzz.runner import run
from fuzz.scripted import ENDS, Scripted
print(json.dumps(run(Scripted(), range(len(ENDS)), 3, Path(sys.argv[1])).as_dict()))
"""
    command = [sys.executable, "-c", program, str(tmp_path)]
    done = subprocess.run(command, env=ENVIRONMENT, capture_output=True, text=True, check=True)
    found = json.loads(done.stdout)
    assert found["kinds"] == {
        "hang": 1,
        "no sentence": 1,
        "signal SIGSEGV": 1,
        "signal exit 3": 1,
        "untyped KeyError": 1,
        "untyped MemoryError": 1,
        "warning RuntimeWarning": 1,
        "wrong number": 1,
    }
    assert (found["cases"], found["same"], found["read"], found["refused"]) == (len(ENDS), 1, 1, 1)
    kept = {int(path.parent.name): path.read_text() for path in tmp_path.glob("*/file")}
    assert kept == {k: how for k, how in enumerate(ENDS) if how not in ("same", "read", "sentence")}


def test_damage_is_drawn_from_its_seed_and_changes_something():
    import numpy as np

    text, document = b"t,u,y\n" + b"0.1,2.5,-3\n" * 20, {"a": [1.0, {"b": 2}], "c": "x"}
    for each in (lambda rng: damaged(rng, text), lambda rng: json.dumps(other_values(rng, document))):
        found = [each(np.random.default_rng(k)) for k in range(60)]
        assert found == [each(np.random.default_rng(k)) for k in range(60)]
        assert len(set(found)) > 45
    assert document == {"a": [1.0, {"b": 2}], "c": "x"}
    rng = np.random.default_rng(1)
    assert all(any(change(rng, text) != text for _ in range(20)) for change in BYTES)
