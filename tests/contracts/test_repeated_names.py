"""Headers that name a column twice: a clock per signal, a column written twice, and two columns of one name."""

import numpy as np
import pytest
from plants_in_time import GAIN, TAU, level_at, pole_and_gain, response, steps

from sysid.base.errors import InputError
from sysid.channels.mapping import Channel, ChannelMap, Clock
from sysid.channels.reading import read_signals
from sysid.formats import read_table
from sysid.workflow.record import read_record

TS, SHIFT = 0.02, 0.0071
CHANGES, LEVELS = steps(3, 0.24, 12.0)
T = np.arange(0.0, 12.0 - 1e-9, TS)
U, LATE = level_at(T, CHANGES, LEVELS), response(T + SHIFT, CHANGES, LEVELS)


def write(path, head, *columns):
    np.savetxt(path, np.column_stack(columns), delimiter=",", header=head, comments="", fmt="%.12g")
    return path


def plant(record):
    return pole_and_gain(record.input[0].values, record.output[0].values)


def test_a_repeated_clock_behind_each_signal_is_its_clock(tmp_path):
    record = read_signals(write(tmp_path / "log.csv", "u,Time,y,Time", U, T, LATE, T + SHIFT))
    assert record.mapping.clock.column == "Time 2"
    assert plant(record) == pytest.approx((np.exp(-TS / TAU), GAIN), abs=1e-5)


def test_where_the_order_tells_no_pairs_the_mapping_that_the_note_names_reads_them(tmp_path):
    path = write(tmp_path / "log.csv", "Time,u,y,Time", T, U, LATE, T + SHIFT)
    note = "'Time 2' shows the same time, 0.0071 s later in every row"
    assert any(note in each and "clock of [[input]] and of [[output]]" in each for each in read_signals(path).notes)
    channels = {"input": [Channel(column="u", clock="Time")], "output": [Channel(column="y", clock="Time 2")]}
    record = read_signals(path, ChannelMap(clock=Clock(column="Time 2"), **channels))
    assert plant(record) == pytest.approx((np.exp(-TS / TAU), GAIN), abs=1e-5)


def test_a_column_that_is_written_twice_is_read_once(tmp_path):
    y = response(T, CHANGES, LEVELS)
    record = read_signals(write(tmp_path / "log.csv", "Time,u,y,Time,y", T, U, y, T, y))
    assert "two columns are called 'Time' and hold the same: one is read" in record.notes
    assert plant(record) == pytest.approx((np.exp(-TS / TAU), GAIN), abs=1e-5)


def test_two_signals_of_one_name_are_asked_for_by_names_that_work(tmp_path):
    y = response(T, CHANGES, LEVELS)
    path = write(tmp_path / "log.csv", "t,u,y (deg),y (deg)", T, U, -y, y)
    with pytest.raises(InputError, match=r"columns 'y \(deg\)', 'y 2 \(deg\)' may each be the output; name one"):
        read_record(path)
    record = read_record(path, output="y 2 (deg)").signals
    assert record.output[0].unit == "rad"
    np.testing.assert_allclose(record.output[0].values, np.radians(y))
    assert "two columns are called 'y (deg)': the later one is 'y 2 (deg)' here" in record.notes


def test_a_number_is_given_that_no_other_column_has(tmp_path):
    names = read_table(write(tmp_path / "log.csv", "t,u 2,u,u,u,[a],[a]", T, T, U, T, T * 2, T * 3, T * 4)).names
    assert names == ("t", "u 2", "u", "u 3", "u 4", "[a]", "[a] 2")


def test_a_signal_at_either_end_leaves_the_pairs_open(tmp_path):
    y = response(T, CHANGES, LEVELS)
    path = write(tmp_path / "log.csv", "u,Time,Time,y", U, T, T + SHIFT, y)
    assert any("Time 2" in note for note in read_signals(path).notes)
    path = write(tmp_path / "odd.csv", "u,Time,y,Time,w", U, T, y, T + SHIFT, np.cos(T))
    assert read_signals(path).mapping.clock.column == "Time"
