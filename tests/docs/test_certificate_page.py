"""docs/certificate.md is what its numbers say, of the data that lie here; nothing is typed."""

import copy
import json
import platform
import re
from pathlib import Path

import pytest

from sysid.bench.certificate import grade, record, release, static
from sysid.bench.certificate.stated import METHODS
from sysid.report import release as report
from twin.cli import main

DOCS = Path(__file__).parents[2] / "docs"
PAGE = (DOCS / "certificate.md").read_text(encoding="utf-8")
NUMBERS = json.loads((DOCS / "certificate.json").read_text(encoding="ascii"))


def test_the_page_is_that_of_its_numbers():
    assert report.page(NUMBERS) == PAGE


def test_the_numbers_are_those_of_the_data_that_lie_here():
    fresh = release.certificate([], [], [])
    for name in ("NIST's sets", "dynamic records", "counts of intervals"):
        assert NUMBERS["sha256"][name] == fresh["sha256"][name]
    assert NUMBERS["intervals"] == fresh["intervals"]
    assert {row["record"] for row in NUMBERS["dynamic"]} == set(record.records())
    assert {row["name"] for row in NUMBERS["static"]} == set(static.references())


def test_digits_of_a_record_are_those_of_the_page():
    name = "oe_fast"
    (row,) = [grade.grade(METHODS[0], record.records()[name], 1)]
    known = next(r for r in NUMBERS["dynamic"] if (r["record"], r["method"], r["start"]) == (name, "stated", 1))
    assert row.parameters == pytest.approx(known["parameters"], abs=1.5)  # rounding of another processor


def test_it_names_versions_and_the_kind_of_machine_and_neither_host_nor_path():
    for word in ("| numpy |", "| scipy |", "| numba |", "| BLAS |", "| cores |", "| processor |"):
        assert word in PAGE
    assert len(re.findall(r"`[0-9a-f]{64}`", PAGE)) == 4
    assert re.search(r"^20\d\d-\d\d-\d\d, ", PAGE, re.MULTILINE)
    machine = json.dumps(release.machine())
    assert platform.node() not in machine.split('"')
    assert not re.search(r"[(| ]/\w+/", PAGE + machine)


def test_a_changed_file_or_name_has_another_hash(tmp_path, monkeypatch):
    monkeypatch.setattr(release, "_PACKAGE", tmp_path)
    (tmp_path / "a").write_text("1")
    (tmp_path / "b").write_text("2")
    hashes = [release.digest(tmp_path.iterdir())]
    (tmp_path / "b").write_text("3")
    hashes.append(release.digest(tmp_path.iterdir()))
    (tmp_path / "b").rename(tmp_path / "c")
    hashes.append(release.digest(tmp_path.iterdir()))
    assert len(set(hashes)) == 3
    assert hashes[-1] == release.digest(sorted(tmp_path.iterdir(), reverse=True))


def counts(n, outside):
    """20 rows of n cases, of which so many leave their band."""
    row = {"structure": "wiener", "noise": "white", "kind": "pole", "open": 1, "n": n - 1}
    row |= {"departure": 0.1, "held": [0.5, 0.9, 0.95, 0.99]}
    return [{**row, "inside": k >= outside} for k in range(20)]


def test_each_rule_says_whether_it_holds():
    numbers = copy.deepcopy(NUMBERS) | {"violations": [], "intervals": counts(500, 4)}
    digits, spread = report.verdicts(numbers)
    assert digits.endswith("It holds.")
    assert "4 of 20. It holds: 4 do." in spread  # 5 or more of 20 happen in 0.3 % of certificates, 4 or more in 1.6 %
    assert "It DOES NOT HOLD: 5 do." in report.verdicts(numbers | {"intervals": counts(500, 5)})[-1]
    assert "the fewest are 499: 0 do." in report.verdicts(numbers | {"intervals": counts(499, 0)})[-1]
    broken = report.verdicts(numbers | {"violations": ["oe_fast, start 1: 2.0 digits."]})
    assert broken[0].endswith("It DOES NOT HOLD.")
    assert broken[1] == "oe_fast, start 1: 2.0 digits."


def test_the_command_prints_it(capsys):
    assert main(["--certificate"]) == 0
    assert capsys.readouterr().out == PAGE


def test_without_a_certificate_the_command_that_makes_one_is_named(monkeypatch, capsys):
    monkeypatch.setattr("sysid.bench.certificate.release.page_file", lambda: None)
    assert main(["--certificate"]) == 2
    assert "qpal bench certify --page FILE.md makes one" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--page", "page.txt"], "for example page.md"),
        (["--page", "no/page.md"], "there is no folder no"),
        (["--page", "page.md", "--record", "oe_*"], "leave --record and NAME out"),
        (["stated", "--page", "page.md"], "leave --record and NAME out"),
    ],
)
def test_a_page_that_cannot_be_is_refused_before_the_work(words, said, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert main(["bench", "certify", *words]) == 2
    assert said in capsys.readouterr().err
    assert not list(tmp_path.iterdir())


def test_the_command_writes_the_page_and_its_numbers(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    one = {"oe_fast": record.records()["oe_fast"]}
    monkeypatch.setattr("sysid.bench.certificate.record.records", lambda: one)
    assert main(["bench", "certify", "--page", "page.md", "--out", "made"]) == 0
    assert "Certificate: page.md" in capsys.readouterr().out
    numbers = json.loads((tmp_path / "page.json").read_text(encoding="ascii"))
    assert report.page(numbers) == (tmp_path / "page.md").read_text(encoding="utf-8")
    assert {row["record"] for row in numbers["dynamic"]} == {"oe_fast"}
