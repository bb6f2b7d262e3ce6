"""The benchmark's runner: one row a case, resumable after a kill, and a report that is a function of the file."""

import pytest

from sysid.base.errors import InputError
from sysid.bench import runner, scenarios
from sysid.bench.report import table
from sysid.bench.score import FIELDS
from sysid.systems import TABLE


def fake(case):
    return {
        **{k: str(v) for k, v in vars(case).items()},
        "fit": "98.9", "oracle": "99.0", "gap": str(0.01 * case.seed), "pole_errors_crb": "1.0;2.0",
        "seconds": "0.5", "iterations": "7", "evaluations": "9", "converged": "1",
    }  # fmt: skip


@pytest.fixture
def scored(monkeypatch):
    ran = []
    monkeypatch.setattr(runner, "score", lambda case: ran.append(case) or fake(case))
    return ran


def test_a_killed_run_goes_on_where_it_stopped(tmp_path, scored):
    path, cases = tmp_path / "new" / "bench.csv", scenarios.cases(range(2))
    assert len(cases) == 2 * len(TABLE) * 4
    assert runner.run(cases[:5], path) == 5
    whole = path.read_bytes()
    path.write_bytes(whole[:-9])  # killed within the fifth row
    assert len(runner.read(path)) == 4
    assert runner.run(cases, path) == len(cases) - 4
    assert scored[5] == cases[4]
    assert [tuple(r.values())[:4] for r in runner.read(path)] == [tuple(map(str, vars(c).values())) for c in cases]
    assert runner.run(cases, path) == 0


def test_files_that_are_no_results_are_refused(tmp_path):
    with pytest.raises(InputError, match="run the benchmark first"):
        runner.read(tmp_path / "none.csv")
    (tmp_path / "other.csv").write_text("a,b\n1,2\n")
    with pytest.raises(InputError, match="other columns"):
        runner.read(tmp_path / "other.csv")


def test_report_by_hand(tmp_path, scored):
    cases = [scenarios.Case("textbook", "own", 1, seed) for seed in (0, 1, 20)]
    runner.run(cases, tmp_path / "b.csv")
    rows = runner.read(tmp_path / "b.csv")
    assert tuple(rows[0]) == FIELDS
    last = table(rows).splitlines()[-1]
    # gaps 0, 0.01, 0.2: two of three below 0.1
    assert last.startswith("| textbook | own | 1 | 3 | 67 % | 0.0100 | 0.200 | 1.00, 2.00 | 0.500 |")


def test_one_real_case_comes_near_the_truth():
    from sysid.bench.score import score

    row = score(scenarios.Case("textbook", "own", 1, 0))
    assert float(row["gap"]) < 0.1
    assert all(float(e) < 4.0 for e in row["pole_errors_crb"].split(";"))
