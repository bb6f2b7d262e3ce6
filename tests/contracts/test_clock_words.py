"""The unit in the name of a clock, in words of several languages, is the unit; what denies it is a sentence."""

import datetime

import numpy as np
import polars as pl
import pytest

import sysid
from sysid import InputError

N = 60
K = np.arange(N)
RNG = np.random.default_rng(0)
U, Y = np.round(RNG.normal(size=N), 3), np.round(np.cos(0.1 * K), 3)
SECONDS = {"ns": 1e-9, "us": 1e-6, "ms": 1e-3, "s": 1.0, "min": 60.0, "h": 3600.0, "day": 86400.0}
NAMES = {
    "ns": ("nsec", "nanoseconds", "timestamp_nanos"),
    "us": ("microsec", "Mikrosekunden", "time_usec"),
    "ms": ("milliseconds", "millisec", "Millisekunden", "tms", "ms since boot", "timestampMs"),
    "s": ("s", "Sekunden", "Zeit s", "t/s", "secondes", "segundos"),
    "min": ("minute", "minutes", "mins", "min", "t_min", "Minuten", "Zeit [Min.]", "elapsed_min"),
    "h": ("hour", "hours", "Hours", "Elapsed Hours", "hr", "hrs", "Stunden", "Zeit (Std)", "heures", "horas"),
    "day": ("day", "days", "Tage", "jours"),
}


def rig(path, name, stamps):
    rows = (f"{a},{b},{c}\n" for a, b, c in zip(stamps, U, Y, strict=True))
    path.write_text(f"{name},u,y\n" + "".join(rows))
    return path


@pytest.mark.parametrize(("name", "unit"), [(name, unit) for unit, names in NAMES.items() for name in names])
def test_a_clock_that_is_named_after_its_unit_is_read_in_it(name, unit, tmp_path):
    """Whatever the step: hours were seconds, nanoseconds seconds, and seconds of a slow log milliseconds."""
    for Ts in (0.01, 1.5, 60.0, 600.0):
        if Ts == SECONDS[unit]:  # numbers that may count rows
            continue
        path = rig(tmp_path / "rig.csv", name, [f"{Ts / SECONDS[unit] * k:.12g}" for k in K])
        assert sysid.read(path).Ts == pytest.approx(Ts, rel=1e-6)


@pytest.mark.parametrize("name", ["h", "t_h", "d", "t_d"])
def test_a_letter_that_is_as_often_no_unit_is_asked_for(name, tmp_path):
    path = rig(tmp_path / "rig.csv", name, 0.01 * K)
    with pytest.raises(InputError, match=r"by its last letter or in another unit; say which with .*time.unit"):
        sysid.read(path)
    assert sysid.read(path, time=name, time_unit="s").Ts == pytest.approx(0.01)


@pytest.mark.parametrize("name", ["time_of_day", "hour_of_day_t", "second_run_time", "rate_hr_time"])
def test_a_word_of_one_is_no_unit_among_others(name, tmp_path):
    assert sysid.read(rig(tmp_path / "rig.csv", name, 0.5 + 0.02 * K)).Ts == pytest.approx(0.02)


def test_digits_of_a_time_of_day_are_no_count(tmp_path):
    path = rig(tmp_path / "rig.csv", "time_hhmmss", [f"09{k:02d}00" for k in K])
    for options in ({}, {"time": "time_hhmmss", "time_unit": "s"}):
        with pytest.raises(InputError, match=r"times of day written as one number .* sampling time with"):
            sysid.read(path, **options)
    assert sysid.read(path, Ts=60.0).Ts == 60.0


@pytest.mark.parametrize(
    ("name", "factor", "said"), [("time_s", 1e3, "ms"), ("t_ms", 1e6, "us"), ("seconds", 1e9, "ns")]
)
def test_stamps_since_1970_in_another_unit_than_the_name_are_refused(name, factor, said, tmp_path):
    path = rig(tmp_path / "rig.csv", name, [int(1773136799 * factor + 0.01 * factor * k) for k in K])
    with pytest.raises(InputError, match=rf"'{name}' names .*, and its stamps near .* count from 1970 in {said}; say"):
        sysid.read(path)
    assert sysid.read(path, time=name, time_unit=said).Ts == pytest.approx(0.01, rel=1e-6)


def test_seconds_since_1970_that_are_named_milliseconds_are_refused(tmp_path):
    path = rig(tmp_path / "rig.csv", "time_ms", [f"{1773136799 + 0.01 * k:.2f}" for k in K])
    with pytest.raises(InputError, match="count from 1970 in s; say which"):
        sysid.read(path)
    fast = rig(tmp_path / "fast.csv", "time_us", [1000 * (1773136 + k) for k in K])  # half an hour after the start
    assert sysid.read(fast).Ts == pytest.approx(0.001)


@pytest.mark.parametrize("kind", ["dates", "spans"])
@pytest.mark.parametrize("suffix", [".parquet", ".npz"])
def test_the_type_of_a_column_of_times_settles_its_unit(kind, suffix, tmp_path):
    """Parquet and NumPy keep times as such: `time_ms` is then no number of milliseconds."""
    spans = 10 * K.astype("timedelta64[ms]")
    stamps = np.datetime64("2026-03-10T00:00:00.000") + spans if kind == "dates" else spans
    path = tmp_path / f"rig{suffix}"
    if suffix == ".npz":
        np.savez(path, time_ms=stamps, u=U, y=Y)
    else:
        pl.DataFrame({"time_ms": stamps, "u": U, "y": Y}).write_parquet(path)
    assert sysid.read(path).Ts == pytest.approx(0.01, rel=1e-9)
    assert sysid.read(path, time="time_ms").Ts == pytest.approx(0.01, rel=1e-9)
    with pytest.raises(InputError, match="which become seconds; leave unit"):
        sysid.read(path, time="time_ms", time_unit="ms")


def test_a_column_of_dates_with_the_unit_of_its_name_is_no_contradiction(tmp_path):
    start = datetime.datetime(2026, 3, 10)
    stamps = [(start + datetime.timedelta(milliseconds=10 * int(k))).isoformat(timespec="milliseconds") for k in K]
    assert sysid.read(rig(tmp_path / "rig.csv", "time_ms", stamps)).Ts == pytest.approx(0.01, rel=1e-9)
