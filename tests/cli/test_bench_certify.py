"""`qpal bench certify` as its user meets it: a table, a page, exit status 1 for a broken rule, sentences."""

import json
from pathlib import Path

import pytest

from twin.cli import main

METHOD = '''"""The mean."""
REQUIREMENTS = []


def fit(data):
    return Mean(data.model["start"])


class Mean:
    def __init__(self, start):
        self.details = {"values": start, "deviations": {}}

    def simulate(self, u, y_init):
        return 0.0 * u
'''


@pytest.fixture
def here(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_own_digits_and_the_sets_of_nist(here, capsys):
    assert main(["bench", "certify", "--record", "oe_fast", "--out", "page"]) == 0
    text = capsys.readouterr().out
    assert "NIST StRD" in text
    assert "from both starts. It holds." in " ".join(text.split())
    summary = json.loads((here / "page" / "summary.json").read_text())
    assert (len(summary["static"]), len(summary["dynamic"]), summary["violations"]) == (54, 4, [])
    assert {row["method"] for row in summary["dynamic"]} == {"stated", "stated_default"}
    assert min(row["parameters"] for row in summary["dynamic"] if row["method"] == "stated") > 8.0
    assert {path.name for path in (here / "page" / "figures").iterdir()} == {
        "records-lower.png", "sets-lower.png", "sets-average.png", "sets-higher.png"
    }  # fmt: skip
    assert "It holds." in (here / "page" / "report.html").read_text(encoding="utf-8")
    assert (here / "page" / "tables.md").read_text().startswith("| method | difficulty | fits |")


def test_a_method_of_ones_own(here, capsys):
    """It sees the stated model and its start, which is 0.95 of the certified value: 1.3 digits."""
    (here / "mine.py").write_text(METHOD)
    assert main(["bench", "certify", "mine.py", "--record", "oe_fast", "--json"]) == 0
    summary = json.loads(capsys.readouterr().out)
    far, near = summary["dynamic"]
    assert (far["parameters"], near["parameters"]) == (pytest.approx(0.4, abs=0.1), pytest.approx(1.3, abs=0.1))
    assert (near["rss"], near["deviations"], summary["judged"], summary["static"]) == (0.0, 0.0, False, [])


@pytest.mark.parametrize("record", ["wiener_gain", "hammerstein_square", "play_after"])
def test_scipy_on_the_stated_model(record, here, capsys):
    """A method with blocks and a search of its own has the digits of ours."""
    method = Path(__file__).parents[2] / "scripts" / "certificates" / "scipy_least_squares.py"
    assert main(["bench", "certify", str(method), "--record", record, "--json"]) == 0
    rows = json.loads(capsys.readouterr().out)["dynamic"]
    assert min(row["parameters"] for row in rows) > 6.0
    assert min(row["deviations"] for row in rows) > 4.0


def test_a_broken_rule_is_status_1(here, capsys, monkeypatch):
    monkeypatch.setattr("sysid.bench.certificate.grade.LEAST", 12.0)
    assert main(["bench", "certify", "stated", "--record", "oe_fast", "--out", "page"]) == 1
    text = capsys.readouterr().out
    assert "oe_fast, start 1: " in text
    assert "It holds." not in (here / "page" / "report.html").read_text(encoding="utf-8")
    assert len(json.loads((here / "page" / "summary.json").read_text())["violations"]) == 2


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (["nobody"], "unknown method 'nobody'"),
        (["--record", "nothing_*"], "no record is called nothing_*; there are hammerstein_coloured"),
        (["nowhere.py"], "there is no method file nowhere.py"),
    ],
)
def test_what_is_wrong_is_a_sentence(arguments, sentence, here, capsys):
    assert main(["bench", "certify", *arguments]) == 2
    assert sentence in " ".join(capsys.readouterr().err.split())
    assert not (here / "runs").exists()
