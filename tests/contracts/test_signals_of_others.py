"""Signals that libraries handle in their own way: workers, the processes beside them, and a Ctrl-C that is ignored."""

import os
import signal
import subprocess
import sys

import pytest

pytestmark = pytest.mark.skipif(not os.path.exists("/proc/self/status"), reason="looks into /proc")
POOL = """
import os, time
from pathlib import Path
from sysid.base.parallel import results

def job(k):
    time.sleep(0.2)
    return Path("/proc/self/status").read_text()

if __name__ == "__main__":
    found = [("worker", text) for _, text in results(job, range(4), 2)]
    for entry in Path("/proc").iterdir():
        if entry.name.isdigit() and "resource_tracker" in (entry / "cmdline").read_text(errors="replace"):
            text = (entry / "status").read_text()
            if f"PPid:\\t{os.getpid()}\\n" in text:
                found.append(("tracker", text))
    for name, text in found:
        masks = dict(line.split(":\\t") for line in text.splitlines() if line.startswith("Sig"))
        print(name, *(masks[mask] for mask in ("SigBlk", "SigIgn")))
"""
IGNORED = """
import signal, sys
from pathlib import Path
from twin.cli import main

before = signal.getsignal(signal.SIGINT)
code = main(["info", "log.csv", "--out", "out"])
masks = dict(line.split(":\\t") for line in Path("/proc/self/status").read_text().splitlines() if "Sig" in line[:3])
print(code, "polars" in sys.modules, before is signal.SIG_IGN, masks["SigIgn"])
"""


def has(mask: str, number: int) -> bool:
    """Whether a mask of /proc holds a signal."""
    return bool(int(mask, 16) >> (number - 1) & 1)


def said(*arguments, **options) -> list[list[str]]:
    """The words of each line that a script prints."""
    run = subprocess.run([sys.executable, *arguments], capture_output=True, text=True, timeout=300, **options)
    assert run.returncode == 0, run.stderr
    return [line.split() for line in run.stdout.splitlines()]


def test_workers_are_born_deaf_to_ctrl_c_and_the_processes_beside_them_to_a_closed_terminal(tmp_path):
    """A worker that Ctrl-C meets at its import prints a traceback; what a lost tracker knew is told by tracebacks."""
    script = tmp_path / "script.py"
    script.write_text(POOL)
    lines = said(script)
    workers = [blocked for name, blocked, _ in lines if name == "worker"]
    trackers = [ignored for name, _, ignored in lines if name == "tracker"]
    assert len(workers) == 4
    assert all(has(blocked, signal.SIGINT) for blocked in workers)
    assert len(trackers) == 2
    assert all(has(ignored, signal.SIGHUP) for ignored in trackers)


def test_a_ctrl_c_that_is_ignored_stays_so_when_polars_takes_it(tmp_path):
    """As of a program that a script runs in the background."""
    rows = "\n".join(f"{0.1 * k:.1f},{k % 7},{(k // 3) % 5}" for k in range(200))
    (tmp_path / "log.csv").write_text(f"time_s,u_V,y_m\n{rows}\n")
    former = signal.signal(signal.SIGINT, signal.SIG_IGN)  # the child inherits it
    try:
        lines = said("-c", IGNORED, cwd=tmp_path)
    finally:
        signal.signal(signal.SIGINT, former)
    code, loaded, before, ignored = lines[-1]
    assert (code, loaded, before) == ("0", "True", "True")
    assert has(ignored, signal.SIGINT)
