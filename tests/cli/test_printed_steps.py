"""The next steps that `qpal compare` and `qpal bench report` print are commands that run."""

import shlex
from types import SimpleNamespace

import polars as pl
import pytest

from sysid.bench import presentation
from sysid.bench.table import read
from twin.calibrate.leg import row_name
from twin.cli import main
from twin.cli.bench import all_families, selected_cells
from twin.compare.structures import CAUSES
from twin.log import Log
from twin.parameters import JOINTS
from twin.report import compare_words

RECORDS = {cause.record: cause for cause in CAUSES.values()}


def verdict(name):
    return SimpleNamespace(named=[SimpleNamespace(effect=name)])


def command_of(sentence: str) -> list[str]:
    """The words of the command that a sentence ends with."""
    return shlex.split(sentence[sentence.index("qpal ") :])[1:]


@pytest.mark.parametrize("record", RECORDS)
def test_the_input_of_a_record_to_play_comes_as_a_file(record, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    words = command_of(compare_words._to_play(RECORDS[record], "thigh"))
    assert main([*words, "--duration", "2", "--out", "out"]) == 0
    assert Log.load("input.csv").u.std() > 0.0


@pytest.mark.parametrize("joint", JOINTS)
def test_a_cause_is_calibrated_aligned_or_played(joint):
    """Every cause has a step whose last words are a command, and names of parameters that the twin has."""
    for name, cause in CAUSES.items():
        words = command_of(compare_words._next(verdict(name), joint, "'a log.csv' --map MAP.toml"))
        assert words[0] in ("calibrate", "compare", "simulate"), name
        if words[0] == "calibrate":
            names = words[words.index("--free") + 1].split(",")
            assert [row_name(joint, row) for row in names] == names, cause.words
        assert words[0] == "simulate" or words[1] == "a log.csv"


def test_a_task_of_the_leaderboard_is_run_again(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    step = presentation.command("drawn/output_error", "output_error", 5, 20.0)
    assert main([*shlex.split(step)[1:], "--workers", "1"]) == 0
    rows = read("runs/again.parquet")
    assert rows["seed"].to_list() == [5]
    assert rows.filter(pl.col("status") == "ok").height == 1


def test_more_tasks_of_a_family_are_those_of_the_family():
    for name, family in all_families(None).items():
        words = shlex.split(presentation._more(name))
        pattern = words[words.index("--scenario") + 1]
        cells = selected_cells(None, [pattern], None, None, None, None, None)
        assert {cell.scenario for cell in cells} == set(family.scenarios()), name
    words = shlex.split(presentation._more("drawn-short"))
    pattern = words[words.index("--scenario") + 1]
    cells = selected_cells(None, [pattern], None, None, None, None, None)
    assert cells
    assert all(cell.scenario.endswith("-short") for cell in cells)
