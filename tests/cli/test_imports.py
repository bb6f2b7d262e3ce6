"""What a verb loads: identifying a record needs no robot and so no MuJoCo."""

import subprocess
import sys

import numpy as np
import pytest

import twin

LOADED = """
import sys
from twin.cli import main
code = max(main(words.split()) for words in sys.argv[1:])
print("LOADED", *sorted({name.split(".")[0] for name in sys.modules}), *(n for n in sys.modules if "." in n))
sys.exit(code)
"""


def loaded(*runs: list[str], folder) -> set[str]:
    """Modules that are loaded after `qpal` has run in one process with each of these arguments."""
    done = subprocess.run(
        [sys.executable, "-W", "error", "-c", LOADED, *map(" ".join, runs)], cwd=folder, capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr
    return set(done.stdout.rpartition("LOADED")[2].split())


@pytest.mark.parametrize(
    "arguments",
    [
        ["--ts", "0.1", "--structure", "output_error", "--orders", "1,1,1"],
        pytest.param(["--ts", "0.1", "--structure", "actuated_joint", "--starts", "1"], marks=pytest.mark.nightly),
        pytest.param(["--ts", "0.1", "--structure", "nlarx", "--starts", "1"], marks=pytest.mark.nightly),
    ],
    ids=["chain", "joint", "nlarx"],
)
def test_identify_loads_no_mujoco(arguments, tmp_path):
    rng = np.random.default_rng(0)
    u = np.repeat(rng.uniform(-1.0, 1.0, 15), 10)
    y = np.zeros(len(u))
    for k in range(1, len(y)):
        y[k] = np.clip(y[k - 1] + 0.1 * u[k - 1], -1.0, 1.0)
    np.savetxt(tmp_path / "log.csv", np.column_stack([u, y + 0.001 * rng.standard_normal(len(u))]), delimiter=",")
    names = loaded(["identify", "log.csv", *arguments], folder=tmp_path)
    assert {"sysid", "twin", "sysid.workflow.evaluation"} <= names
    assert "mujoco" not in names
    assert not {"twin.plant.leg", "twin.experiment", "twin.ensemble.ensemble", "twin.plant"} & names


def test_help_of_every_verb_loads_neither_mujoco_nor_scipy(tmp_path):
    """SciPy alone takes as long as all the rest of a start."""
    names = loaded(
        *([verb, "--help"] for verb in ("identify", "simulate", "view", "reproduce", "info", "crawl")), folder=tmp_path
    )
    assert "twin.cli.crawl" in names
    assert not {"mujoco", "scipy"} & names


@pytest.mark.parametrize("first", ["twin.truth", "twin.log", "twin.experiment", "twin.signatures.mechanics"])
def test_a_name_is_itself_whatever_was_imported_before(first):
    code = f"import {first}, twin; print(callable(twin.truth), twin.Log.__name__, len(twin.IMPERFECTIONS))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.split() == ["True", "Log", "17"]


def test_the_public_names_of_twin_are_the_stubs():
    names = ["Draws", "Ensemble", "Experiment", "Follower", "IMPERFECTIONS", "JOINTS", "Log", "Parameters", "truth"]
    names += [
        "Comparison",
        "compare",
        "design",
        "hardware",
        "imperfections",
        "parameter_file",
        "pendulum",
        "plant",
        "robot",
        "signatures",
        "studies",
        "view",
    ]
    assert sorted(dir(twin)) == sorted(twin.__all__) == sorted(names)
    for name in names:
        assert getattr(twin, name) is not None
