"""Compiled kernels on disk: written once, made again where damaged or changed, done without where none can be kept."""

import importlib
import os
import subprocess
import sys

import numpy as np
import pytest

from sysid.block.compiler import kernel
from sysid.blocks import dynamic


def test_two_processes_that_write_one_kernel_at_once_both_run_it(tmp_path):
    code = (
        "import numpy as np; from sysid.blocks import dynamic;"
        "b = dynamic('def step(s, x, p):\\n    s.v += p.g * x\\n    return s.v\\n', {'g': 1.0});"
        "print(b.propagate(np.array([2.0]), np.ones(3), np.empty((3, 0)), 0).tolist())"
    )
    env = {**os.environ, "XDG_CACHE_HOME": str(tmp_path)}
    runs = [
        subprocess.Popen(
            [sys.executable, "-c", code], env=env, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
        )
        for _ in range(3)
    ]
    for run in runs:
        out, err = run.communicate(timeout=300)
        assert out.strip() == "[2.0, 4.0, 6.0]", err
    folder = tmp_path / "sysid" / "kernels"
    assert len(list(folder.glob("*.kernel"))) == 1
    assert not list(folder.glob("*.part"))


def test_without_a_folder_to_write_to_a_block_still_runs(tmp_path, monkeypatch):
    """Neither the library's folder nor the user's cache can be written: compiled for this process alone."""
    blocked = tmp_path / "file"
    blocked.write_text("")
    monkeypatch.setattr(kernel, "_folders", lambda near: [blocked / "a", blocked / "b"])
    block = dynamic("def step(s, x, p):\n    s.v += 3.0 * p.g * x\n    return s.v\n", {"g": 1.0})
    assert block.propagate(np.array([2.0]), np.ones(2), np.empty((2, 0)), 0).tolist() == [6.0, 12.0]


def test_a_changed_step_or_compiler_is_compiled_anew(tmp_path, monkeypatch):
    monkeypatch.setattr(kernel, "_folders", lambda near: [tmp_path])

    def output(factor):
        text = f"def step(s, x, p):\n    return {factor} * p.g * x\n"
        return dynamic(text, {"g": 1.0}).propagate(np.ones(1), np.ones(1), np.empty((1, 0)), 0)[0]

    assert [output(2.0), output(5.0), output(2.0)] == [2.0, 5.0, 2.0]
    assert len(list(tmp_path.glob("*.kernel"))) == 2
    monkeypatch.setattr(kernel, "_version", lambda: "another")
    output(2.0)
    assert len(list(tmp_path.glob("*.kernel"))) == 3


def test_importing_the_blocks_writes_and_compiles_nothing(tmp_path):
    code = "import sys, sysid.blocks; print([m for m in sys.modules if 'numba' in m or 'sysid_compiled' in m])"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"
    importlib.import_module("sysid.blocks")


@pytest.mark.parametrize("damage", ["", "garbage\x00(", "def value(:\n"])
def test_a_damaged_kernel_is_made_again(damage, tmp_path):
    text = "def step(s, x, p):\n    s.a = 0.5 * s.a + p.g * x\n    return s.a\n"
    code = (
        "import numpy as np\nfrom sysid.blocks import dynamic\n"
        f"block = dynamic({text!r}, {{'g': 2.0}})\n"
        "print(block.output(np.array([2.0]), np.ones(3)).tolist())"
    )
    env = {**os.environ, "XDG_CACHE_HOME": str(tmp_path)}

    def run():
        done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, env=env)
        return done.stdout.strip()

    assert run() == "[2.0, 3.0, 3.5]"
    (kernel_file,) = tmp_path.rglob("*.kernel")
    kernel_file.write_text(damage, encoding="utf-8")
    assert run() == "[2.0, 3.0, 3.5]"
