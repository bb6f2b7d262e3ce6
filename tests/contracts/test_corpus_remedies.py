"""Every refusal of the corpus is taken at its word: what it names leads to a record, or asks for another file."""

import re
from pathlib import Path

import pytest
from corpus import LOGS
from corpus.remedies import ANOTHER, TEXTS, Try, first, followed

from sysid.base.errors import InputError
from sysid.workflow.record import read_record

MOST = 60  # remedies one after the other: no file of the corpus has more bad cells


def said(attempt: Try, folder: Path) -> str:
    """The refusal, without the folder; nothing for a record."""
    path, options = attempt.arguments(folder)
    try:
        read_record(path, **options)
    except InputError as error:
        return str(error).replace(f"{folder}/", "")
    return ""


def check(attempt: Try, sentence: str, folder: Path, before: frozenset[tuple[str, bytes]]) -> None:
    """Follows each remedy of the sentence until there is a record; fails at a dead end and where one comes back."""
    tries = list(followed(attempt, sentence))
    by_program = Path(attempt.entry.file).suffix not in TEXTS
    assert tries or by_program or re.search(ANOTHER, sentence), f"no remedy in: {sentence}"
    for changed in tries:
        following = said(changed, folder)
        if not following:
            continue
        key = (following, changed.content)
        assert key not in before, f"comes back: {following}"
        assert len(before) < MOST
        check(changed, following, folder, before | {key})


@pytest.mark.parametrize("name", LOGS)
def test_a_refusal_names_a_way_that_works(name, tmp_path):
    attempt = first(LOGS[name])
    if sentence := said(attempt, tmp_path):
        check(attempt, sentence, tmp_path, frozenset({(sentence, attempt.content)}))


def test_a_dead_end_would_be_found(tmp_path):
    attempt = first(next(entry for entry in LOGS.values() if entry.file == "a.csv"))
    with pytest.raises(AssertionError, match="no remedy"):
        check(attempt, "a.csv: this cannot be read", tmp_path, frozenset())
