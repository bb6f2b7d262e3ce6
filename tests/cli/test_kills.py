"""A run that is told to stop, or killed, at three moments: `scripts/attack/kills.py` does it at many."""

import ctypes
import importlib.util
import os
import shutil
import signal
import sys
import time
from pathlib import Path

import pytest
from often import by_day

from twin.cli.stopping import Stopping

pytestmark = pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="looks for processes in /proc")
VERB = ["info", "log.csv", "--write-map", "map.toml"]


@pytest.fixture(scope="module")
def kills():
    path = Path(__file__).parents[2] / "scripts" / "attack" / "kills.py"
    spec = importlib.util.spec_from_file_location("kills", path)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture(scope="module")
def given(tmp_path_factory):
    folder = tmp_path_factory.mktemp("given")
    rows = [f"{0.1 * k},{k % 7},{(k * k) % 11}" for k in range(200)]
    (folder / "log.csv").write_text("\n".join(["time_s,u_V,y_m", *rows]) + "\n")
    return folder


def stopped(kills, place, number, when):
    """The exit code and the words of a run, its process number, and what it left."""
    process = kills.begin(kills.Verb(VERB), place)
    ends = time.monotonic() + 60.0
    while not when(place) and time.monotonic() < ends:
        time.sleep(0.002)
    os.kill(process.pid, getattr(signal, f"SIG{number}"))
    code = process.wait(60)
    ends = time.monotonic() + 3.0
    while kills.processes(process.pid) and time.monotonic() < ends:
        time.sleep(0.05)
    assert not kills.processes(process.pid)
    return code, (place / "tmp.err").read_text()


def at_once(place):
    """While modules load."""
    time.sleep(0.25)
    return True


def at_work(place):
    return any((place / "runs").glob(".*")) if (place / "runs").exists() else False


@pytest.mark.parametrize(
    ("number", "when"),
    by_day(
        [
            ("TERM", at_once),
            ("INT", at_work),
            ("TERM", at_work),
            ("USR1", at_once),  # a warning of batch systems, as the next ones
            ("USR1", at_work),
            ("USR2", at_work),
            ("XCPU", at_work),
        ],
        *(("TERM", at_once), ("INT", at_work), ("USR2", at_work), ("XCPU", at_work)),
    ),
)
def test_a_run_that_is_told_to_stop_says_so_and_leaves_nothing(number, when, kills, given, tmp_path):
    place = tmp_path / "place"
    shutil.copytree(given, place)
    why = " at the limit of processor time, see ulimit -t" if number == "XCPU" else ""
    assert stopped(kills, place, number, when) == (130, f"qpal: stopped{why}; nothing was written\n")
    assert sorted(path.name for path in place.iterdir()) == ["log.csv", "tmp", "tmp.err"]
    assert not kills.left(place)


def test_what_a_killed_run_leaves_goes_with_the_next_one(kills, given, tmp_path):
    place, verb = tmp_path / "place", kills.Verb(VERB, ("runs", "map.toml"))
    shutil.copytree(given, place)
    assert stopped(kills, place, "KILL", at_work) == (-9, "")
    assert kills.left(place)
    kills.whole(verb, place)
    assert not kills.left(place)
    found = kills.contents(place, verb.out)
    assert {"map.toml", "runs/info/report.html", "runs/info/summary.json"} < set(found)


def test_the_script_notices_what_it_is_to_notice(kills, given, tmp_path):
    """Half an output, one of other content, a leftover, a traceback in vain: each is counted."""
    place, verb = tmp_path / "place", kills.Verb(VERB, ("out",))
    shutil.copytree(given, place)
    (place / "out").mkdir()
    (place / "tmp").mkdir()
    (place / "out" / "a.txt").write_text("1")
    (place / ".out.part").mkdir()
    expected = {"out/a.txt": b"1", "out/b.txt": b"2"}
    stopped, ended = kills.Shot(verb, "INT", 0.0), kills.Shot(verb, "TERM", 0.0)
    kills.check(stopped, place, 130, "qpal: stopped; nothing was written", expected)
    (place / "out" / "a.txt").write_text("3")
    kills.check(ended, place, 0, "", expected)
    assert [kind for kind, _ in (*stopped.faults, *ended.faults)] == [
        "INT: half an output",
        "INT: says that nothing was written",
        "INT: left behind",
        "TERM: another output",
        "TERM: half an output",
        "TERM: code 0 without output",
        "TERM: left behind",
    ]


def test_a_request_within_a_callback_is_repeated_and_prints_nothing(capfd):
    """A compiled kernel calls Python back while it is made; what rises there, Python prints and drops."""

    @ctypes.CFUNCTYPE(None)
    def back():
        os.kill(os.getpid(), signal.SIGTERM)
        time.sleep(0.01)

    before = sys.unraisablehook

    def work():
        with Stopping():
            back()
            time.sleep(10.0)

    with pytest.raises(KeyboardInterrupt):
        work()
    assert capfd.readouterr() == ("", "")
    assert sys.unraisablehook is before


def test_what_else_a_callback_raises_is_printed(capfd, monkeypatch):
    monkeypatch.setattr(sys, "unraisablehook", sys.__unraisablehook__)
    with Stopping():
        ctypes.CFUNCTYPE(None)(lambda: 1 / 0)()
    assert "ZeroDivisionError" in capfd.readouterr().err


def test_a_closed_terminal_ends_a_run_as_ctrl_c_does():
    def work():
        with Stopping():
            os.kill(os.getpid(), signal.SIGHUP)
            time.sleep(10.0)

    before = signal.signal(signal.SIGHUP, signal.SIG_DFL)  # nohup ignores it, and then it stays ignored
    try:
        with pytest.raises(KeyboardInterrupt):
            work()
        assert signal.getsignal(signal.SIGHUP) == signal.SIG_DFL
    finally:
        signal.signal(signal.SIGHUP, before)
