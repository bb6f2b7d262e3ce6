"""What all tests share: where public records lie, and how long statistical runs are."""

import os
from pathlib import Path

import pytest
from hypothesis import settings

settings.register_profile("qpal", deadline=None, max_examples=20, derandomize=True)
settings.load_profile("qpal")

RECORDS = Path(os.environ.get("QPAL_RECORDS") or Path(__file__).resolve().parents[2] / "shared" / "data")


@pytest.fixture(scope="session")
def records() -> Path:
    """Folder of public benchmark records, which the project does not ship."""
    if not RECORDS.is_dir():
        pytest.skip("the public benchmark records are neither beside the project (../shared/data) nor in $QPAL_RECORDS")
    return RECORDS


@pytest.fixture(scope="session")
def seeds() -> range:
    """Seeds of a statistical test: 100 with QPAL_FULL=1, a dozen otherwise."""
    return range(100 if os.environ.get("QPAL_FULL") == "1" else 12)
