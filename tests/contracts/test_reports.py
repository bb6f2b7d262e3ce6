"""The cases of public reports give the right result; `scripts/known_logs.py --kinds reports` counts them."""

import json
import subprocess
import sys
from pathlib import Path

import pytest
from corpus.found import LOGS
from corpus.reports import REPORTS, judge

QUICK = ("delay", "union", "joined_clock", "sign_bit", "episodes", "wheel")  # others fit larger structures


def marks(name):
    if name not in QUICK:
        yield pytest.mark.nightly


@pytest.mark.parametrize("name", [pytest.param(name, marks=[*marks(name)]) for name in REPORTS])
def test_a_reported_case_is_right(name, tmp_path):
    assert judge(REPORTS[name], tmp_path) == ("right", "")


def test_another_checkout_is_counted_by_the_same_words(tmp_path):
    """A folder without a product has no counts."""
    root, out = Path(__file__).parents[2], tmp_path / "counts.json"
    command = [sys.executable, "scripts/known_logs.py", "--kinds", "found", "--out", str(out), "--checkout"]
    subprocess.run([*command, str(root)], cwd=root, check=True)
    counts = json.loads(out.read_text())
    assert counts["total"] == {"n": len(LOGS), "right": 2, "refused": len(LOGS) - 2, "dead end": 0, "wrong": 0}
    assert list(counts["kinds"]) == ["found"]
    (tmp_path / "sysid").mkdir()
    (tmp_path / "sysid" / "__init__.py").write_text("raise SystemExit(3)")
    other = subprocess.run([*command, str(tmp_path)], cwd=root, capture_output=True, text=True, check=False)
    assert other.returncode == 1
    assert "ended with 3 before it had counts" in other.stderr
