"""What runs by default and what with QPAL_FULL=1 only: some seeds of a statistical test, some cases of a family."""

import os
from collections.abc import Iterable
from typing import Any

import pytest

FULL = os.environ.get("QPAL_FULL") == "1"


def often(every: int, some: int) -> range:
    """The first `some` of `every` seeds, or all of them in a full run."""
    return range(every if FULL else some)


def by_day(cases: Iterable[Any], *day: Any) -> list[Any]:
    """Cases for `parametrize`, of which those that are not among `day` stand on the nightly list.

    A case is one value, or a tuple of the values of several names.
    """
    every = list(cases)
    assert all(case in every for case in day), "a case that runs by day is a case"
    return [case if case in day else _by_night(case) for case in every]


def _by_night(case: Any) -> Any:
    return pytest.param(*(case if isinstance(case, tuple) else (case,)), marks=pytest.mark.nightly)
