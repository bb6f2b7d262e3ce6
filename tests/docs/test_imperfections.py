"""The sections of the page of imperfections, which the site's build makes: their models, rows and pictures."""

import re
import sys
from pathlib import Path
from types import SimpleNamespace

import pytest

from twin import IMPERFECTIONS, JOINTS
from twin.parameters import TABLE as ROWS
from twin.signatures import TABLE, signatures

pytestmark = pytest.mark.pixels

DOCS = Path(__file__).parents[2] / "docs"


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """The folder that the build fills."""
    sys.path.insert(0, str(DOCS / "_site"))
    try:
        import imperfections

        source = tmp_path_factory.mktemp("docs")
        imperfections.write(SimpleNamespace(srcdir=source))
        return source / "generated" / "imperfections"
    finally:
        sys.path.remove(str(DOCS / "_site"))


@pytest.fixture(scope="module")
def sections(folder):
    parts = (folder / "sections.md").read_text(encoding="utf-8").split("\n## ")[1:]
    return {re.search(r"`(\w+)`$", part.splitlines()[0])[1]: part for part in parts}


def test_every_imperfection_has_its_section_in_order(sections):
    assert list(sections) == list(IMPERFECTIONS)
    for name, text in sections.items():
        assert "\nModel: " in text
        assert f"]({name}.png)" in text


def test_parameters_exist(sections):
    known = {row.name for row in ROWS}
    for text in sections.values():
        for shown in re.findall(r"`([\w.]+)`", re.search(r"^Parameters: (.*?)\n\n", text, re.M | re.S)[1]):
            named = [shown.replace("JOINT", joint) for joint in JOINTS]
            # What is in the shoulder's own words, or in the rod's, the other joints do not have.
            assert known & set(named), shown


def test_each_picture_is_shown_once_with_its_sentence(folder, sections):
    shown = [pair for text in sections.values() for pair in re.findall(r"!\[([^\]]+)\]\((\w+)\.png\)", text)]
    assert sorted(shown) == sorted((one.sentence, one.key) for one in signatures())
    assert {path.stem for path in folder.glob("*.png")} == set(TABLE)


def test_the_page_includes_them():
    page = (DOCS / "imperfections.md").read_text(encoding="utf-8")
    assert "```{include} generated/imperfections/sections.md\n:relative-images:\n```" in page


def test_the_table_has_measured_beside_true(folder):
    lines = (folder / "sections.md").read_text(encoding="utf-8").splitlines()
    rows = [[cell.strip() for cell in line.strip("|").split("|")] for line in lines if line[:2] == "| "]
    assert rows[0] == ["switch", "what is measured", "joint", "measured", "true", "unit"]
    for *_, measured, true, _ in rows[2:]:
        values = [float(text.replace("−", "-")) for text in (measured, true)]
        assert values[0] == pytest.approx(values[1], rel=0.1)
    assert {row[0] for row in rows[2:]} == set(IMPERFECTIONS)
