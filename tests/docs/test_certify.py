"""docs/certify.md: its counts and its tables are those of the command."""

import re
from pathlib import Path

import pytest

from sysid.bench.certificate import static
from sysid.bench.certificate.grade import LEAST, grades
from sysid.bench.certificate.record import FOLDER, records
from sysid.bench.certificate.stated import METHODS
from sysid.report.certificate import dynamic_grid, static_grid

PAGE = (Path(__file__).parents[2] / "docs" / "certify.md").read_text(encoding="utf-8")


def table(heading: str) -> list[list[str]]:
    block = PAGE[PAGE.index(f"| {heading} |") :].split("\n\n")[0]
    return [[cell.strip() for cell in line.strip("|").split("|")] for line in block.splitlines()]


def test_counts_are_those_of_the_records():
    found = records()
    proved = sum(record.is_global for record in found.values())
    assert f"{len(found)} reference records of its own" in PAGE
    assert f"On {proved} small records" in PAGE
    assert f"On the other {len(found) - proved} no search" in PAGE
    assert LEAST == 6.0
    readme = (FOLDER / "README.md").read_text(encoding="ascii")
    kinds = {block["kind"] for record in found.values() for block in record.blocks}
    assert kinds <= set(re.findall(r"^- (\w+): ", readme, flags=re.MULTILINE))


def same(shown: list[list[str]], grid, words: int) -> None:
    """Equal but for digits that rounding decides."""
    assert shown[0] == list(grid.headings)
    for before, now in zip(shown[2:], grid.rows, strict=True):
        assert before[: words + 1] == list(now[: words + 1])
        pairs = [(a, b) for a, b in zip(before[words + 1 :], now[words + 1 :], strict=True)]
        assert [float(a) for a, _ in pairs] == pytest.approx([float(b) for _, b in pairs], abs=1.5)


def test_tables_are_those_of_the_command():
    same(table("method | difficulty"), dynamic_grid(grades(METHODS, records().values())), 2)
    sets = [static.grade(each, start) for each in static.references().values() for start in (1, 2)]
    same(table("difficulty | start"), static_grid(sets), 2)
