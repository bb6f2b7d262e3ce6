"""Clocks in two columns, dates without seconds, tables with the newest row first, and long tables: one plant each."""

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import polars
import pytest
from plants_in_time import GAIN, TAU, level_at, pole_and_gain, response, steps

from sysid.channels.guess import guess
from sysid.channels.mapping_file import read_map, write_map
from sysid.channels.reading import read_signals
from sysid.formats import read_table
from sysid.workflow.record import Record, read_record

N, TS = 600, 0.02
T = np.arange(N) * TS
U, Y = (of(T, *steps(3, 0.24, 12.0)) for of in (level_at, response))
CASES = Path(__file__).parent / "cases"  # from public reports


def rows(head: str, clock: Callable[[int], str], newest_first: bool = False, step: int = 20) -> str:
    """A table of text: `clock` gives the cells of the clock at so many ms."""
    places = range(N)[::-1] if newest_first else range(N)
    return "\n".join([f"{head},u,y", *(f"{clock(k * step)},{U[k]},{float(Y[k])!r}" for k in places), ""])


def check(record: Record, Ts: float = TS, pole: float = float(np.exp(-TS / TAU))) -> None:
    assert (record.data.N, round(record.data.Ts, 9)) == (N, Ts)
    assert pole_and_gain(record.data.u[:, 0], record.data.y[:, 0]) == pytest.approx((pole, GAIN), abs=1e-6)


def day(ms: int, form: str = "2024-05-16T{h:02d}:{m:02d}:{s:02d}") -> str:
    s = 12 * 3600 + 55 * 60 + 55 + ms // 1000
    return form.format(h=s // 3600, m=s // 60 % 60, s=s % 60, ms=ms % 1000)


PAIRS: dict[str, tuple[str, Callable[[int], str]]] = {
    "date, time, ms": ("Date,Time,ms", lambda ms: f"2024-05-16,{day(ms, '{h:02d}:{m:02d}:{s:02d}')},{ms % 1000}"),
    "date and time, ms": ("timestamp,msec", lambda ms: f"{day(ms)},{ms % 1000}"),
    "time, Millisecond": ("Time,Millisecond", lambda ms: f"{day(ms, '{h:02d}:{m:02d}:{s:02d}')},{ms % 1000}"),
    "minutes, s": (
        "Date,s",
        lambda ms: f"{day(ms, '2024-05-16 {h:02d}:{m:02d}')},{(55000 + ms) % 60000 / 1000:.2f}",
    ),
    "sec, nanosec": ("sec,nanosec", lambda ms: f"{1715860830 + ms // 1000},{ms % 1000 * 1_000_000}"),
    "stamp of ROS": (
        "header.stamp.sec,header.stamp.nanosec",
        lambda ms: f"{1715860830 + (ms + 130) // 1000},{(ms + 130) % 1000 * 1_000_000}",
    ),
    "s, ms": ("s,ms", lambda ms: f"{ms // 1000},{ms % 1000}"),
    "time_s, time_ms": ("time_s,time_ms", lambda ms: f"{ms // 1000},{ms % 1000}"),
    "timeval": ("tv_sec,tv_usec", lambda ms: f"{1715860830 + ms // 1000},{ms % 1000 * 1000}"),
}


@pytest.mark.parametrize("newest_first", [False, True])
@pytest.mark.parametrize("kind", PAIRS)
def test_two_columns_are_one_clock(kind, newest_first, tmp_path):
    head, clock = PAIRS[kind]
    path = tmp_path / "a.csv"
    path.write_text(rows(head, clock, newest_first))
    record = read_record(path)
    check(record)
    first, second = head.split(",")[-2:]
    assert any(f"columns '{first}' and '{second}' were read together as one clock" in note for note in record.notes)
    assert any("turned round" in note for note in record.notes) == newest_first
    mapping = read_map(write_map(guess(path).mapping, tmp_path / "a.toml"))
    np.testing.assert_array_equal(read_signals(path, mapping).io().y, record.data.y)


def test_stamps_in_json_and_parquet(tmp_path):
    stamps = [{"sec": 1715860830 + k * 20 // 1000, "nanosec": k * 20 % 1000 * 1_000_000} for k in range(N)]
    samples = [{"header": {"stamp": s}, "u": U[k], "y": Y[k]} for k, s in enumerate(stamps)]
    (tmp_path / "a.json").write_text(json.dumps(samples))
    polars.DataFrame(samples).write_parquet(tmp_path / "a.parquet")
    for name in ("a.json", "a.parquet"):
        check(read_record(tmp_path / name))


@pytest.mark.parametrize(
    ("head", "clock"),
    [
        ("time_s,latency_ms", lambda ms: f"{ms / 1000},{(ms * 7) % 400}"),  # a signal
        ("time_s,time_ms", lambda ms: f"{ms / 1000},{ms}"),  # the same time twice
        ("ms", lambda ms: f"{ms}"),
    ],
)
def test_other_columns_stay_what_they_are(head, clock, tmp_path):
    path = tmp_path / "a.csv"
    path.write_text(rows(head, clock))
    assert not read_table(path).joined
    check(read_record(path, "u", "y"))


@pytest.mark.parametrize(
    "form", ["2024-05-16 {h:02d}:{m:02d}", "16.05.2024 {h:02d}:{m:02d}", "2024/05/16T{h:02d}:{m:02d}"]
)
@pytest.mark.parametrize("newest_first", [False, True])
def test_dates_without_seconds(form, newest_first, tmp_path):
    path = tmp_path / "a.csv"
    path.write_text(rows("Date", lambda ms: day(ms - 46_000_000, form), newest_first, step=60_000))
    check(read_record(path), 60.0)


@pytest.mark.parametrize("Ts", [None, TS])
@pytest.mark.parametrize(
    ("head", "clock"),
    [
        ("t_s", lambda ms: f"{ms / 1000}"),
        ("timestamp", lambda ms: f"{1715860830000 + ms}"),
        ("Date", lambda ms: f"{day(ms)}.{ms % 1000:03d}"),
        ("1", lambda ms: f"{ms / 1000}"),
    ],
)
def test_the_newest_row_may_stand_first(head, clock, Ts, tmp_path):
    """Read backwards in time, the plant has its pole outside the unit circle."""
    path = tmp_path / "a.csv"
    path.write_text(rows(head, clock, newest_first=True))
    record = read_record(path, Ts=Ts)
    check(record)
    assert any(f"the clock {head!r} falls throughout" in note for note in record.notes)


@pytest.mark.parametrize(
    ("head", "clock"),
    [
        ("t_s,time_left_s", lambda ms: f"{ms / 1000},{20 - ms / 1000}"),
        ("t_s,time_to_go_s", lambda ms: f"{ms / 1000},{20 - ms / 1000}"),
        ("t_s,battery_V", lambda ms: f"{ms / 1000},{12 - ms * 1e-5:.5f}"),
        ("time_left_s", lambda ms: f"{20 - ms / 1000}"),
        ("battery_V", lambda ms: f"{12 - ms * 1e-5:.5f}"),
    ],
)
def test_what_falls_in_a_log_that_is_in_order_turns_nothing(head, clock, tmp_path):
    path = tmp_path / "a.csv"
    path.write_text(rows(head, clock))
    check(read_record(path, "u", "y", Ts=TS if not head.startswith("t_s") else None))


LONG = {  # the rows (time [s], name, value) of a long table, in the order in which they are written
    "in turn": [(t, name, x) for t, u, y in zip(T, U, Y, strict=True) for name, x in (("voltage", u), ("angle", y))],
    "in blocks": [(t, name, x) for name, v in (("voltage", U), ("angle", Y)) for t, x in zip(T, v, strict=True)],
    "at rates of their own": sorted(
        [(t, "voltage", u) for t, u in zip(T[::3], U[::3], strict=True)]
        + [(t, "angle", y) for t, y in zip(T + 0.0031, response(T + 0.0031, *steps(3, 0.24, 12.0)), strict=True)]
    ),
}  # fmt: skip


@pytest.mark.parametrize("suffix", [".csv", ".parquet", ".json", ".jsonl"])
@pytest.mark.parametrize("kind", LONG)
def test_a_long_table_has_a_column_for_each_name(kind, suffix, tmp_path):
    samples = [{"time_s": float(t), "topic": name, "value": float(x)} for t, name, x in LONG[kind]]
    path, frame = tmp_path / f"a{suffix}", polars.DataFrame(samples)
    if suffix == ".csv":
        frame.write_csv(path)
    elif suffix == ".parquet":
        frame.write_parquet(path)
    elif suffix == ".json":
        path.write_text(json.dumps(samples))
    else:
        frame.write_ndjson(path)
    record = read_record(path)
    check(record)
    assert (record.input, record.output) == ("voltage", "angle")
    assert any("each name in 'topic' became a column (time_s, " in note for note in record.notes)


def test_values_that_are_no_numbers_are_left_out_of_a_long_table_and_units_stay(tmp_path):
    path = tmp_path / "a.csv"
    lines = ["Timestamp,Key,Value,Unit"]
    for t, name, x in LONG["in turn"]:
        lines.append(f"{t:.2f},{name},{x},{'V' if name == 'voltage' else 'deg'}")
        lines += [f"{t:.2f},mode,auto,", f"{t:.2f},led,{'true' if t > 1 else 'false'},"]
    path.write_text("\n".join(lines))
    table = read_table(path)
    assert table.names == ("Timestamp", "voltage", "led", "angle")
    assert (table.units["voltage"], table.units["angle"]) == ("V", "deg")
    assert "left out mode: no numbers" in table.notes
    assert set(table.numbers("led")) == {0.0, 1.0}
    np.testing.assert_allclose(read_record(path, "voltage", "angle").data.y[:, 0], np.deg2rad(Y), atol=1e-9)


def test_the_case_of_a_public_report():
    """PlotJuggler 1259: a date, a time of day and milliseconds."""
    data = read_record(CASES / "date_time_ms.csv").data
    assert (data.N, round(data.Ts, 9)) == (300, TS)
