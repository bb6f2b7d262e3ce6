"""The cache of compiled loops on disk: damaged, of another version or without a place, it changes no number."""

import os
import re
import subprocess
import sys
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest
from numba import njit, types
from numba.core import caching
from numba.core.errors import TypingError

import sysid
import twin
from sysid.base import compiled
from sysid.base.compiled import callback, compiles, kernel
from sysid.base.locks import take_lock

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


def wait_for(true: Callable[[], bool]) -> bool:
    """Whether it becomes true within a while."""
    end = time.monotonic() + 30.0
    while not true() and time.monotonic() < end:
        time.sleep(0.005)
    return true()


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


@pytest.fixture
def lock(tmp_path, monkeypatch):
    """The lock of `smoothed`, as of a process that compiles it; what that one has written lies in the folder `done`."""
    monkeypatch.setattr("numba.core.config.CACHE_DIR", str(tmp_path / "cache"))
    outcome(kernel(smoothed))
    (folder,) = (tmp_path / "cache").iterdir()
    assert not list(folder.glob("*.lock"))
    folder.rename(tmp_path / "done")
    folder.mkdir()
    name = next((tmp_path / "done").glob("*.nbi")).name
    held = take_lock(folder / f"{name}.lock", lambda holder: "")
    yield held
    held.close()


def test_a_loop_that_another_process_compiles_is_awaited(lock, tmp_path):
    made = kernel(smoothed)
    with ThreadPoolExecutor() as pool:
        waiting = pool.submit(outcome, made)
        assert wait_for(compiles)
        for path in (tmp_path / "done").iterdir():
            path.rename(next((tmp_path / "cache").iterdir()) / path.name)
        assert not waiting.done()
        lock.close()
        assert waiting.result(30.0) == (njit(smoothed)(X), 1)
    assert not compiles()
    assert not list(tmp_path.rglob("*.lock"))


def test_a_process_that_is_stopped_is_not_awaited_for_ever(lock, monkeypatch):
    monkeypatch.setattr(compiled, "PATIENCE", 0.1)
    assert outcome(kernel(smoothed)) == (njit(smoothed)(X), 0)


def test_a_loop_that_another_process_compiles_is_left_to_it_where_that_is_asked_for(lock, monkeypatch):
    monkeypatch.setattr(compiled._Cache, "waits", True)
    compiled.leave_to_others()
    made = kernel(smoothed)
    with pytest.raises(compiled.CompilationRefusedError):
        made(X)
    lock.close()
    assert outcome(made) == (njit(smoothed)(X), 0)


def test_where_nothing_may_be_compiled_nobody_waits(lock, monkeypatch):
    made = kernel(smoothed)
    monkeypatch.setattr(compiled.time, "sleep", lambda seconds: pytest.fail("it waits"))
    with compiled.refusing_compilation() as refused, pytest.raises(compiled.CompilationRefusedError):
        made(X)
    assert len(refused) == 1


def test_a_loop_that_cannot_be_compiled_leaves_its_lock(tmp_path, monkeypatch):
    monkeypatch.setattr("numba.core.config.CACHE_DIR", str(tmp_path))

    def odd(x):
        return x + "a"

    with pytest.raises(TypingError):
        kernel(odd)(X)
    assert not list(tmp_path.rglob("*.lock"))


def test_every_loop_with_a_cache_is_compiled_in_one_way():
    """Numba's own cache ends the program on a damaged file, so that nothing else asks for it."""
    files = [p for package in (sysid, twin) for p in Path(package.__file__).parent.rglob("*.py")]
    asks = [p.name for p in files if re.search(r"cache ?= ?True|\bcfunc\(", p.read_text(encoding="utf-8"))]
    assert asks == []
