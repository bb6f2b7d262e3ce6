"""What every saved or reported file stands on: JSON values, files whole or not at all, lines that survive a kill."""

import json
from pathlib import Path

import numpy as np
import pytest

from sysid import InputError, IOData
from sysid.base.files import Lines, atomic_file, json_value
from sysid.selection.journal import Journal


@pytest.mark.parametrize(
    ("value", "expected"),
    [
        (np.array([[1.5, np.nan], [np.inf, -0.0]]), "[[1.5, null], [null, -0.0]]"),
        ({"a": np.int64(3), "b": (np.bool_(True), False)}, '{"a": 3, "b": [true, false]}'),
        (np.array([1 + 2j]), "[[1.0, 2.0]]"),
        (complex(np.inf, 0), "[null, 0.0]"),
        ([None, "text", np.float32(0.5), np.arange(2)], '[null, "text", 0.5, [0, 1]]'),
    ],
)
def test_plain_values_are_what_json_holds(value, expected):
    assert json.dumps(json_value(value), allow_nan=False) == expected


def test_lines_survive_a_kill_in_the_middle_of_one(tmp_path):
    path = tmp_path / "lines"
    assert Lines(path).read() == []
    first = Lines(path)
    for line in ("one", "two", "dreißig"):
        first.append(line)
    path.write_bytes(path.read_bytes()[:-4])  # within the letter of two bytes and behind it
    assert Lines(path).read() == ["one", "two"]
    assert path.read_bytes().startswith(b"one\ntwo\ndrei")  # reading changes nothing
    again = Lines(path)
    again.append("three")
    again.append("four")
    assert path.read_text() == "one\ntwo\nthree\nfour\n"


def test_a_file_is_whole_or_as_it_was(tmp_path):
    path = tmp_path / "picture.png"
    with atomic_file(path) as temporary:
        temporary.write_bytes(b"first")
        assert temporary.suffix == ".png"  # some writers go by it, or add their own
        assert not path.exists()

    def interrupted() -> None:
        with atomic_file(path) as temporary:
            temporary.write_bytes(b"half")
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        interrupted()
    assert path.read_bytes() == b"first"
    assert [p.name for p in tmp_path.iterdir()] == ["picture.png"]
    plain_file = tmp_path / "plain"
    plain_file.touch()
    assert path.stat().st_mode == plain_file.stat().st_mode  # as the user's umask has it


def test_foreign_text_without_a_line_s_end_is_no_journal_and_is_left_alone(tmp_path):
    path = tmp_path / "notes"
    path.write_text("not a journal")
    data = IOData(np.arange(4.0), np.arange(4.0))
    with pytest.raises(InputError, match="not a journal"):
        Journal(path, data, ())
    assert path.read_text() == "not a journal"


def test_a_file_that_goes_while_it_is_read_has_no_lines(tmp_path, monkeypatch):
    """A run that ends puts its journal into the table and removes it, while a leaderboard reads both."""
    monkeypatch.setattr(Path, "exists", lambda self: True)
    assert Lines(tmp_path / "gone.journal").read() == []
