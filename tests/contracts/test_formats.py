"""Every format of recorded files: what it writes it reads, bit for bit, and it says what it cannot."""

import numpy as np
import pytest

from sysid.base.errors import InputError
from sysid.formats import FORMATS, TABLE, WRITTEN, read_header, read_table, write_table

# Numbers that a decimal form of too few digits changes, and the largest and smallest that a log may hold.
VALUES = np.array([0.1 + 0.2, -1.0 / 3.0, 1e-300, 1e99, 0.0, 12345678.9012345678, np.nextafter(1.0, 2.0)])


@pytest.mark.parametrize("kind", FORMATS, ids=lambda kind: kind.__name__)
def test_a_format_says_what_it_reads_and_writes(kind):
    missing = [each for each in ("suffixes", "written", "headed") if each not in vars(kind)]
    assert not missing, f"{kind.__name__} does not say {', '.join(missing)}; written is () where it only reads"
    assert set(kind.written) <= set(kind.suffixes)
    assert all(suffix == suffix.lower() and suffix[0] == "." for suffix in kind.suffixes)


def test_no_suffix_belongs_to_two_formats():
    assert sorted(suffix for kind in FORMATS for suffix in kind.suffixes) == list(TABLE)


@pytest.mark.parametrize("suffix", WRITTEN)
def test_numbers_names_and_header_come_back(suffix, tmp_path):
    columns = {"time_s": np.arange(7) * 0.1, "u_V": VALUES, "y_rad": -VALUES[::-1]}
    header = '{"joint": "thigh", "said": "5 \u00b0, "so""}'
    path = write_table(tmp_path / f"table{suffix}", columns, header)
    assert [entry.name for entry in tmp_path.iterdir()] == [path.name]
    table = read_table(path)
    assert set(table.names) == set(columns)
    for name, values in columns.items():
        np.testing.assert_array_equal(table.numbers(name), values)
    assert read_header(path) == (header if TABLE[suffix].headed else "")


@pytest.mark.parametrize("suffix", [*sorted(set(TABLE) - set(WRITTEN)), ".xyz", ""])
def test_what_is_not_written_is_refused_with_what_is(suffix, tmp_path):
    with pytest.raises(InputError, match=f"table{suffix}: .* end its name in {', '.join(WRITTEN)}"):
        write_table(tmp_path / f"table{suffix}", {"u": VALUES})
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("suffix", TABLE)
def test_suffixes_in_capitals_are_the_same(suffix, tmp_path):
    path = tmp_path / f"TABLE{suffix.upper()}"
    path.touch()
    with pytest.raises(InputError, match="is empty"):
        read_table(path)
