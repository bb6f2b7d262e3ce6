"""docs/certify.md: its counts and its tables are those of the command."""

import json
import re
from pathlib import Path

import numpy as np
import pytest

import sysid
from sysid.bench.certificate import static
from sysid.bench.certificate.digits import fewest
from sysid.bench.certificate.grade import LEAST, grades
from sysid.bench.certificate.record import FOLDER, STARTS, chain_of, records
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
    assert f"On the other {len(found) - proved} none of 30" in PAGE
    second = [json.loads((FOLDER / f"{name}.json").read_text(encoding="ascii")).get("second_minimum") for name in found]
    assert [bool(each) for each in second].count(True) == 1
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


@pytest.mark.parametrize("methods", [METHODS[:1], pytest.param(METHODS, marks=pytest.mark.nightly)])
def test_tables_are_those_of_the_command(methods):
    shown = table("method | difficulty")
    names = [each.name for each in methods]
    rows = [*shown[:2], *(row for row in shown[2:] if row[0] in names)]
    same(rows, dynamic_grid(grades(methods, records().values())), 2)
    sets = [static.grade(each, start) for each in static.references().values() for start in (1, 2)]
    same(table("difficulty | start"), static_grid(sets), 2)


def test_searches_have_the_counts_of_the_page():
    """Of the two that differ most and are quick."""
    counts = dict.fromkeys(("auto", "lm"), 0)
    for record in records().values():
        for start in STARTS:
            model = record.task(start).model
            chain, values = chain_of(model), {**model["fixed"], **model["start"]}
            for search in counts:
                point = np.array([values[name] for name in chain.names])
                theta = sysid.fit(chain, record.data, start=point, options=static.EXACT, search=search).theta
                ours = dict(zip(chain.names, theta, strict=True))
                agreed = fewest((ours[name] for name in record.parameters), record.parameters.values())
                counts[search] += agreed >= LEAST
    shown = " ".join(PAGE.split())
    auto, lm = (int(n) for n in re.search(r"six digits in (\d+), `lm` in (\d+)", shown).groups())
    assert counts == {"auto": pytest.approx(auto, abs=1), "lm": pytest.approx(lm, abs=1)}  # another processor
