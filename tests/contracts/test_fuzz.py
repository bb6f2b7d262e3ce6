"""A few hundred damaged files of each kind, with fixed seeds; `scripts/attacks.py` runs as many as one likes.

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
from fuzz.targets import SIZES, TARGETS
from often import FULL

ROOT = Path(__file__).resolve().parents[2]
SCALE = 0.01 if FULL else 0.001
ENVIRONMENT = {**os.environ, "POLARS_MAX_THREADS": "1", "PYTHONPATH": f"{ROOT}{os.pathsep}{ROOT / 'tests'}"}


def attacks(out, *options):
    command = [sys.executable, "scripts/attacks.py", "--seed", "7", "--out", str(out), *options]
    done = subprocess.run(command, cwd=ROOT, env=ENVIRONMENT, capture_output=True, text=True, check=False)
    assert done.returncode in (0, 1), done.stderr
    return json.loads(out.read_text()), done


@pytest.fixture(scope="module")
def counts(tmp_path_factory):
    out = tmp_path_factory.mktemp("counts") / "counts.json"
    return attacks(out, "--scale", str(SCALE), "--only", ",".join(TARGETS))[0]["classes"]


@pytest.mark.parametrize("name", TARGETS)
def test_damaged_files_give_right_numbers_or_a_sentence(counts, name):
    found, ended = counts[name], counts[name]["ended"]
    assert found["cases"] == max(1, round(SCALE * SIZES[name]))
    assert found["bad"] == 0, json.dumps(found["samples"], indent=1)
    assert ended["refused"] > 0.2 * found["cases"]  # the damage is felt
    assert ended.get("same", 0) + ended.get("read", 0) > 0.05 * found["cases"]  # and not always deadly


def test_a_run_goes_on_where_one_stopped_and_keeps_its_counts(tmp_path):
    out, scale = tmp_path / "counts.json", ("--scale", "0.0001")
    first, _ = attacks(out, *scale, "--only", "parameters")
    first["classes"]["parameters"].update(bad=3, kinds={"nan": 3}, samples={"nan": ["case 1: x"]})
    out.write_text(json.dumps(first))
    second, done = attacks(out, *scale, "--only", "journals,parameters")
    assert second["classes"]["parameters"] == first["classes"]["parameters"]
    assert (second["bad"], second["cases"], done.returncode) == (3, 3, 1)
    assert done.stderr == "journals ...\n"
    assert "parameters: nan: 3\n    case 1: x" in done.stdout
    before = out.read_text()
    command = [sys.executable, "scripts/attacks.py", "--seed", "8", *scale, "--out", str(out)]
    other = subprocess.run(command, cwd=ROOT, env=ENVIRONMENT, capture_output=True, text=True, check=False)
    assert (other.returncode, out.read_text()) == (1, before)
    assert "give another --out, or delete it" in other.stderr
    out.write_text("[1]")
    other = subprocess.run(command, cwd=ROOT, env=ENVIRONMENT, capture_output=True, text=True, check=False)
    assert (other.returncode, other.stderr) == (1, f"{out} is no file of counts; give another --out\n")


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
    assert (found["cases"], found["bad"]) == (len(ENDS), len(found["kinds"]))
    assert {end: found["ended"][end] for end in ("same", "read", "refused")} == {"same": 1, "read": 1, "refused": 1}
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
