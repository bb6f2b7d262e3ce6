"""Clocks and headers of other programs: comments that state a rate, signed counters, serial dates of spreadsheets."""

import numpy as np
import pytest

import sysid
from sysid import InputError
from sysid.workflow.record import read_record

K = np.arange(400)
RNG = np.random.default_rng(0)
U, Y = np.round(RNG.normal(size=400), 4), np.round(np.cos(0.1 * K), 4)


def table(path, clock, name="t", above="", form="{}"):
    """A log with this clock (n,) below a comment."""
    rows = (f"{form.format(a)},{b},{c}" for a, b, c in zip(clock.tolist(), U, Y, strict=True))
    path.write_text(above + "\n".join([f"{name},u,y", *rows]) + "\n")
    return path


AGREE = (
    "Ts = 0.01", "Ts=10 ms", "Ts: 10", "fs=100", "fs = 100 Hz", "Sampling rate: 0.1 kHz", "dt 10ms",
    "sample time 0,01 s",
    "Sampling frequency: 100 Hz.", "fs = 105 Hz", "Ts = odd", "fs = 100 rpm", "the rate is 5 Hz", "Ts",
)  # fmt: skip
DENY = ("Ts = 0.02", "Ts=10 s", "fs=50", "fs = 100 kHz", "Sampling rate: 1 Hz", "sample_time: 0,005 s", "dt = 20")
# A rate may have thousands marks, Ts may be a time stamp, fs a full scale beyond every rate.
OTHERS = ("Sampling rate: 1,000 Hz", "dt: 1.000 us", "TS 1700000000", "ts: 1700000000000 ms", "Ts = 1e999", "fs = 0")


def notes(path):
    return [note for note in read_record(str(path), "u", "y").notes if "a comment says" in note]


@pytest.mark.parametrize("said", DENY)
@pytest.mark.parametrize("mark", ["#", "%"])
def test_a_comment_that_denies_the_clock_is_told(said, mark, tmp_path):
    """It may be the rate of a converter before decimation: the clock decides."""
    path = table(tmp_path / "rig.csv", K * 0.01, "t_s", f"{mark} rig 7\n{mark} {said}\n{mark} more\n", "{:.2f}")
    assert notes(path) == [f"a comment says '{said}', and column 't_s' steps by 0.01 s: the column is used"]
    assert sysid.read(path).Ts == pytest.approx(0.01)


@pytest.mark.parametrize("said", [*AGREE, *OTHERS])
def test_a_comment_that_agrees_or_says_nothing_is_not_told(said, tmp_path):
    step = 0.001 if said in OTHERS else 0.01
    path = table(tmp_path / "rig.csv", K * step, "t_s", f"# {said}\n", "{:.3f}")
    assert notes(path) == []
    assert sysid.read(path).Ts == pytest.approx(step)


def test_whole_stamps_are_as_sharp_as_others(tmp_path):
    """A step of 10 ms is no 20 ms, also where samples were lost."""
    path = table(tmp_path / "rig.csv", K * 10, "millis", '# qpal: {"Ts": 0.02}\n# fs: 50 Hz\n')
    with pytest.raises(InputError, match=r"Ts is 0.02 s, and column 'millis' steps by 0.01 s"):
        sysid.read(path)
    told = table(tmp_path / "told.csv", K * 10, "millis", "# fs: 50 Hz\n")
    assert len(notes(told)) == 1
    lost = table(tmp_path / "lost.csv", 10 * (K + (K > 30) + (K > 90)), "millis", '# qpal: {"Ts": 0.01}\n')
    assert sysid.read(lost).Ts == pytest.approx(0.01)


@pytest.mark.parametrize("name", ["time", "timestamp"])
def test_a_signed_counter_does_not_count_from_1970(name, tmp_path):
    clock = (2**31 - 1000 + 10 * K + 2**31) % 2**32 - 2**31
    with pytest.raises(InputError, match=r"say which with time= .time\w*. time_unit= s .or another"):
        sysid.read(table(tmp_path / "rig.csv", clock, name))


@pytest.mark.parametrize("bits", [16, 32])
def test_a_counter_with_a_sign_is_a_counter(bits, tmp_path):
    """One whose lower half was left out as stamps that run back lost a third of the record."""
    half = 2 ** (bits - 1)
    clock = (half - 2000 + 10 * K + half) % (2 * half) - half
    found = sysid.read(table(tmp_path / "rig.csv", clock, "millis"))
    assert found.N == 400
    assert found.Ts == pytest.approx(0.01)
    np.testing.assert_array_equal(found.u[:, 0], U)


@pytest.mark.parametrize("first", [-33000, 65000])
def test_numbers_that_no_counter_shows_are_refused_with_the_entry_to_set(first, tmp_path):
    path = table(tmp_path / "rig.csv", 10 * K + first, "millis")
    mapping = tmp_path / "m.toml"
    channels = 'input = [{column = "u"}]\noutput = [{column = "y"}]'
    mapping.write_text(f'clock = {{column = "millis", unit = "ms", period = 65536}}\n{channels}')
    with pytest.raises(InputError, match=r"starts again after 65536; set period of .clock. .* out if it never"):
        sysid.read(path, map=mapping)


def test_a_fall_beyond_the_range_of_a_counter_is_none_of_its_wraps(tmp_path):
    clock = 20000 + 10 * K - 2**16 * (K >= 200)
    with pytest.raises(InputError, match="the clock starts again at row 202, each time after 65536"):
        sysid.read(table(tmp_path / "rig.csv", clock, "millis"))


def test_serial_days_of_a_spreadsheet_have_a_unit(tmp_path):
    path = table(tmp_path / "rig.csv", 45000.5 + K * 0.01 / 86400.0, "time", form="{!r}")
    with pytest.raises(InputError, match=r"or 0.0\d+ s .if in day.; say which with time= .time. time_unit= "):
        sysid.read(path)
    found = sysid.read(path, time="time", time_unit="day")
    assert found.N == 400
    assert found.Ts == pytest.approx(0.01, rel=1e-3)


def test_times_of_a_table_and_another_sampling_time_are_refused():
    pandas = pytest.importorskip("pandas")
    zone = pandas.Timestamp("2026-01-01", tz="Europe/Berlin") + pandas.to_timedelta(K * 0.01, unit="s")
    for index in (
        zone,
        K * 0.01,
        pandas.to_timedelta(K * 0.01, unit="s"),
        pandas.Timestamp("2026-01-01") + pandas.to_timedelta(K * 0.01, unit="s"),
    ):
        frame = pandas.DataFrame({"u": U, "y": Y}, index=index)
        with pytest.raises(InputError, match=r"Ts is 0.02 s and the times of the table step by 0.01 s; leave Ts out"):
            sysid.IOData.from_pandas(frame, "u", "y", Ts=0.02)
        assert sysid.IOData.from_pandas(frame, "u", "y", Ts=0.0105).Ts == 0.0105
        holed = frame.set_axis(frame.index.where(K != 7), axis=0)
        with pytest.raises(InputError, match=r"Ts is 0.02 s and the times of the table step by 0.01 s"):
            sysid.IOData.from_pandas(holed, "u", "y", Ts=0.02)
        assert sysid.IOData.from_pandas(frame.reset_index(drop=True), "u", "y", Ts=0.02).Ts == 0.02
    rows = pandas.DataFrame({"u": U, "y": Y}).iloc[::2]  # numbers of rows, which are no times
    assert sysid.IOData.from_pandas(rows, "u", "y", Ts=0.02).Ts == 0.02
    with pytest.raises(InputError, match="'u' is named as input and as output"):
        sysid.IOData.from_pandas(rows, "u", ["y", "u"], Ts=0.02)


def test_a_coordinate_and_another_sampling_time_are_refused():
    xarray = pytest.importorskip("xarray")
    values = xarray.Dataset({"u": ("time", U), "y": ("time", Y)}, coords={"time": K * 0.01})
    with pytest.raises(InputError, match=r"Ts is 0.02 s and the times of the table step by 0.01 s"):
        sysid.IOData.from_xarray(values, "u", "y", Ts=0.02)
    assert sysid.IOData.from_xarray(values.drop_vars("time"), "u", "y", Ts=0.02).Ts == 0.02


@pytest.mark.parametrize(
    ("k", "said"),
    [(np.delete(K, range(100, 110)), "the first of 0.11 s"), (np.r_[0:200, 150:350], "the first of -0.49 s")],
    ids=["gap", "back"],
)
def test_a_clock_beside_a_given_sampling_time_tells_of_its_jumps(tmp_path, k, said):
    path = tmp_path / "log.csv"
    path.write_text("\n".join(["t,u,y", *(f"{0.01 * each:.2f},{U[each]},{Y[each]}" for each in k)]) + "\n")
    notes = " ".join(read_record(path, Ts=0.01).notes)
    assert f"column 't' has 1 other step(s), {said}" in notes


def test_a_clock_that_shakes_beside_a_given_sampling_time_is_no_jump(tmp_path):
    clock = np.round(0.01 * (K + np.random.default_rng(3).uniform(-0.3, 0.3, len(K))), 5)
    assert "other step" not in " ".join(read_record(table(tmp_path / "log.csv", clock), Ts=0.01).notes)
