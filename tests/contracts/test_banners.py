"""Lines above the names of a table of text: a title, an operator, a rate. The numbers are those of the table alone."""

from pathlib import Path

import numpy as np
import pytest

from sysid.channels.guess import guess
from sysid.formats import read_table

TABLE = "time_s,u,y\n" + "".join(f"{0.02 * k:.2f},{k % 7},{0.5 * (k % 5)}\n" for k in range(60))


@pytest.mark.parametrize(
    "banner",
    [
        "Motor test bench\nOperator: Jane\n",
        "Motor test bench v2\n\n",
        "Sample rate,50\nOperator,Jane\n",
        "Sample rate,50,\nOperator,Jane,\n\n",
        "Log file created 2026-03-01 10:00, by Jane\n",
        "Test 12,,\nBench A,,\n,,\n",
        "Motor,,Sensor\n",
    ],
)
@pytest.mark.parametrize("suffix", [".csv", ".txt"])
def test_what_stands_above_the_names_is_left_out(tmp_path: Path, banner: str, suffix: str):
    plain, headed = tmp_path / f"plain{suffix}", tmp_path / f"headed{suffix}"
    plain.write_text(TABLE)
    headed.write_text(banner + TABLE)
    expected, table = read_table(plain), read_table(headed)
    assert table.names == expected.names
    for name in table.names:
        np.testing.assert_array_equal(table.numbers(name), expected.numbers(name))
    row = banner.count("\n") + 1
    assert table.rows[0][0] == row + 1
    assert any(note == f"skipped what stands above the names, which are in row {row}" for note in table.notes)
    assert table.comments == tuple(line for line in banner.split("\n") if line)
    assert guess(table).mapping == guess(expected).mapping


@pytest.mark.parametrize("head", ["time_s,,y\n", "time_s,,y\ns,V,rad\n"])
def test_names_that_lack_one_are_no_banner(tmp_path: Path, head: str):
    path = tmp_path / "a.csv"
    path.write_text(head + TABLE.partition("\n")[2])
    assert read_table(path).names == ("time_s", "2", "y")
