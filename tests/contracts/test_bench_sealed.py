"""Rows of a benchmark's table that are not what was written: refused on reading, run again when the run goes on."""

import json

import polars as pl
import pytest

from sysid.base.errors import InputError
from sysid.base.files import seal
from sysid.bench.table import BELONGS, COLUMNS, EVERY, KEY, Table, read, write


def row(seed, fit=90.0):
    empty = {pl.String: "", pl.Int64: 0, pl.Float64: float("nan")}
    values = {name: empty[kind] for name, kind in COLUMNS.items()}
    return values | {"scenario": "drawn/x", "method": "m", "seed": seed, "status": "ok", "fit": fit + seed}


@pytest.fixture
def table(tmp_path):
    """A table with seeds 0 and 1 in the file, and 2 and 3 in the journal of a run that was killed."""
    made = Table(tmp_path / "t.parquet")
    write(pl.DataFrame([row(0), row(1)], schema=COLUMNS), made.path)
    for seed in (2, 3):
        made.add(row(seed))
    assert EVERY > 2
    return made


def seeds(table):
    return sorted(key[2] for key in table.row_keys())


def lines(table):
    return table.path.with_suffix(".journal").read_text().splitlines()


def damage(table, change):
    table.path.with_suffix(".journal").write_text("\n".join(change(lines(table))) + "\n")


def goes_on(table):
    """The seeds that a run finds there, its notes, and the seeds that are there afterwards."""
    with (again := Table(table.path)).writing():
        found = seeds(again)
    return found, again.notes, seeds(Table(table.path))


def test_a_table_and_its_journal_that_nobody_touched(table):
    assert seeds(table) == [0, 1, 2, 3]
    assert goes_on(table) == ([0, 1, 2, 3], (), [0, 1, 2, 3])
    assert read(table.path)["fit"].to_list() == [90.0, 91.0, 92.0, 93.0]


def test_a_changed_value_in_the_file_is_refused_and_run_again(table):
    kept = pl.read_parquet(table.path)
    better = pl.when(pl.col("seed") == 1).then(99.9).otherwise(pl.col("fit")).alias("fit")
    kept.with_columns(better).write_parquet(table.path)
    with pytest.raises(InputError, match=r"row 2 of .*t\.parquet .*qpal bench run"):
        read(table.path)
    found, notes, after = goes_on(table)
    assert found == after == [0, 2, 3]
    assert "row 2" in notes[0]


@pytest.mark.parametrize(
    "change",
    [
        lambda rows: [rows[0].replace('"fit": 92.0', '"fit": 99.9'), rows[1]],
        lambda rows: [*rows, json.dumps(seal(row(2, 5.0), BELONGS))],
        lambda rows: [rows[0][:-20], rows[1]],
        lambda rows: ["null", rows[1]],
        lambda rows: [json.dumps(row(2, 9.0)), rows[1]],
    ],
    ids=["value", "twice", "cut", "null", "no check sum"],
)
def test_a_changed_journal_is_refused_and_the_row_run_again(table, change):
    damage(table, change)
    with pytest.raises(InputError, match=r"t\.journal .*qpal bench run"):
        read(table.path)
    found, notes, after = goes_on(table)
    assert found == after == [0, 1, 3]
    assert "t.journal" in notes[0]


def test_the_same_line_twice_is_no_trouble(table):
    damage(table, lambda rows: [*rows, rows[0]])
    assert goes_on(table) == ([0, 1, 2, 3], (), [0, 1, 2, 3])


def test_two_rows_of_one_key_in_the_file_both_go(table):
    kept = pl.read_parquet(table.path)
    other = pl.DataFrame([row(1, 5.0)], schema=COLUMNS)
    write(pl.concat([kept.select(list(COLUMNS)), other]), table.path)
    assert goes_on(table)[2] == [0, 2, 3]


def test_a_table_of_an_older_version_is_read_and_its_journal_run_again(table):
    """Rows of a journal without check sums may be what a disk left of rows with one: a fuzzer cut the sum out of a row
    and the other rows away."""
    pl.read_parquet(table.path).select(list(COLUMNS)).write_parquet(table.path)
    damage(table, lambda rows: [json.dumps(row(2)), json.dumps(row(3))])
    with pytest.raises(InputError, match=r"line 1 of .*t\.journal .*\(2 in all\).*qpal bench run"):
        read(table.path)
    found, notes, after = goes_on(table)
    assert found == after == [0, 1]
    assert len(notes) == 1
    assert read(table.path).select(KEY).height == 2


def test_one_row_whose_sum_was_cut_out_is_no_row(table):
    damage(table, lambda rows: [json.dumps(row(2, 9.0))])
    assert goes_on(table)[2] == [0, 1]


def test_the_same_row_twice_in_the_file_is_no_trouble(table):
    kept = pl.read_parquet(table.path)
    pl.concat([kept, kept]).write_parquet(table.path)
    assert goes_on(table) == ([0, 1, 2, 3], (), [0, 1, 2, 3])
    assert read(table.path)["fit"].to_list() == [90.0, 91.0, 92.0, 93.0]


@pytest.mark.parametrize("column", ["fit", "seed"])
def test_text_among_the_numbers_is_no_table_of_results(table, column):
    pl.read_parquet(table.path).with_columns(pl.lit("a").alias(column)).write_parquet(table.path)
    with pytest.raises(InputError, match="has a column of another type"):
        read(table.path)
