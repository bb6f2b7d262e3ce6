"""Corrupt logs: each is read with the right numbers, by an independent reading, or refused by one sentence.

The sentence names the file, the place, what was found and what to do. Never another exception, a warning, or a number
that is silently wrong.
"""

from pathlib import Path

import numpy as np
import pytest
from corrupt_cases import CASES, text
from foreign import FOREIGN
from hypothesis import given
from hypothesis import strategies as st
from often import FULL

from sysid.base.errors import InputError
from sysid.data.table import Table
from sysid.formats import TABLE, Delimited, JsonRecords, SerialCapture, read_table

# Formats that know their files by their first bytes; text is read as a table, as JSON or as a capture, whatever it is.
MARKED = sorted(suffix for suffix, kind in TABLE.items() if kind not in (Delimited, JsonRecords, SerialCapture))


def read(path: Path) -> tuple[Table | None, dict[str, np.ndarray], list[str]]:
    """Table, its columns that are numbers, and every refusal, of the file or of a column."""
    try:
        table = read_table(path)
    except InputError as error:
        return None, {}, [str(error)]
    found, refused = {}, []
    for name in table.names:
        try:
            found[name] = table.numbers(name)
        except InputError as error:
            refused.append(str(error))
    for sentence in refused:
        assert_a_sentence(sentence, path)
    return table, found, refused


def assert_a_sentence(said: str, path: Path) -> None:
    assert said.startswith(str(path)), said
    assert "\n" not in said
    assert "; " in said, said  # what to do
    assert len(said.removeprefix(str(path))) < 400


def test_there_are_enough_of_them():
    assert len(CASES) >= 60
    assert {Path(name).suffix for name, _, _ in CASES.values()} >= set(TABLE) - {".dat", ".ndjson", *MARKED}


DAMAGED = [pytest.param(name, marks=pytest.mark.nightly) if name == "a.mdf" else name for name in FOREIGN]  # as a.mf4
STRANGE = {
    f"{what} called {suffix[1:]}": (f"a{suffix}", content, ["not a "])
    for what, content in (("table", text()), ("noise", bytes(range(256)) * 8))
    for suffix in MARKED
}


@pytest.mark.parametrize(("name", "content", "expected"), (CASES | STRANGE).values(), ids=CASES | STRANGE)
def test_a_corrupt_log_is_read_right_or_refused(name, content, expected, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    path = tmp_path / name
    if path.suffix in (".mcap", ".bag", ".db3"):
        pytest.importorskip("rosbags")
    path.write_bytes(content)
    table, found, refused = read(path)
    if isinstance(expected, list):
        assert refused, f"{name} was read: {table and table.names}"
        assert_a_sentence(refused[0], path)
        for fragment in expected:
            assert fragment in refused[0]
    else:
        right, said = expected
        assert table is not None, refused
        for column, values in right.items():
            np.testing.assert_array_equal(found[column], values)
        for fragment in said:
            assert any(fragment in note for note in table.notes), table.notes
        assert bool(said) == bool([note for note in table.notes if "skipped" not in note]), table.notes
    assert [entry.name for entry in tmp_path.iterdir()] == [name]  # nothing was run or left


TIMES = 25 if FULL else 5


def truth() -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(3)
    return rng.integers(-500, 500, 80) / 100, rng.integers(100, 999, 80) / 10


@pytest.mark.parametrize("name", DAMAGED)
def test_a_cut_file_gives_no_wrong_number(name, tmp_path):
    """Cut at many places: the numbers that are read are the first ones, or a note says that the last may be wrong."""
    whole = tmp_path / name
    whole.parent.mkdir(exist_ok=True)
    FOREIGN[name](whole, *truth())
    content, suffix = whole.read_bytes(), whole.suffix
    _, right, refused = read(whole)
    assert right
    assert not refused
    for k, size in enumerate(np.linspace(1, len(content) - 1, TIMES).astype(int)):
        path = tmp_path / f"cut{k}{suffix}"
        path.write_bytes(content[:size])
        table, found, refused = read(path)
        for sentence in refused:
            assert_a_sentence(sentence, path)
        for column, values in found.items() if table else ():
            last = any("last" in note for note in table.notes)
            count = len(values) - 1 if last else len(values)
            # Groups whose times were one have times of their own where the cut leaves them of other lengths.
            column = column if column in right or not column.endswith(".time") else "time"
            whole_names = column in right
            assert whole_names or last, (column, table.notes)
            if whole_names:
                np.testing.assert_array_equal(values[:count], right[column][:count])


@pytest.mark.parametrize("name", DAMAGED)
def test_a_changed_byte_ends_in_a_table_or_a_sentence(name, tmp_path):
    whole = tmp_path / name
    FOREIGN[name](whole, *truth())
    content = bytearray(whole.read_bytes())
    rng = np.random.default_rng(1)
    for k in range(TIMES):
        path = tmp_path / f"changed{k}{whole.suffix}"
        changed = bytearray(content)
        for place in rng.integers(0, len(content), 3):
            changed[place] = rng.integers(0, 256)
        path.write_bytes(changed)
        table, _, refused = read(path)
        for sentence in refused if table is None else ():
            assert_a_sentence(sentence, path)


@given(content=st.binary(max_size=300), suffix=st.sampled_from(sorted(set(TABLE) - {".mcap", ".bag", ".db3"})))
def test_any_bytes_end_in_a_table_or_a_sentence(content, suffix, tmp_path_factory):
    path = tmp_path_factory.mktemp("any") / f"a{suffix}"
    path.write_bytes(content)
    table, _, refused = read(path)
    if table is None:
        assert_a_sentence(refused[0], path)


CELL = st.one_of(
    st.floats(allow_nan=False, allow_infinity=False, width=32).map(repr),
    st.integers(-(10**6), 10**6).map(str),
    st.sampled_from(["", " ", "x", "1_0", "nan", "-inf", "1e400", "1e-400", "+.5", "5.", "\u0662", "1,5", '"', "a b"]),
)


@given(rows=st.lists(st.lists(CELL, min_size=2, max_size=3), min_size=1, max_size=8), mark=st.sampled_from(",;\t"))
def test_a_text_table_reads_as_python_reads_its_cells(rows, mark, tmp_path_factory):
    """Whatever the cells are: a column that is numbers has those that float() makes of the split line."""
    lines = [mark.join(row) for row in rows]
    path = tmp_path_factory.mktemp("cells") / "a.csv"
    path.write_text("first" + mark + "second\n" + "\n".join(lines) + "\n", encoding="utf-8")
    table, found, refused = read(path)
    if table is None:
        assert_a_sentence(refused[0], path)
        return
    kept = [line for line in lines if line.strip() and not line.lstrip().startswith(("#", "%"))]
    for j, name in enumerate(table.names):
        if name in found and not any('"' in line for line in kept):
            cells = [line.split(mark)[j].strip() for line in kept]
            decimal = [cell.replace(",", ".") if table.decimal == "," else cell for cell in cells]
            assert found[name].tolist() == [float(cell) for cell in decimal]
