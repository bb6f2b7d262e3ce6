"""`qpal info --signatures`: how each imperfection shows, in the report, in the summary and on the terminal."""

import json

import pytest

from twin.cli import main
from twin.signatures import TABLE


def test_report_and_summary_hold_every_signature(tmp_path, capsys):
    (tmp_path / "wide.toml").write_text('"shoulder.backlash" = 0.03\n', encoding="utf-8")
    arguments = ["info", "--signatures", "--params", str(tmp_path / "wide.toml"), "--out", str(tmp_path / "out")]
    assert main(arguments) == 0
    assert "width of the loop" in capsys.readouterr().out
    summary = json.loads((tmp_path / "out" / "summary.json").read_text(encoding="utf-8"))
    shown = {one["key"]: one for one in summary["signatures"]}
    assert list(shown) == list(TABLE)
    (loop,) = shown["backlash"]["sizes"]
    assert loop["true"] == 0.03
    assert loop["measured"] == pytest.approx(0.03, rel=2e-3)
    assert shown["contact"]["sizes"][0]["off"] is None  # nothing there to measure
    html = (tmp_path / "out" / "report.html").read_text(encoding="utf-8")
    assert all(one["sentence"].replace("'", "&#39;") in html for one in shown.values())
    figures = {path.stem for path in (tmp_path / "out" / "figures").iterdir()}
    assert figures >= {f"signature-{key}" for key in TABLE}
