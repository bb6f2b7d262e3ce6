"""A run in a terminal: its last seconds are drawn, any key stops it, a kill leaves its log. Each in a process."""

import fcntl
import json
import os
import pty
import select
import signal
import struct
import subprocess
import sys
import termios
import time
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("serial", reason="the rig needs pyserial: pip install 'qpal[rig]'")

import twin
from twin.cli import main
from twin.cli.live import Trace, bars
from twin.rig import calibration as calibrations
from twin.rig import wire
from twin.rig.calibration import Calibration

TS = 0.02
RIG = ("--emulate", "twin", "--seed", "1")
CALIBRATION = Calibration(
    port="p", joint="shoulder", channel=0, low_counts=373.0, low_angle=-0.64, high_counts=655.0, high_angle=0.65,
    soft_low=-0.66, soft_high=0.67, crossing=1.5, strike=2.2, moves_up=0.35, moves_down=0.35,
)  # fmt: skip


@pytest.fixture
def command(tmp_path, monkeypatch):
    """`qpal rig run` of half a minute, in the present folder; its environment."""
    monkeypatch.chdir(tmp_path)
    calibrations.write(CALIBRATION, "rig.toml")
    u = np.where(np.arange(3000) // 50 % 2 == 0, 6.0, -6.0)
    table = np.column_stack([np.arange(len(u)) * TS, u])
    np.savetxt("d.csv", table, fmt="%.9g", delimiter=",", header="time [s],u [V]", comments="")
    monkeypatch.setenv("PYTHONPATH", str(Path(twin.__file__).parents[1]))
    monkeypatch.setenv("PYTHONUTF8", "1")
    monkeypatch.setenv("TERM", "xterm")
    return [sys.executable, "-m", "twin.cli", "rig", "run", "d.csv", *RIG, "--yes", "--log", "o.csv", "--speed", "2"]


def plays(seconds=60.0, rows=40):
    """Whether so many samples have come."""
    end = time.monotonic() + seconds
    path = Path("o.csv.journal")
    while time.monotonic() < end:
        if path.exists() and path.read_bytes().count(b"\n") > rows:
            return True
        time.sleep(0.05)
    return False


def on_terminal(command, act, stdout=None):
    """Exit code and screen of a command on a terminal of its own, and whether lines and echo were on in it, before,
    after `act` (terminal, process) and at the end."""
    process, terminal = pty.fork()
    if process == 0:
        os.execvp(command[0], command)
    fcntl.ioctl(terminal, termios.TIOCSWINSZ, struct.pack("HHHH", 30, 90, 0, 0))
    modes, screen = [is_plain(terminal)], b""
    assert plays()
    modes.append(is_plain(terminal))
    act(terminal, process)
    while select.select([terminal], [], [], 60.0)[0]:
        try:
            screen += os.read(terminal, 65536)
        except OSError:  # Linux says so where the other end is closed
            break
        modes[2:] = [is_plain(terminal)]
    _, status = os.waitpid(process, 0)
    os.close(terminal)
    return os.waitstatus_to_exitcode(status), screen.decode(), modes


def is_plain(terminal):
    return termios.tcgetattr(terminal)[3] & (termios.ICANON | termios.ECHO) == termios.ICANON | termios.ECHO


def test_any_key_stops_the_run_and_the_terminal_is_as_before(command):
    code, screen, modes = on_terminal(command, lambda terminal, _: os.write(terminal, b" "))
    assert code == 130
    assert modes == [True, False, True]
    log = twin.Log.load("o.csv")
    assert 40 <= log.N < 1500
    assert f"qpal: stopped; the drive is off; the first {log.N} samples are in o.csv" in screen
    assert "any key stops it" in screen
    assert "input +6.0 V" in screen
    assert "▆" in screen
    assert sorted(p.name for p in Path().iterdir()) == ["d.csv", "o.csv", "rig.toml"]


def test_a_fault_leaves_the_terminal_as_before(command):
    calibrations.write(CALIBRATION.model_copy(update={"strike": 0.1}), "rig.toml")
    rest, _, rows = Path("d.csv").read_text().partition("\n4,")
    Path("d.csv").write_text(rest.replace("6\n", "0\n") + "\n4," + rows)  # at rest for 4 s, then faster than that
    code, screen, modes = on_terminal(command, lambda *_: None)
    assert code == 1
    assert modes == [True, False, True]
    assert "it moved faster than its limit" in screen


def test_a_killed_run_leaves_its_log_to_the_next_command(command, capsys):
    """The same as the beginning of a run that was not killed."""
    process = subprocess.Popen(command, stderr=subprocess.DEVNULL, stdout=subprocess.DEVNULL)
    assert plays()
    process.kill()
    process.wait()
    assert not Path("o.csv").exists()
    again = [*command[3:-2], "--json"]
    assert main(again) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert "qpal: o.csv has the samples of a run that was killed" in err
    assert "o.csv is there already" in err
    killed = twin.Log.load("o.csv")
    assert sorted(p.name for p in Path().iterdir()) == ["d.csv", "o.csv", "rig.toml"]
    Path("o.csv").unlink()
    assert main(again) == 0
    whole = twin.Log.load("o.csv")
    assert 40 <= killed.N < whole.N == 3000
    assert (killed.y == whole.y[: killed.N]).all()
    assert killed.u == pytest.approx(whole.u[: killed.N], abs=1e-12)


def test_ctrl_c_tells_json_what_was_done(command):
    process = subprocess.Popen([*command, "--json"], stderr=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
    assert plays()
    process.send_signal(signal.SIGINT)
    out, err = process.communicate(timeout=60)
    assert process.returncode == 130, err
    summary = json.loads(out)
    log = twin.Log.load("o.csv")
    assert (summary["log"], summary["samples"]) == ("o.csv", log.N)
    assert log.N >= 40
    assert "stopped by hand" in summary["rig"]["ended_early"] == log.meta["rig"]["ended_early"]
    assert "any key" not in err


def test_bars_are_as_high_as_their_values(monkeypatch):
    monkeypatch.setattr("twin.cli.live._has_blocks", lambda: True)
    assert bars(np.array([0.0, 0.5, 1.0]), 0.0, 1.0, 5, 1) == ["   ▄█"]
    assert bars(np.array([-1.0, 0.25, 0.75, 9.0]), 0.0, 1.0, 4, 2) == ["  ▄█", " ▄██"]
    assert bars(np.array([0.0, 1.0, 1.0, 1.0]), 0.0, 1.0, 2, 1) == ["▄█"]  # a bar is the mean of its part


def test_a_trace_counts_what_is_lost_and_what_is_cut(monkeypatch):
    trace = Trace(CALIBRATION, 100, TS)
    assert trace.lines() == []
    for number in (0, 1, 4, 5):
        trace(wire.Sample(number, 0, ((514, 512),), 700, wire.RUNNING, 2 * (number > 3), 200, 0))
        trace(wire.Sample(number, 0, ((0, 0),) * 3, 700, wire.OFF, 0, 256, 0))  # at rest: not of the run
    angle, degrees, level, state = trace.lines()
    assert f"{np.rad2deg(-0.64 + 1.29 / 282 * (514 - 373)):+.1f} deg" in degrees
    assert level.startswith("input +6.0 V")
    assert state == "2 s left; 2 samples at a limit, 2 lost; any key stops it"
    assert len(angle) == len(degrees) == len(level)
