"""Which cases of a family run on which day."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from of_the_day import CASES, of_the_day

FAMILIES = {"a": 1, "b": CASES, "c": CASES + 1, "d": 5 * CASES + 3, "e": 590}
ITEMS = [(name, number) for name, size in FAMILIES.items() for number in range(size)]


def test_a_small_family_runs_every_day_and_a_large_one_in_parts():
    for day in (0, 1, 20_000):
        today, others = of_the_day(ITEMS, lambda item: item[0], day)
        assert sorted(today + others) == sorted(ITEMS)
        counts = {name: sum(item[0] == name for item in today) for name in FAMILIES}
        assert counts["a"] == 1
        assert counts["b"] == CASES
        assert all(CASES // 2 <= count <= CASES for name, count in counts.items() if name in "cde")


def test_days_in_turn_run_every_case():
    days = -(-max(FAMILIES.values()) // CASES)
    seen = {item for day in range(days) for item in of_the_day(ITEMS, lambda item: item[0], day)[0]}
    assert seen == set(ITEMS)


FAMILY = """
import pytest

@pytest.mark.parametrize("case", range(20))
def test_of_a_family(case):
    pass
"""


@pytest.mark.parametrize(("workers", "which", "run"), [("-n1", [], 7), ("-n0", ["test_family.py"], 20)])
def test_only_a_run_of_the_whole_suite_leaves_cases_out(tmp_path, workers, which, run):
    for name in ("conftest.py", "of_the_day.py", "often.py", "shares.py"):
        shutil.copy(Path(__file__).parent / name, tmp_path)
    (tmp_path / "test_family.py").write_text(FAMILY)
    (tmp_path / "pytest.ini").write_text("[pytest]\ntestpaths = test_family.py\npythonpath = .\n")
    environment = {k: v for k, v in os.environ.items() if not k.startswith(("PYTEST", "QPAL_FULL"))} | {"QPAL_DAY": "3"}
    command = [sys.executable, "-m", "pytest", "-q", workers, "-p", "no:cacheprovider", *which]
    text = subprocess.run(command, cwd=tmp_path, env=environment, capture_output=True, text=True).stdout
    assert f"{run} passed" in text
