"""The cases of public reports give the right result; `scripts/known_logs.py --kinds reports` counts them."""

import pytest
from corpus.reports import FAILS, REPORTS, judge

QUICK = ("delay", "union", "joined_clock", "sign_bit", "episodes", "wheel")  # others fit larger structures


def marks(name):
    if name in FAILS:
        yield pytest.mark.xfail(strict=True, reason=FAILS[name])
    if name not in QUICK:
        yield pytest.mark.nightly


@pytest.mark.parametrize("name", [pytest.param(name, marks=[*marks(name)]) for name in REPORTS])
def test_a_reported_case_is_right(name, tmp_path):
    assert judge(REPORTS[name], tmp_path) == ("right", "")
