"""What scripts/attack/soak.py calls grown: memory beyond 5 % after the warm-up, and handles that have become more."""

import runpy
from pathlib import Path

import pytest

from sysid.channels import conversion

SCRIPT = Path(__file__).resolve().parents[2] / "scripts" / "attack" / "soak.py"
ROW = {"rss": 100_000, "descriptors": 10, "threads": 2, "system_threads": 4, "children": 0}


@pytest.fixture(scope="module")
def judged():
    return runpy.run_path(str(SCRIPT), run_name="soak")["judged"]


def test_what_stays_is_flat_and_a_peak_in_the_middle_is_none(judged):
    rows = [dict(ROW) for _ in range(40)]
    rows[20]["rss"] *= 2
    rows[-1]["system_threads"] += 1  # a library's thread that is about to end
    assert judged(rows)["wrong"] == []


def test_growth_of_memory_and_of_each_handle_is_told(judged):
    grown = [{**ROW, "rss": 100_000 + 200 * k} for k in range(40)]
    assert judged(grown)["wrong"] == ["memory has grown by 6.6 %"]
    for name in ("descriptors", "threads", "system_threads", "children"):
        rows = [{**ROW, name: ROW[name] + k // 8} for k in range(40)]
        assert judged(rows)["wrong"] == [f"{name} were {ROW[name]} and are {ROW[name] + 4}"]


def test_units_that_were_never_seen_before_are_not_kept_for_ever():
    for k in range(3000):
        conversion.convert(f"[nothing {k}]")
    assert conversion._convert.cache_info().currsize <= 1024
