"""A sampling time that is given with a clock beside it: the rows are still those of one experiment, in their order."""

import numpy as np
import pytest

from sysid.base.errors import InputError
from sysid.workflow.record import read_record

N, TS = 240, 0.02
RNG = np.random.default_rng(8)
U = np.repeat(RNG.uniform(-2.0, 2.0, N // 8), 8).round(4)
Y = np.zeros(N)
for _k in range(1, N):
    Y[_k] = 0.9355 * Y[_k - 1] + 0.129 * U[_k - 1]
Y = Y.round(6)
K = np.arange(N)


def write(path, header, *columns):
    rows = [
        ",".join(cell if isinstance(cell, str) else f"{cell:.9g}" for cell in row) for row in zip(*columns, strict=True)
    ]
    path.write_text("\n".join([header, *rows]) + "\n")
    return path


@pytest.mark.parametrize("name", ["sample", "index", "n", "row", "frame", "seq", "count", "k"])
@pytest.mark.parametrize("last", [0, 1])
def test_a_counter_of_samples_that_falls_stands_newest_first(name, last, tmp_path):
    path = write(tmp_path / "a.csv", f"{name},u_V,y_rad", K[::-1] + last, U[::-1], Y[::-1])
    record = read_record(path, Ts=TS)
    np.testing.assert_array_equal(record.data.y[:, 0], Y)
    assert any("turned round" in note for note in record.notes)


def test_a_counter_that_wraps_stands_newest_first(tmp_path):
    millis = (65000 + 20 * K) % 65536
    record = read_record(write(tmp_path / "a.csv", "millis,u_V,y_rad", millis[::-1], U[::-1], Y[::-1]))
    np.testing.assert_array_equal(record.data.y[:, 0], Y)
    assert record.data.Ts == pytest.approx(TS)


@pytest.mark.parametrize("given", [{}, {"Ts": TS}])
def test_experiments_that_stand_newest_first(given, tmp_path):
    """Of which the newest is the first part of the file."""
    t = np.concatenate([TS * np.arange(100), TS * np.arange(140)])
    record = read_record(write(tmp_path / "a.csv", "time_s,u_V,y_rad", t[::-1], U[::-1], Y[::-1]), **given)
    assert record.data.lengths == (100, 140)
    np.testing.assert_array_equal(record.data.y[:, 0], Y)


def test_a_number_of_frames_that_starts_again_parts_experiments(tmp_path):
    frames = np.concatenate([np.arange(100), np.arange(140)])
    record = read_record(write(tmp_path / "a.csv", "frame_index,u_V,y_rad", frames, U, Y), Ts=TS)
    assert record.data.lengths == (100, 140)


def test_a_clock_that_starts_more_often_than_the_number_of_experiments_counts(tmp_path):
    t = np.concatenate([TS * np.arange(80)] * 3)
    number = np.repeat([1, 2], [160, 80])
    path = write(tmp_path / "a.csv", "experiment,t,u_V,y_rad", number, t, U, Y)
    assert read_record(path, Ts=TS).data.lengths == read_record(path).data.lengths == (80, 80, 80)


@pytest.mark.parametrize("header", ["time_s,u_V,y_rad", "u_V,y_rad"])
def test_rates_of_their_own_need_a_clock(header, tmp_path):
    """Rows of 20 ms with an output in every fourth: a sampling time may be that of the rows or of the output."""
    y = [f"{value:g}" if k % 4 == 0 else "" for k, value in enumerate(Y)]
    columns = (TS * K, U, y) if header.startswith("time") else (U, y)
    path = write(tmp_path / "a.csv", header, *columns)
    with pytest.raises(InputError, match=r"y_rad, u_V have values in other rows.*leave --ts out where a column is"):
        read_record(path, Ts=TS, input="u_V", output="y_rad", missing="mark")
    if header.startswith("time"):
        assert read_record(path).data.Ts == pytest.approx(4 * TS)  # the way that is named


def test_a_second_clock_that_is_later_throughout_is_told(tmp_path):
    """A time since 1970 is the same time; one that is a second later may be that of the output alone."""
    notes = {}
    for shift in (0.0, 1.0, 1.7e9):
        path = write(tmp_path / "a.csv", "board_time,cmd_V,host_time,meas_rad", TS * K, U, TS * K + shift, Y)
        record = read_record(path, input="cmd_V", output="meas_rad")
        np.testing.assert_array_equal(record.data.y[:, 0], Y)
        notes[shift] = " ".join(record.notes)
    assert "1 s later in every row" in notes[1.0]
    assert "if each has its own, name it as clock of [[input]] and of [[output]]" in notes[1.0]
    assert "in every row" not in notes[0.0] + notes[1.7e9]


def test_lost_rows_that_a_counter_shows_are_told(tmp_path):
    kept = np.delete(K, [50, 51, 130])
    path = write(tmp_path / "a.csv", "frame,u_V,y_rad", kept, U[kept], Y[kept])
    assert any("'frame' skips 3 number(s), the first before row 52" in note for note in read_record(path, Ts=TS).notes)


def test_rows_out_of_the_order_of_their_clock_are_no_record_and_both_ways_out_work(tmp_path):
    order = np.random.default_rng(0).permutation(N)
    path = write(tmp_path / "a.csv", "t,u_V,y_rad", TS * K[order], U[order], Y[order])
    with pytest.raises(InputError, match=r"not in the order of column 't'.*sort the rows by it and leave --ts out"):
        read_record(path, Ts=TS)
    head, *rows = path.read_text().splitlines()
    path.write_text("\n".join([head, *sorted(rows, key=lambda row: float(row.split(",")[0])), ""]))
    np.testing.assert_array_equal(read_record(path).data.y[:, 0], Y)
    mapping = tmp_path / "m.toml"
    mapping.write_text('[clock]\ncolumn = ""\nTs = 0.02\n[[input]]\ncolumn = "u_V"\n[[output]]\ncolumn = "y_rad"\n')
    path = write(tmp_path / "b.csv", "t,u_V,y_rad", TS * K[order], U, Y)
    np.testing.assert_array_equal(read_record(path, mapping=mapping).data.y[:, 0], Y)
