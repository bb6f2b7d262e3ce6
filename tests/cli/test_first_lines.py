"""A useless model is called so in the first lines, with the next command for this record; tables are complete."""

import re
import shlex
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.signal import lfilter

from sysid import IOData, select
from sysid.base.errors import InputError
from sysid.report.identify import _with_commands, ranking_grid
from sysid.selection.folds import folds
from sysid.selection.journal import Journal
from sysid.selection.select import _Work
from sysid.selection.table import BLOCKS, Row, Selection
from sysid.structures import TABLE, ActuatedJoint, OutputError, Wiener
from twin.cli import main


def test_the_page_and_the_console_begin_with_what_a_bad_model_is_good_for(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    u = np.repeat(np.random.default_rng(0).uniform(-1.0, 1.0, 150), 8)
    y = lfilter([0.0] * 20 + [0.3], [1.0, -1.2, 0.7], u) + 0.01 * np.random.default_rng(1).normal(size=1200)
    np.savetxt("my log.csv", np.column_stack([u, y]), delimiter=",")
    given = ["identify", "my log.csv", "--ts", "0.1", "--structure", "output_error", "--starts", "1", "--out", "out"]
    command = "qpal identify 'my log.csv' --ts 0.1 --structure output_error --orders 1,2,20"
    assert main([*given, "--orders", "1,2,1"]) == 0
    out = " ".join(capsys.readouterr().out.split())
    html = re.sub(r"<[^>]+>", " ", Path("out/report.html").read_text(encoding="utf-8").replace("&#39;", "'"))
    text = " ".join(html.split())
    assert re.search(r"Next, 9\d\.\d\d % instead of \d+\.\d\d %: qpal identify", out)
    for said in (text, out):
        reason = said.index("Do not use this model: the output responds after 20")
        assert said.index("poor") < reason < said.index(command)
        assert said.index(command) < said.index("(residuals: ")
        assert said.count(f"%: {command}") == 1  # the advice on the record says the command too
    assert text.index(command) < text.index("has a free-run fit on the validation data") < text.index("Search ")
    assert "Search " not in out  # it converged
    assert main([*given, "--orders", "1,2,20"]) == 0
    assert " ● good: of the validation data explained" in capsys.readouterr().out
    html = Path("out/report.html").read_text(encoding="utf-8")
    assert 'class="answer good"' in html
    assert "Do not use this model" not in html


def test_the_next_step_of_a_good_model_works(tmp_path, monkeypatch, capsys):
    """It names the saved model, and a file in the place of FILE is run."""
    monkeypatch.chdir(tmp_path)
    u = np.repeat(np.random.default_rng(0).uniform(-1.0, 1.0, 150), 8)
    y = lfilter([0.0, 0.3], [1.0, -0.7], u) + 0.01 * np.random.default_rng(1).normal(size=1200)
    np.savetxt("log.csv", np.column_stack([u, y]), delimiter=",")
    given = ["log.csv", "--ts", "0.1", "--structure", "output_error", "--orders", "1,1,1", "--starts", "1"]
    assert main(["identify", *given, "--out", "a folder"]) == 0
    (command,) = re.findall("Next, on another record: (.*)", capsys.readouterr().out)
    words = shlex.split(command.replace("FILE", "log.csv"))
    assert words[:2] == ["qpal", "run"]
    assert main([*words[1:], "--ts", "0.1", "--out", "again"]) == 0
    assert "● good" in capsys.readouterr().out


def test_commands_in_sentences_name_this_record():
    record = SimpleNamespace(path=Path("my log.csv"), options=("--ts", "0.1"), files=(), paths=(Path("my log.csv"),))
    assert _with_commands("record pulses (qpal design --for breakaway FILE).", record) == (
        "record pulses (qpal design --for breakaway 'my log.csv' --ts 0.1)."
    )
    assert _with_commands("see qpal design FILE or FILE", record) == "see qpal design 'my log.csv' --ts 0.1 or FILE"


def test_the_table_of_a_search_tells_of_every_structure_and_why_one_has_no_fit():
    """One row was judged, one was refused, one fell to the budget, one was not even begun."""
    rng = np.random.default_rng(0)
    data = IOData(rng.normal(size=600), rng.normal(size=600), 0.1)
    kinds = [OutputError, ActuatedJoint, Wiener, TABLE["nlarx"]]
    work = _Work(folds(data), "auto", 0, 1, None, Journal(None, data, ()), None, 0.0, 5.0)
    work.left_out = [Wiener(1, 1, 1)]
    errors = np.ones(BLOCKS)
    best = Row(OutputError(1, 1, 1), 90.0, 2, 1, errors, True, equal=True)
    refused = Row(ActuatedJoint(), -np.inf, 0, 1, errors * np.inf, False, why="too short for a joint; record longer")
    rows = [best, refused, *work.untried(kinds, {"output_error", "actuated_joint"})]
    result = SimpleNamespace(selection=Selection(tuple(rows), best, fit=None))
    table = {row[1].split("(")[0].strip(): row for row in ranking_grid(result).rows}
    assert len(table) == len(kinds)
    assert [row[-1] for row in table.values()] == [
        "chosen",
        "too short for a joint",
        "not tried: the budget of 5 s was over",
        "not tried: the budget of 5 s was over",
    ]
    assert rows[2].candidate == Wiener(1, 1, 1)
    assert "2 candidates" in ranking_grid(result).caption


def test_a_budget_that_ends_before_anything_is_tried_is_a_sentence():
    rng = np.random.default_rng(0)
    with pytest.raises(InputError, match="was over before any structure was tried; give the search more seconds"):
        select(IOData(rng.normal(size=600), rng.normal(size=600), 0.1), jobs=1, seconds=1e-6)
