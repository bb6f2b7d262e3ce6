"""Which tests and cases run on which day."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from of_the_day import CASES, DAYS, of_the_day

SIZES = {"a": 1, "b": CASES, "c": DAYS * CASES + 1, "d": 590} | {f"single{k}": 1 for k in range(200)}
ITEMS = [(name, number) for name, size in SIZES.items() for number in range(size)]


@pytest.mark.parametrize("day", [0, 1, 20_000])
def test_a_day_has_half_of_all_and_no_more_than_some_cases_of_a_test(day):
    today, others = of_the_day(ITEMS, lambda item: item[0], lambda item: "", day)
    assert sorted(today + others) == sorted(ITEMS)
    assert today == [item for item in ITEMS if item in today]
    counts = {name: sum(item[0] == name for item in today) for name in SIZES}
    assert counts["b"] == CASES // DAYS
    assert CASES // 2 <= counts["c"] <= CASES
    assert CASES // 2 <= counts["d"] <= CASES
    assert 70 < sum(counts[f"single{k}"] for k in range(200)) < 130


def test_days_in_turn_run_every_case():
    def days(n):
        return {
            item for day in range(3, 3 + n) for item in of_the_day(ITEMS, lambda item: item[0], lambda item: "", day)[0]
        }

    assert days(-(-590 // CASES)) == set(ITEMS)
    assert {item for item in ITEMS if item[0] != "d"} - days(DAYS + 1) == set()


def test_what_builds_on_each_other_runs_on_one_day():
    for day in (0, 1):
        today, _ = of_the_day(ITEMS, lambda item: item[0], lambda item: "page" * (item[0] == "d"), day)
        assert sum(item[0] == "d" for item in today) in (0, 590)
    days = [of_the_day(ITEMS, lambda item: item[0], lambda item: "page" * (item[0] == "d"), k)[0] for k in range(DAYS)]
    assert sum(("d", 0) in today for today in days) == 1


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
