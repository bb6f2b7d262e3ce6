"""A reduced run of scripts/attack/environments.py: many odd settings at once change no number and no figure."""

import os
import resource
import runpy
import subprocess
import sys
import threading
import warnings
from pathlib import Path

import pytest

from twin.cli import environment, main

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture(scope="module")
def script():
    return runpy.run_path(str(ROOT / "scripts" / "attack" / "environments.py"), run_name="environments")


def test_odd_settings_at_once_change_nothing(script, tmp_path):
    plain = script["run"]("plain", tmp_path / "plain", ["simulate"])
    assert plain["wrong"] == []
    found = script["run"]("at once", tmp_path / "other", ["simulate"])
    assert found["wrong"] == []
    assert script["differences"](tmp_path / "other", tmp_path / "plain") == []


def test_a_number_that_differs_is_told(script, tmp_path):
    for name, value in (("a", 1.0), ("b", 1.0000000000000002)):
        (tmp_path / name).mkdir()
        (tmp_path / name / "summary.json").write_text(f'{{"gain": {value!r}, "seconds": {value!r}}}')
        (tmp_path / name / "x.png").write_bytes(b"1")
    assert script["differences"](tmp_path / "b", tmp_path / "a") == ["summary.json has other values"]
    (tmp_path / "b" / "x.png").write_bytes(b"2")
    (tmp_path / "b" / "summary.json").unlink()
    assert script["differences"](tmp_path / "b", tmp_path / "a") == ["summary.json is missing", "x.png has other bytes"]


def test_no_verb_starts_the_processes_of_a_library_that_opens_windows(tmp_path):
    code = "import os, sys; from twin.cli import main; print(main(['simulate', '--duration', '1', '--out', 'x']))\n"
    code += "print('mujoco' in sys.modules, 'glfw' in sys.modules, 'MUJOCO_GL' in os.environ)"
    variables = {name: value for name, value in os.environ.items() if name != "MUJOCO_GL"}
    done = subprocess.run([sys.executable, "-c", code], env=variables, cwd=tmp_path, capture_output=True, text=True)
    assert done.stdout.endswith("0\nTrue False False\n"), done.stderr


@pytest.mark.parametrize("mebibytes", [256, 1024, environment.LEAST - 1])
def test_too_little_address_space_is_a_sentence_at_once(mebibytes):
    code = f"import resource, sys; resource.setrlimit(resource.RLIMIT_AS, ({mebibytes << 20},) * 2)\n"
    code += "from twin.cli import main; sys.exit(main(['info', 'log.csv']))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60)
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr == (
        f"qpal: this process may have {mebibytes} MiB of address space and needs {environment.LEAST} MiB, most of "
        f"which stays unused; give it more with: ulimit -v {environment.LEAST << 10}\n"
    )


@pytest.mark.parametrize("soft", [resource.RLIM_INFINITY, environment.LEAST << 20])
def test_enough_address_space_is_enough(soft, monkeypatch):
    monkeypatch.setattr(resource, "getrlimit", lambda which: (soft, resource.RLIM_INFINITY))
    assert environment.no_room() == ""


def test_variables_and_filters_are_as_before(monkeypatch):
    given = {"MUJOCO_GL": "odd", "PYTHONWARNINGS": "error", "SOURCE_DATE_EPOCH": "odd"}
    for name, value in given.items():
        monkeypatch.setenv(name, value)
    monkeypatch.setattr(sys, "warnoptions", ["error::UserWarning"])
    filters = list(warnings.filters)
    with environment.within_reason():
        assert os.environ["MUJOCO_GL"] == "disable"
        assert "SOURCE_DATE_EPOCH" not in os.environ
        with pytest.warns(UserWarning, match="told"):
            warnings.warn("told", UserWarning, stacklevel=1)
    assert {name: os.environ[name] for name in given} == given
    assert warnings.filters == filters


WELL = {
    "SOURCE_DATE_EPOCH": ("1700000000", "0"),
    "NUMBA_NUM_THREADS": ("1", "16"),
    "NUMBA_CPU_FEATURES": ("", "+avx2,-avx512f", "+sse4.2"),
    "LOKY_MAX_CPU_COUNT": ("2",),
    "JOBLIB_START_METHOD": ("spawn",),
}
ILL = {
    "SOURCE_DATE_EPOCH": ("odd", "-1"),
    "NUMBA_NUM_THREADS": ("0", "-1", "two", "٣"),
    "POLARS_MAX_THREADS": ("0", "99999"),
    "NUMBA_CPU_FEATURES": ("odd", "+avx2,odd", "+"),
    "LOKY_MAX_CPU_COUNT": ("0", "1.5"),
    "JOBLIB_START_METHOD": ("odd", "spawned"),
}


def test_what_is_well_set_stays(monkeypatch):
    monkeypatch.delenv("MUJOCO_GL", raising=False)
    for name, value in ((name, value) for name, values in WELL.items() for value in values):
        monkeypatch.setenv(name, value)
        with environment.within_reason():
            assert os.environ[name] == value
        assert "MUJOCO_GL" not in os.environ


def test_what_a_library_dies_of_is_left_out(monkeypatch):
    for name, value in ((name, value) for name, values in ILL.items() for value in values):
        monkeypatch.setenv(name, value)
        with environment.within_reason():
            assert name not in os.environ, value
        assert os.environ[name] == value


def test_a_verb_runs_within_them(monkeypatch, capsys):
    monkeypatch.setattr(environment, "no_room", lambda: "no room")
    assert main(["--help"]) == 2
    assert capsys.readouterr().err == "qpal: no room\n"


def test_a_limit_of_threads_is_told_before_the_libraries_load(monkeypatch, capsys):
    assert environment.no_threads() == ""
    begun = []

    class Few(threading.Thread):
        def start(self):
            if len(begun) == 3:
                raise RuntimeError("can't start new thread")
            begun.append(self)
            super().start()

    before = threading.active_count()
    monkeypatch.setattr(environment.threading, "Thread", Few)
    assert main(["info"]) == 2
    assert "this process may start 3 threads and needs 8" in capsys.readouterr().err
    assert threading.active_count() == before
