"""The cache of compiled loops on disk: damaged, of another version or without a place, it changes no number."""

import os
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from numba import njit, types
from numba.core import caching

import sysid
import twin
from sysid.base.compiled import callback, kernel

X = np.random.default_rng(0).standard_normal(200)
FILTER = (
    "import numpy as np\nfrom sysid.block.kernels import all_pole\n"
    "y = np.empty(50)\nall_pole(np.array([-1.2, 0.5]), np.sin(np.arange(50.0)), y)\n"
    "print(y.tobytes().hex(), all_pole.stats.cache_hits.total())\n"
)


def smoothed(x):
    """A sum whose last bit depends on the order of its terms."""
    s = 0.0
    for v in x:
        s = 0.9 * s + np.sin(v) / 3.0
    return s


def outcome(made) -> tuple[float, int]:
    """The value, and how many times it came from the cache."""
    return made(X), made.stats.cache_hits.total()


DAMAGES = {
    "half": lambda raw: raw[: len(raw) // 2],
    "empty": lambda raw: b"",
    "garbage": lambda raw: bytes(range(256)),
    "a byte": lambda raw: raw[: len(raw) // 3] + bytes([raw[len(raw) // 3] ^ 1]) + raw[len(raw) // 3 + 1 :],
    "more": lambda raw: raw + b"x",
}


@pytest.mark.parametrize("suffix", [".nbi", ".nbc"])
@pytest.mark.parametrize("damage", DAMAGES)
def test_a_damaged_file_of_the_cache_is_written_again(damage, suffix, tmp_path, monkeypatch):
    monkeypatch.setattr("numba.core.config.CACHE_DIR", str(tmp_path))
    exact = njit(smoothed)(X)
    assert outcome(kernel(smoothed)) == (exact, 0)
    assert outcome(kernel(smoothed)) == (exact, 1)
    (path,) = tmp_path.rglob(f"*{suffix}")
    whole = path.read_bytes()
    path.write_bytes(DAMAGES[damage](whole))
    assert outcome(kernel(smoothed)) == (exact, 0)
    assert outcome(kernel(smoothed)) == (exact, 1)


def test_a_loop_of_the_library_survives_a_cache_cut_in_half(tmp_path):
    """In processes of their own, as at a second start after a full disk; the cache is where NUMBA_CACHE_DIR says."""
    env = {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path)}

    def run() -> list[str]:
        return subprocess.run(
            [sys.executable, "-c", FILTER], env=env, capture_output=True, text=True, check=True
        ).stdout.split()

    first = run()
    files = [path for path in tmp_path.rglob("*") if path.is_file()]
    assert files
    assert first[1] == "0"
    for path in files:
        path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])
    assert run() == first
    assert run() == [first[0], "1"]


def test_without_a_place_for_a_cache_the_loop_is_compiled_all_the_same(monkeypatch):
    monkeypatch.setattr(caching.CacheImpl, "_locator_classes", [])
    with pytest.raises(RuntimeError, match="no locator"):
        njit(cache=True)(smoothed)
    assert outcome(kernel(smoothed)) == (njit(smoothed)(X), 0)


def test_a_folder_that_is_gone_or_full_costs_the_cache_alone(tmp_path, monkeypatch):
    monkeypatch.setattr("numba.core.config.CACHE_DIR", str(tmp_path / "cache"))
    made = kernel(smoothed)
    (folder,) = (tmp_path / "cache").iterdir()
    folder.rmdir()
    folder.write_text("a file, where the folder was")
    assert outcome(made) == (njit(smoothed)(X), 0)


def test_a_callback_is_kept_and_made_again(tmp_path, monkeypatch):
    monkeypatch.setattr("numba.core.config.CACHE_DIR", str(tmp_path))

    def half(x):
        return 0.5 * x

    made = [callback(types.float64(types.float64))(half) for _ in range(2)]
    assert [each.cache_hits for each in made] == [0, 1]
    for path in tmp_path.rglob("*.nbc"):
        path.write_bytes(path.read_bytes()[:100])
    again = callback(types.float64(types.float64))(half)
    assert again.cache_hits == 0
    assert again.ctypes(3.0) == made[1].ctypes(3.0) == 1.5


def test_every_loop_with_a_cache_is_compiled_in_one_way():
    """Numba's own cache ends the program on a damaged file, so that nothing else asks for it."""
    files = [p for package in (sysid, twin) for p in Path(package.__file__).parent.rglob("*.py")]
    asks = [p.name for p in files if re.search(r"cache ?= ?True|\bcfunc\(", p.read_text(encoding="utf-8"))]
    assert asks == []
