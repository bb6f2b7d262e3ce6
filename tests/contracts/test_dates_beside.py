"""A date beside a time of day: a pause of whole days is seen, and a date that says nothing more changes nothing."""

import datetime

import numpy as np
import pytest

from sysid import InputError
from sysid.formats import read_table
from sysid.workflow.record import read_record

N = 120
K = np.arange(N)
RNG = np.random.default_rng(0)
U, Y = np.round(RNG.normal(size=N), 3), np.round(np.cos(0.1 * K), 3)
DATES = ("%Y-%m-%d", "%d.%m.%Y", "%Y%m%d", "%m/%d/%Y", "%Y-%m-%d 00:00:00")


def rig(path, times, date, of=lambda at: at):
    rows = (f"{of(at):{date}},{at:%H:%M:%S},{a},{b}\n" for at, a, b in zip(times, U, Y, strict=True))
    path.write_text("Date,Time,u,y\n" + "".join(rows))
    return path


def every(step, start=datetime.datetime(2026, 3, 20, 9), pause=0):
    return [start + datetime.timedelta(days=pause * int(k >= 60), seconds=step * int(k)) for k in K]


@pytest.mark.parametrize("date", DATES)
@pytest.mark.parametrize("pause", [1, 2])
def test_a_pause_of_whole_days_parts_experiments(date, pause, tmp_path):
    path = rig(tmp_path / "rig.csv", every(1, pause=pause), date)
    record = read_record(path, input="u", output="y")
    assert (record.data.lengths, record.data.Ts) == ((60, N - 60), 1.0)
    assert any("rows 2 to 61 (60 samples), rows 62 to" in note for note in record.notes)


@pytest.mark.parametrize("date", DATES)
@pytest.mark.parametrize("step", [25 * 3600, 86400, 30 * 3600])
def test_steps_of_a_day_and_more_are_read(date, step, tmp_path):
    """25 hours were one."""
    record = read_record(rig(tmp_path / "rig.csv", every(step, datetime.datetime(2026, 5, 20, 9)), date))
    assert (len(record.data.u), record.data.Ts) == (N, step)
    assert any("'Date' and 'Time' were read together" in note for note in record.notes)


@pytest.mark.parametrize("date", [*DATES, "%d.%m.%y", "%d/%m/%Y"])
@pytest.mark.parametrize("start", [datetime.datetime(2026, 3, 5, 9), datetime.datetime(2026, 3, 5, 23, 59, 30)])
def test_a_date_that_changes_at_midnight_changes_nothing(date, start, tmp_path):
    record = read_record(rig(tmp_path / "rig.csv", every(1, start), date))
    assert (len(record.data.u), record.data.Ts) == (N, 1.0)


def test_the_date_of_the_start_in_all_rows_changes_nothing(tmp_path):
    start = datetime.datetime(2026, 3, 5, 23, 59, 30)
    record = read_record(rig(tmp_path / "rig.csv", every(1, start), "%Y-%m-%d", lambda at: start))
    assert (len(record.data.u), record.data.Ts) == (N, 1.0)


@pytest.mark.parametrize("date", ["%d.%m.%y", "%d/%m/%Y"])
def test_a_date_that_cannot_be_read_and_jumps_is_a_sentence(date, tmp_path):
    times = every(1, datetime.datetime(2026, 3, 5, 9), pause=2)
    with pytest.raises(InputError, match=r"'Date' beside it changes in row 62 .* one column"):
        read_record(rig(tmp_path / "rig.csv", times, date))


@pytest.mark.parametrize("date", ["%Y-%m-%d", "%d.%m.%Y", "%m/%d/%Y", "%d/%m/%Y"])
@pytest.mark.parametrize("clock", ["%H:%M", "%I:%M %p"])
def test_hours_and_minutes_beside_a_date_are_a_time_of_day(date, clock, tmp_path):
    """12:05 alone may be 12 min 5 s; a sample a minute goes over midnight to the 15th, which is no month."""
    path = tmp_path / "rig.csv"
    times = every(60, datetime.datetime(2026, 3, 14, 23, 20))
    rows = (f"{at:{date}},{at:{clock}},{a},{b}\n" for at, a, b in zip(times, U, Y, strict=True))
    path.write_text("Date,Time,u,y\n" + "".join(rows))
    record = read_record(path)
    assert (len(record.data.u), record.data.Ts) == (N, 60.0)
    assert any("'Date' and 'Time' were read together" in note for note in record.notes)


def test_a_date_with_points_is_no_number_to_correct(tmp_path):
    path = tmp_path / "rig.csv"
    rows = (f"{at:%d.%m.%Y},{at:%H:%M:%S},{a},{b}\n" for at, a, b in zip(every(60), U, Y, strict=True))
    path.write_text("Date,Time,Valve,Gauge\n" + "".join(rows))
    with pytest.raises(InputError, match="name one with --input and one with --output"):
        read_record(path)
    assert read_record(path, input="Valve", output="Gauge").data.Ts == 60.0


def test_a_number_without_end_beside_a_time_of_day_is_no_warning(tmp_path):
    (tmp_path / "a.csv").write_text("time,u,y\n" + "".join(f"10:0{k},{'inf' if k == 3 else k},{k}\n" for k in range(9)))
    with np.errstate(all="raise"):
        assert "u" in read_table(tmp_path / "a.csv").names
