"""Every refusal of the corpus is taken at its word: what it names leads to a record, or asks for another file."""

import pytest
from corpus import LOGS
from corpus.remedies import dead_end, first, said


@pytest.mark.parametrize("name", LOGS)
def test_a_refusal_names_a_way_that_works(name, tmp_path):
    attempt = first(LOGS[name])
    if sentence := said(attempt, tmp_path):
        assert dead_end(attempt, sentence, tmp_path) == ""


def test_a_dead_end_would_be_found(tmp_path):
    attempt = first(next(entry for entry in LOGS.values() if entry.file == "a.csv"))
    assert dead_end(attempt, "a.csv: this cannot be read", tmp_path).startswith("no remedy")
