"""Local times without an offset from UTC over a change of clocks: an hour is neither invented nor thrown away."""

import datetime
import zoneinfo

import numpy as np
import polars as pl
import pytest

import sysid
from sysid import InputError
from sysid.workflow.record import read_record

BERLIN = zoneinfo.ZoneInfo("Europe/Berlin")
SPRING = datetime.datetime(2026, 3, 29, 1, tzinfo=datetime.UTC)
AUTUMN = datetime.datetime(2026, 10, 25, 1, tzinfo=datetime.UTC)
SUMMER = datetime.datetime(2026, 7, 7, 1, tzinfo=datetime.UTC)
N = 200
K = np.arange(N)
RNG = np.random.default_rng(0)
U, Y = np.round(RNG.normal(size=N), 3), np.round(np.cos(0.1 * K), 3)


def stamps(turn, step, lost=()):
    kept = [k for k in range(N) if k not in lost]
    return kept, [(turn + datetime.timedelta(seconds=step * (k - 100))).astimezone(BERLIN) for k in kept]


def rig(path, turn, step, form="%Y-%m-%d %H:%M:%S", lost=()):
    kept, times = stamps(turn, step, lost)
    rows = (f"{at:{form}},{U[k]},{Y[k]}\n" for k, at in zip(kept, times, strict=True))
    path.write_text("time,u,y\n" + "".join(rows))
    return path


@pytest.mark.parametrize("turn", [SPRING, AUTUMN])
@pytest.mark.parametrize("step", [1, 60, 600, 900, 1200, 1800, 3600, 7200, 10800, 14400, 21600, 86400])
def test_an_hour_of_a_local_clock_is_refused_with_its_row(turn, step, tmp_path):
    path = rig(tmp_path / "rig.csv", turn, step)
    with pytest.raises(InputError, match=r"row 102, column 'time': .*an hour.*change of clocks.*offset"):
        read_record(path)
    assert sysid.read(path, Ts=float(step), input="u", output="y").Ts == step
    zoned = read_record(rig(tmp_path / "zoned.csv", turn, step, "%Y-%m-%dT%H:%M:%S%z"))
    assert (len(zoned.data.u), zoned.data.Ts) == (N, step)


@pytest.mark.parametrize("step", [1800, 3600])
def test_samples_that_are_lost_in_a_summer_night_are_filled(step, tmp_path):
    record = read_record(rig(tmp_path / "rig.csv", SUMMER, step, lost=(100, 101) if step == 1800 else (100,)))
    assert (len(record.data.u), record.data.Ts) == (N, step)
    assert any("lost sample" in note for note in record.notes)


def test_dates_of_a_table_are_local_unless_they_have_a_zone(tmp_path):
    _, times = stamps(SPRING, 3600)
    local = pl.DataFrame({"time": [at.replace(tzinfo=None) for at in times], "u": U, "y": Y})
    local.write_parquet(tmp_path / "local.parquet")
    with pytest.raises(InputError, match="change of clocks"):
        sysid.read(tmp_path / "local.parquet")
    utc = pl.DataFrame({"time": [at.astimezone(datetime.UTC) for at in times], "u": U, "y": Y})
    utc.write_parquet(tmp_path / "utc.parquet")
    assert sysid.read(tmp_path / "utc.parquet").Ts == 3600.0
