"""Every log of the corpus is read with the right numbers, or refused with the right sentence."""

from dataclasses import replace

import pytest
from corpus import LOGS, PARTS, Refused, Right
from corpus.judged import difference, judge, written

from sysid.base.errors import InputError
from sysid.workflow.record import read_record


@pytest.mark.parametrize(
    "entry",
    [
        pytest.param(entry, id=name, marks=pytest.mark.xfail(strict=True, reason=entry.fails) if entry.fails else ())
        for name, entry in LOGS.items()
    ],
)
def test_a_log_gives_the_right_numbers_or_the_right_sentence(entry, tmp_path):
    path = written(entry, tmp_path)
    try:
        record = read_record(path, **entry.options)
    except InputError as error:
        said = str(error)
        assert path.name in said or said.startswith("--")  # a wrong option
        assert "\n" not in said
        assert len(said) < 2000
        if isinstance(entry.answer, Refused):
            for fragment in entry.answer.fragments:
                assert fragment in said
        else:
            assert entry.answer.or_refused, said
        return
    assert not isinstance(entry.answer, Refused), "it was read"
    assert difference(record.data, entry.answer) == ""


def test_the_corpus_is_large_and_no_name_stands_for_two_logs():
    assert len(LOGS) == sum(len(part.LOGS) for part in PARTS) >= 150
    assert all(len(entry.content) < 20_000 for entry in LOGS.values())


def test_each_word_of_the_counts_is_told_from_the_others(tmp_path):
    """A log with its own answer, with another one, and with the answer of a refused one in each other's place."""
    right = next(e for e in LOGS.values() if isinstance(e.answer, Right) and not e.options and e.file == "a.csv")
    refused = next(e for e in LOGS.values() if isinstance(e.answer, Refused) and e.file == "a.csv")
    assert judge(right, tmp_path)[0] == "right"
    assert judge(refused, tmp_path)[0] == "refused"
    assert judge(replace(right, answer=refused.answer), tmp_path) == ("wrong", "it was read")
    assert judge(replace(right, answer=Right(Ts=0.2)), tmp_path) == ("wrong", "Ts is 0.1, not 0.2")
    assert judge(replace(right, options={"odd": 1}), tmp_path)[1].startswith("TypeError")
