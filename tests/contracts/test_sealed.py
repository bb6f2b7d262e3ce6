"""What is kept so that work can go on: a row that is not what was written neither counts nor stops anything."""

import json
import math
import os
import signal
import subprocess
import sys

import numpy as np
import pytest

from sysid import IOData
from sysid.base.errors import InputError
from sysid.base.files import DAMAGED, UNSEALED, seal, unseal
from sysid.base.locks import file_lock, take_lock
from sysid.selection.journal import Journal
from sysid.selection.select import select
from sysid.selection.space import Space

SMALL = Space((1, 2), (1, 2), (1, 2), starts=1, structures=("output_error",), grows=False)
VALUES = {k: {"fit": 90.0 + k, "errors": [0.5, float("inf")], "why": "über"} for k in range(4)}


def record(N=500):
    rng = np.random.default_rng(5)
    u = np.repeat(rng.uniform(-1, 1, N // 5), 5)
    y = np.zeros(N)
    for k in range(2, N):
        y[k] = 1.3 * y[k - 1] - 0.4 * y[k - 2] + 0.1 * u[k - 1]
    return IOData(u, y + 0.02 * rng.standard_normal(N), Ts=0.1)


def written(path):
    book = Journal(path, record(), ("settings",))
    for k, values in VALUES.items():
        book.add(1, {"nb": k}, values)
    return path.read_bytes()


def found(path):
    book = Journal(path, record(), ("settings",))
    return {k: book.find(1, {"nb": k}) for k in VALUES if book.find(1, {"nb": k}) is not None}, book.notes


@pytest.fixture(scope="module")
def searched(tmp_path_factory):
    """The journal of a search, and its result."""
    path = tmp_path_factory.mktemp("search") / "journal.jsonl"
    return path, select(record(), SMALL, jobs=1, journal=path)


def changed(searched, tmp_path, change):
    """A search that goes on from a journal whose rows were changed."""
    head, *rows = searched[0].read_text().splitlines()
    path = tmp_path / "journal.jsonl"
    path.write_text("\n".join(change(head, rows)) + "\n")
    again = []
    result = select(record(), SMALL, jobs=1, journal=path, progress=lambda *told: again.append(told[2]))
    assert result.chosen.candidate == searched[1].chosen.candidate
    assert [row.fit_percent for row in result.rows] == [row.fit_percent for row in searched[1].rows]
    assert select(record(), SMALL, jobs=1, journal=path).notes == searched[1].notes  # mended: nothing is told twice
    return result.notes, again


def _better(row):
    """The row of a candidate that is suddenly perfect."""
    row["values"] |= {"fit": 100.0, "errors": [0.0] * len(row["values"]["errors"])}
    return row


def _worst(rows):
    return min(range(len(rows)), key=lambda k: json.loads(rows[k])["values"].get("fit", math.inf))


def test_a_value_changed_by_hand_does_not_change_the_winner(searched, tmp_path):
    def change(head, rows):
        k = _worst(rows)
        return [head, *rows[:k], json.dumps(_better(json.loads(rows[k]))), *rows[k + 1 :]]

    notes, again = changed(searched, tmp_path, change)
    assert any(note.startswith("1 row of the journal") and "run again" in note for note in notes)
    assert len(again) == 1


def test_two_results_of_one_candidate_are_told_and_it_is_run_again(searched, tmp_path):
    def change(head, rows):
        row = _better(json.loads(rows[_worst(rows)]))
        row.pop("check", None)
        return [head, *rows, json.dumps(seal(row, json.loads(head)["of"]))]

    notes, again = changed(searched, tmp_path, change)
    assert any("two different results" in note for note in notes)
    assert len(again) == 1


def test_the_same_row_twice_is_no_trouble(searched, tmp_path):
    notes, again = changed(searched, tmp_path, lambda head, rows: [head, *rows, *rows])
    assert notes == searched[1].notes
    assert again == []


def test_a_journal_joined_to_its_copy_has_no_row_of_an_older_version(tmp_path):
    path = tmp_path / "journal.jsonl"
    text = written(path)
    path.write_bytes(text + text)
    assert found(path) == (VALUES, ())


def test_a_journal_saved_with_a_byte_order_mark_goes_on(tmp_path):
    path = tmp_path / "journal.jsonl"
    path.write_bytes(b"\xef\xbb\xbf" + written(path))
    assert found(path) == (VALUES, ())
    Journal(path, record(), ("settings",)).add(1, {"nb": 9}, VALUES[0])
    assert found(path) == (VALUES, ())


def test_a_journal_of_an_older_version_is_told_and_run_again(searched, tmp_path):
    def change(head, rows):
        plain = [{name: value for name, value in json.loads(row).items() if name != "check"} for row in rows]
        return [json.dumps({**json.loads(head), "journal": 1}), *(json.dumps(row) for row in plain)]

    notes, again = changed(searched, tmp_path, change)
    assert any("older version" in note for note in notes)
    assert len(again) == len(searched[0].read_text().splitlines()) - 1


def test_a_journal_that_is_cut_anywhere_goes_on(tmp_path):
    whole = written(tmp_path / "whole.jsonl")
    path = tmp_path / "cut.jsonl"
    for end in range(len(whole)):
        path.write_bytes(whole[:end])
        values, notes = found(path)
        assert values == {k: VALUES[k] for k in range(max(0, whole[:end].count(b"\n") - 1))}, end
        assert notes == ()


def test_a_byte_changed_anywhere_gives_no_other_value(tmp_path):
    whole = written(tmp_path / "whole.jsonl")
    path = tmp_path / "changed.jsonl"
    rng = np.random.default_rng(8)
    refused = 0
    for _ in range(250):
        at, byte = int(rng.integers(len(whole))), int(rng.integers(256))
        if whole[at] == byte:
            continue
        path.write_bytes(whole[:at] + bytes([byte]) + whole[at + 1 :])
        try:
            values, notes = found(path)
        except InputError:  # the first line: it says whose journal it is
            assert at <= whole.index(b"\n")
            refused += 1
            continue
        assert all(VALUES[k] == value for k, value in values.items()), (at, byte)
        assert len(values) == len(VALUES) or notes or at == len(whole) - 1, (at, byte)
    assert refused < 100


def test_a_row_of_another_journal_does_not_hold():
    line = json.dumps(seal({"key": "a", "values": 1.0}, "this"))
    assert unseal(line, "this") == ({"key": "a", "values": 1.0}, "")
    assert unseal(line, "that") == ({}, DAMAGED)
    assert unseal('{"key": 1}', "this") == ({"key": 1}, UNSEALED)
    for text in ("", "[1]", "null", "[" * 100_000, '{"check": 1}', "\ufffd"):
        assert unseal(text, "this")[1] == DAMAGED


HOLD = """
import sys, time
from sysid.base.locks import file_lock
with file_lock(sys.argv[1], str):
    print("held", flush=True)
    time.sleep(100)
"""
posix = pytest.mark.skipif(os.name != "posix", reason="Windows has no such locks")


@posix
def test_a_second_search_in_one_journal_is_told_of_the_first_and_a_killed_one_leaves_no_lock(tmp_path):
    journal = tmp_path / "search.jsonl"
    first = subprocess.Popen([sys.executable, "-c", HOLD, str(journal)], stdout=subprocess.PIPE, text=True)
    try:
        assert first.stdout.readline() == "held\n"
        with pytest.raises(InputError, match=rf"process {first.pid}\b.*give another path"):
            select(record(), SMALL, jobs=1, journal=journal)
        assert not journal.exists()
    finally:
        first.send_signal(signal.SIGKILL)
        first.communicate()
    with file_lock(journal, str):
        pass
    assert list(tmp_path.iterdir()) == []


@posix
def test_a_lock_is_one_s_own_until_it_is_given_back(tmp_path):
    lock = take_lock(tmp_path / "lock", str)
    with pytest.raises(InputError, match=f"process {os.getpid()}"):
        take_lock(tmp_path / "lock", lambda who: f"{who} has it")
    lock.close()
    lock.close()
    take_lock(tmp_path / "lock", str).close()
