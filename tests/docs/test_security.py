"""SECURITY.md: what it promises is tested by tests that exist."""

import re
from pathlib import Path

ROOT = Path(__file__).parents[2]
SAID = (ROOT / "SECURITY.md").read_text(encoding="utf-8")


def test_every_test_that_is_named_exists():
    code = "\n".join(path.read_text(encoding="utf-8") for path in (ROOT / "tests").rglob("test_*.py"))
    named = set(re.findall(r"`(test_\w+)`", SAID))
    assert len(named) > 10
    assert not [name for name in named if f"def {name}(" not in code]


def test_every_file_that_is_named_exists():
    named = set(re.findall(r"`((?:tests|twin|sysid|scripts)/[\w/]+\.py)`", SAID))
    assert len(named) > 5
    assert not [name for name in named if not (ROOT / name).is_file()]
