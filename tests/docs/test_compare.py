"""docs/compare.md: its table is one of scripts/studies/verdicts.py, its definitions are the code's."""

import re
import runpy
from pathlib import Path

from twin.compare.departure import DEFINITIONS, NAMES
from twin.compare.effects import TABLE
from twin.compare.standins import NOTHING

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs" / "compare.md").read_text(encoding="utf-8")


def rows(after: str) -> list[list[str]]:
    """Cells of the first table after a mark, without its heading."""
    lines = PAGE.partition(after)[2].lstrip("\n").splitlines()
    table = lines[2 : next(k for k, line in enumerate(lines) if not line.startswith("|"))]
    return [[cell.strip() for cell in line.strip("|").split("|")] for line in table]


def test_the_table_of_verdicts_adds_up():
    names, hits, total = [*TABLE, "other", "unknown", NOTHING], 0, 0
    found = rows("<!-- verdicts: made by scripts/studies/verdicts.py -->")
    assert [row[0].replace(" ", "_") for row in found] == [*TABLE, NOTHING]
    for row in found:
        counts = dict(zip(names, (0 if cell == "–" else int(cell) for cell in row[1:]), strict=False))
        own, of = map(int, row[1 + len(names)].split(" of "))
        kind = row[0].replace(" ", "_")
        assert (counts[kind], sum(counts.values())) == (own, of)
        hits, total = (hits + own, total + of) if kind != NOTHING else (hits, total)
    assert f"{hits} of {total}" in PAGE


def test_the_table_is_what_the_script_makes(monkeypatch):
    monkeypatch.syspath_prepend(ROOT / "scripts")
    script = runpy.run_path(str(ROOT / "scripts" / "studies" / "verdicts.py"), run_name="verdicts")
    one = {"effect": "load", "named": "spring", "departure": 1.0}
    two = {"effect": "load", "named": "load", "departure": 0.5}
    (line,) = script["table"]([one, two]).splitlines()[2:]
    cells = [cell.strip() for cell in line.strip("|").split("|")]
    assert cells == ["load", "–", "–", "–", "–", "1", "–", "–", "–", "1", "–", "–", "1 of 2", "0.50 to 1.00"]


def test_the_table_of_foreign_legs_adds_up():
    """Right, one of several, unknown, nothing, wrong; of what compare does not know no name is right."""
    found = rows("<!-- foreign_legs: made by scripts/studies/foreign_legs.py -->")
    counts = [[0 if cell == "–" else int(cell) for cell in row[2:7]] for row in found]
    known = [row[1] == "yes" for row in found]
    assert all(sum(row) == sum(counts[0]) for row in counts)
    right, wrong = (
        [sum(row[k] for row, ours in zip(counts, known, strict=True) if ours == own) for own in (True, False)]
        for k in (0, 4)
    )
    assert right[1] == 0
    of = [sum(known) * sum(counts[0]), (len(known) - sum(known)) * sum(counts[0])]
    assert f"right on {right[0]} of {of[0]}" in PAGE
    assert f"a wrong cause is named on {wrong[1]} of {of[1]}" in " ".join(PAGE.split())


def test_regimes_are_defined_as_in_the_code():
    assert [(row[0], row[1]) for row in rows("the first that applies:")] == [
        (name, DEFINITIONS[name]) for name in NAMES
    ]


def test_pictures_exist_and_are_small():
    pictures = re.findall(r"\]\((compare-[\w-]+\.png)\)", PAGE)
    assert len(pictures) == 2
    for picture in pictures:
        assert (ROOT / "docs" / picture).stat().st_size < 150_000
