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
    names, hits, total = [*TABLE, NOTHING], 0, 0
    found = rows("<!-- verdicts: made by scripts/studies/verdicts.py -->")
    assert [row[0].replace(" ", "_") for row in found] == names
    for k, row in enumerate(found):
        counts = [0 if cell == "–" else int(cell) for cell in row[1 : 1 + len(names)]]
        own, of = map(int, row[1 + len(names)].split(" of "))
        assert (counts[k], sum(counts)) == (own, of)
        hits, total = (hits + own, total + of) if row[0] != NOTHING else (hits, total)
    assert f"{hits} of {total}" in PAGE
    assert hits >= 0.9 * total


def test_the_table_is_what_the_script_makes(monkeypatch):
    monkeypatch.syspath_prepend(ROOT / "scripts")
    script = runpy.run_path(str(ROOT / "scripts" / "studies" / "verdicts.py"), run_name="verdicts")
    one = {"effect": "load", "named": "friction", "departure": 1.0}
    two = {"effect": "load", "named": "load", "departure": 0.5}
    (line,) = script["table"]([one, two]).splitlines()[2:]
    cells = [cell.strip() for cell in line.strip("|").split("|")]
    assert cells == ["load", "1", "–", "–", "–", "1", "–", "–", "–", "1 of 2", "0.50 to 1.00"]


def test_regimes_are_defined_as_in_the_code():
    assert [(row[0], row[1]) for row in rows("the first that applies:")] == [
        (name, DEFINITIONS[name]) for name in NAMES
    ]


def test_pictures_exist_and_are_small():
    pictures = re.findall(r"\]\((compare-[\w-]+\.png)\)", PAGE)
    assert len(pictures) == 2
    for picture in pictures:
        assert (ROOT / "docs" / picture).stat().st_size < 150_000
