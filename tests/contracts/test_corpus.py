"""Every log of the corpus is read with the right numbers, or refused with the right sentence."""

from pathlib import Path

import numpy as np
import pytest
from corpus import LOGS, PARTS, Log, Refused

from sysid.base.errors import InputError
from sysid.workflow.record import read_record


def written(entry: Log, folder: Path) -> Path:
    for name, content in {**entry.beside, entry.file: entry.content}.items():
        (folder / name).write_bytes(content)
    return folder / entry.file


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
    assert record.data.Ts == pytest.approx(entry.answer.Ts, rel=1e-6)
    for found, right in ((record.data.u, entry.answer.u), (record.data.y, entry.answer.y)):
        assert found.shape == (len(right), 1)
        np.testing.assert_allclose(found[:, 0], right, rtol=1e-9, atol=1e-12)


def test_the_corpus_is_large_and_no_name_stands_for_two_logs():
    assert len(LOGS) == sum(len(part.LOGS) for part in PARTS) >= 150
    assert all(len(entry.content) < 20_000 for entry in LOGS.values())
