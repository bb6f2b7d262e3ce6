"""The page of the house: its rooms are the rooms, its tables exist, its code runs and finds the truth."""

import importlib
import re
import runpy
from pathlib import Path

import numpy as np
from test_architecture import FLOORS

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs" / "house.md").read_text(encoding="utf-8")


def test_the_tables_of_rooms_are_made_from_the_rooms():
    house = runpy.run_path(str(ROOT / "scripts" / "house.py"))
    assert house["page_with_rooms"](PAGE) == PAGE, "run python scripts/house.py rooms"
    assert PAGE.count("\n| `") == sum(len(floor) for floors in FLOORS.values() for floor in floors)


def test_every_place_for_something_new_exists():
    places = re.findall(r"\| `((?:sysid|twin)/[\w/.]+\.py)` (?:\(`(\w+)`\) )?\|$", PAGE, flags=re.MULTILINE)
    assert len(places) >= 10
    for place, table in places:
        module = importlib.import_module(place.removesuffix(".py").replace("/", ".").removesuffix(".__init__"))
        assert any(hasattr(module, name) for name in ([table] if table else ["TABLE", "VERBS"])), place


def test_the_block_of_the_page_is_found_again(tmp_path):
    (code,) = re.findall(r"^```python\n(.*?)^```", PAGE, flags=re.DOTALL | re.MULTILINE)
    (tmp_path / "page.py").write_text(code, encoding="utf-8")
    fit = runpy.run_path(str(tmp_path / "page.py"))["fit"]
    std = np.array([p.std for p in fit.parameters])
    assert np.all(np.abs(fit.theta - [2.0, 8.0, 0.05]) < 5.0 * std)
