"""Long logs: what a million rows more need of memory and of processor time, each reading in a process of its own."""

import os
import sys
import time
from pathlib import Path

import numpy as np
import polars
import pytest

from sysid import InputError
from sysid.data.table import Texts
from sysid.formats import read_table
from sysid.formats._cells import Layout, part

sys.path.append(str(Path(__file__).parents[2] / "scripts"))
from reading_speed import measured, write

FEW, MANY = 2_000_000, 8_000_000  # fewer say less: what the threads of a reader hold at once varies by 30 MiB
MOST = {"csv": 90.0, "empty": 130.0, "quoted": 90.0}  # [MiB] a million rows; 1 GiB for ten of them is 90
# Before: 123 (csv), 217 (empty), and 6 times the processor time of the same file without quotes.


@pytest.fixture(scope="module")
def cost(tmp_path_factory) -> dict[str, tuple[float, float]]:
    """[MiB] and [s] of processor time that a million rows more need, by kind of file."""
    folder, found = tmp_path_factory.mktemp("long"), {}
    for kind in MOST:
        few, many = (measured(write(folder / f"{rows}.csv", rows, kind), "record") for rows in (FEW, MANY))
        assert (few["rows"], many["rows"]) == (FEW, MANY) if kind != "empty" else many["rows"] <= MANY
        found[kind] = tuple((many[each] - few[each]) / (MANY - FEW) * 1e6 for each in ("peak_MiB", "processor_seconds"))
    return found


@pytest.mark.nightly
@pytest.mark.parametrize("kind", MOST)
def test_ten_million_rows_fit_in_memory(kind, cost):
    assert cost[kind][0] < MOST[kind]


@pytest.mark.nightly
def test_quotes_do_not_send_a_file_down_the_slow_path(cost):
    assert cost["quoted"][1] < 3.5 * max(cost["csv"][1], 0.2)


CELLS = ["1", " 2.5", "-3e2 ", "", "x", "nan", "1_0", "\u0661", "1,5", "inf", "1e400"]


@pytest.mark.parametrize("decimal", [".", ","])
def test_texts_that_polars_holds_are_the_numbers_that_python_reads(decimal):
    def number(text: str) -> float:
        try:
            return float("x" if "_" in text else text.replace(",", decimal and "." if decimal == "," else ","))
        except ValueError:
            return np.nan

    texts = Texts(polars.Series(CELLS))
    np.testing.assert_array_equal(texts.numbers(decimal), [number(text) for text in CELLS])
    assert list(texts) == [texts[k] for k in range(len(texts))] == texts[:] == CELLS
    assert list(texts.taken(np.array([4, 1]))) == ["x", " 2.5"]


ROWS = {  # rows of three cells that quotes make, and whether polars alone can split them
    "whole cells": (['"1","2","3"', '4,"5",6'], [["1", "2", "3"], ["4", "5", "6"]]),
    "a comma inside": (['"1,5",2,3', '4,5,"6"'], [["1,5", "2", "3"], ["4", "5", "6"]]),
    "a comma for a cell": (['"1,5",2', "4,5,6"], None),
    "a quote inside": (['"1""5",2,3', "4,5,6"], [['1"5', "2", "3"], ["4", "5", "6"]]),
    "blanks before": (['1, "2",3', "4,5,6"], [["1", "2", "3"], ["4", "5", "6"]]),
    "two to a cell": (['1,2,"3', '4",5,6'], None),
    "empty": (['"",2,3', "4,5,6"], [["", "2", "3"], ["4", "5", "6"]]),
}


@pytest.mark.parametrize("name", ROWS)
def test_quotes_are_those_of_the_csv_module(name):
    lines, right = ROWS[name]
    block = ("\n".join(lines) + "\n").encode()
    if right is None:
        with pytest.raises(InputError, match="row 1"):
            part(Path("a.csv"), 1, block, Layout(",", 3, 1))
        return
    found = part(Path("a.csv"), 1, block, Layout(",", 3, 1)).columns
    assert [
        [cell.strip() for cell in row] for row in zip(*(column.to_list() for column in found), strict=True)
    ] == right


def test_a_cell_without_a_value_leaves_the_other_numbers_as_they_are(tmp_path):
    rows = [f"{k / 10},{k % 7}.25,{k % 5}" for k in range(400)]
    rows[123] = "12.3,,3"
    (tmp_path / "a.csv").write_text("t,u,y\n" + "\n".join(rows) + "\n")
    table = read_table(tmp_path / "a.csv")
    with pytest.raises(InputError, match="row 125, column 'u': found an empty cell"):
        table.numbers("u")
    found = table.columns[1].numbers()
    np.testing.assert_array_equal(np.flatnonzero(np.isnan(found)), [123])
    np.testing.assert_array_equal(np.delete(found, 123), np.delete(np.arange(400) % 7 + 0.25, 123))


@pytest.mark.parametrize("fill", ["hole", "zeros", "carriage returns"])
def test_a_file_without_line_ends_is_not_read_to_its_end(fill, tmp_path):
    """A few rows and a hole of a gigabyte; rows that end with the carriage return alone are rows."""
    path = tmp_path / "a.csv"
    rows = b"t,u,y\n" + b"".join(b"%.2f,%d,%d\n" % (0.01 * k, k % 5, k % 7) for k in range(200))
    if fill == "carriage returns":
        rows += b"".join(b"%.2f,%d,%d\n" % (0.01 * k, k % 5, k % 7) for k in range(200, 600_000))
        path.write_bytes(rows.replace(b"\n", b"\r"))
        assert len(read_table(path).columns[0]) == 600_000
        return
    path.write_bytes(rows + b"0" * ((6 << 20) if fill == "zeros" else 0))
    os.truncate(path, 1 << 30 if fill == "hole" else path.stat().st_size)
    began = time.perf_counter()
    with pytest.raises(
        InputError, match=r"binary bytes, the first in row 202" if fill == "hole" else r"row 202: .* 4 MB"
    ):
        read_table(path)
    assert time.perf_counter() - began < 5.0
