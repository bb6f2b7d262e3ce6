"""docs/imperfections.md is what the table of imperfections makes it; its rows and pictures exist, its numbers hold."""

import re
from pathlib import Path

import pytest

from twin import IMPERFECTIONS, JOINTS
from twin.parameters import TABLE as ROWS
from twin.report.signatures import MARKS, markdown, sizes
from twin.signatures import TABLE, signatures

DOCS = Path(__file__).parents[2] / "docs"
PAGE = (DOCS / "imperfections.md").read_text(encoding="utf-8")
SECTIONS = {re.search(r"`(\w+)`$", part.splitlines()[0])[1]: part for part in PAGE.split("\n## ")[1:]}  # type: ignore[index]
PARAMETERS = {name: re.search(r"^Parameters: (.*?)\n\n", text, re.M | re.S) for name, text in SECTIONS.items()}


def test_every_imperfection_has_its_section_in_order():
    assert list(SECTIONS) == list(IMPERFECTIONS)


@pytest.mark.parametrize("name", SECTIONS)
def test_a_section_says_how_it_enters_and_shows_it(name):
    assert "\nModel: " in SECTIONS[name]
    assert f"](imperfections-{name}.png)" in SECTIONS[name]


@pytest.mark.parametrize("name", SECTIONS)
def test_parameters_exist(name):
    assert PARAMETERS[name] is not None
    known = {row.name for row in ROWS}
    for shown in re.findall(r"`([\w.]+)`", PARAMETERS[name][1]):
        named = [shown.replace("JOINT", joint) for joint in JOINTS]
        # What is in the shoulder's own words, or in the rod's, the other joints do not have.
        assert known & set(named), shown


def test_pictures_exist_and_are_small():
    shown = re.findall(r"!\[[^\]]+\]\((imperfections-\w+\.png)\)", PAGE)
    assert sorted(shown) == sorted(f"imperfections-{key}.png" for key in TABLE)
    assert sorted(path.name for path in DOCS.glob("imperfections-*.png")) == sorted(shown)
    assert sum((DOCS / name).stat().st_size for name in shown) < 600_000


def test_the_page_is_what_the_script_makes():
    """All but the measured numbers, which the next test compares: another processor may round differently."""
    start = PAGE.index(MARKS[0])
    made = markdown(signatures())

    def unmeasured(text: str) -> list[str]:
        lines = text.splitlines()
        return ["|".join(line.split("|")[:4] + line.split("|")[5:]) if line[:2] == "| " else line for line in lines]

    assert unmeasured(PAGE[start:]) == unmeasured(made)


def test_the_table_is_what_the_signatures_say():
    rows = [[cell.strip() for cell in line.strip("|").split("|")] for line in PAGE.splitlines() if line[:2] == "| "]
    grid = sizes(signatures()).only(*rows[0])
    assert [row[:3] + row[4:] for row in rows[2:]] == [[*row[:3], *row[4:]] for row in grid.rows]
    measured = [[float(row[3].replace("−", "-")) for row in table] for table in (rows[2:], grid.rows)]
    assert measured[0] == pytest.approx(measured[1], rel=0.01)  # another processor may round differently on the way
