"""Records from and to pandas and xarray, cuts by seconds and samples, and sysid.read: nothing is lost or shifted."""

import dataclasses
import sys

import numpy as np
import pytest

import sysid
from sysid.data.preprocess import detrend
from sysid.workflow.record import words_for_python

pandas = pytest.importorskip("pandas", reason="pandas is in the notebook extra")
xarray = pytest.importorskip("xarray", reason="xarray is in the notebook extra")


@pytest.fixture
def data():
    rng = np.random.default_rng(0)
    lost = np.zeros((60, 1), dtype=bool)
    lost[7] = True
    return sysid.IOData(rng.normal(size=60), rng.normal(size=60) + 3.0, 0.1, "volt", "angle", "V", "rad", missing=lost)


def same(a, b):
    np.testing.assert_array_equal(a.u, b.u)
    np.testing.assert_allclose(a.y, b.y, rtol=1e-14)
    np.testing.assert_array_equal(a.observed, b.observed)
    for name in ("Ts", "u_name", "y_name", "u_unit", "y_unit", "lengths"):
        assert getattr(a, name) == getattr(b, name), name


def test_a_table_of_pandas_holds_the_record_and_gives_it_back(data):
    table = data.to_pandas()
    assert list(table.columns) == ["volt", "angle"]
    assert table.attrs["units"] == {"time": "s", "volt": "V", "angle": "rad"}
    np.testing.assert_allclose(table.index, 0.1 * np.arange(60))
    assert np.flatnonzero(table["angle"].isna()).tolist() == [7]
    same(sysid.IOData.from_pandas(table, "volt", "angle"), data)


def test_removed_means_are_back_in_a_table(data):
    np.testing.assert_allclose(detrend(data).to_pandas()["volt"], data.u[:, 0], atol=1e-14)
    np.testing.assert_allclose(detrend(data).to_xarray()["volt"], data.u[:, 0], atol=1e-14)


def test_experiments_are_the_outer_level_of_the_index(data):
    both = sysid.IOData.merge(data, data[10:40])
    same(sysid.IOData.from_pandas(both.to_pandas(), "volt", "angle"), both)
    mixed = both.to_pandas().iloc[[*range(20), *range(70, 90), *range(20, 40)]]
    with pytest.raises(sysid.InputError, match="not in one piece"):
        sysid.IOData.from_pandas(mixed, "volt", "angle")
    with pytest.raises(sysid.InputError, match="2 experiments; convert each"):
        both.to_xarray()


def test_a_dataset_of_xarray_holds_the_record_and_gives_it_back(data):
    table = data.to_xarray()
    assert table["angle"].attrs == {"units": "rad"}
    assert table["time"].attrs == {"units": "s"}
    same(sysid.IOData.from_xarray(table, "volt", "angle"), data)
    bare = xarray.Dataset({"u": ("k", np.arange(5.0)), "y": ("k", np.arange(5.0)), "z": (("k", "j"), np.ones((5, 2)))})
    assert sysid.IOData.from_xarray(bare, "u", "y", Ts=0.5).Ts == 0.5
    with pytest.raises(sysid.InputError, match="no times; give Ts"):
        sysid.IOData.from_xarray(bare, "u", "y")
    with pytest.raises(sysid.InputError, match="same one dimension"):
        sysid.IOData.from_xarray(bare, "u", "z")
    with pytest.raises(sysid.InputError, match="no variable 'w'; choose one of u, y, z"):
        sysid.IOData.from_xarray(bare, "u", "w")


@pytest.mark.parametrize(
    "index",
    [
        pandas.date_range("2026-01-01", periods=20, freq="20ms"),
        pandas.timedelta_range("0s", periods=20, freq="20ms"),
        pandas.period_range("2026-01-01", periods=20, freq="20ms"),
        0.02 * np.arange(20) + 1e-5 * np.sin(np.arange(20)),  # off by less than a hundredth of a step
    ],
    ids=["stamps", "differences", "periods", "seconds"],
)
def test_the_index_gives_the_sampling_time(index):
    table = pandas.DataFrame({"a": np.arange(20.0), "b": np.arange(20.0), "c": np.arange(20)}, index=index)
    data = sysid.IOData.from_pandas(table, ["a", "c"], "b")
    assert pytest.approx(0.02, rel=1e-4) == data.Ts
    assert data.u.shape == (20, 2)
    if table.index.dtype != float:  # numbers may be row numbers or another unit: there a given Ts holds
        with pytest.raises(sysid.InputError, match="Ts"):
            sysid.IOData.from_pandas(table, "a", "b", Ts=0.1)


@pytest.mark.parametrize("Ts", [0.1, 0.07, 0.013, 1 / 3, 1e-4])
def test_the_sampling_time_of_a_table_is_the_number_that_it_was(Ts):
    data = sysid.IOData(np.arange(48.0), np.arange(48.0), Ts)
    assert sysid.IOData.from_pandas(data.to_pandas(), "u", "y").Ts == pytest.approx(Ts, rel=1e-11)
    assert Ts == 1 / 3 or sysid.IOData.from_pandas(data.to_pandas(), "u", "y").Ts == Ts


def test_tables_that_are_no_record_are_refused_in_a_sentence():
    table = pandas.DataFrame({"a": np.arange(6.0), "b": np.arange(6.0), "t": list("abcdef")})
    with pytest.raises(sysid.InputError, match="no times; give Ts, the sampling time in seconds, or set the times"):
        sysid.IOData.from_pandas(table, "a", "b")
    with pytest.raises(sysid.InputError, match="no column 'x'; choose one of a, b, t"):
        sysid.IOData.from_pandas(table, "x", "b", Ts=1.0)
    with pytest.raises(sysid.InputError, match="column 't' holds values that are not numbers"):
        sysid.IOData.from_pandas(table, "t", "b", Ts=1.0)
    with pytest.raises(sysid.InputError, match="after row 2 comes a step of 2 s"):
        sysid.IOData.from_pandas(table.set_index(pandas.Index([0.0, 1.0, 2.0, 4.0, 5.0, 6.0])), "a", "b")
    with pytest.raises(sysid.InputError, match="holds no times"):
        sysid.IOData.from_pandas(table.set_index("t"), "a", "b")


@pytest.mark.parametrize("name", ["pandas", "xarray"])
def test_a_missing_library_is_told_with_the_command_that_installs_it(data, name, monkeypatch):
    monkeypatch.setitem(sys.modules, name, None)
    with pytest.raises(
        sysid.InputError, match=rf"{name} is not installed; install it with: pip install 'qpal\[notebook\]'"
    ):
        getattr(data, f"to_{name}")()


def test_two_ranges_with_a_border_in_common_share_no_sample(data):
    for border in (
        0.3,
        0.7,
        1.1,
        2.0,
        2.05,
        5.79,
    ):  # 0.3 / 0.1 is a little less than 3 in floating point, 1.1 / 0.1 more
        first, last = data.between(0.0, border), data.between(border)
        np.testing.assert_array_equal(np.concatenate([first.u, last.u]), data.u)
        assert sum(data.t < border - 1e-9) == first.N
    assert data.between(stop=1.0).N == 10
    np.testing.assert_array_equal(data.between(1.0, 2.0).u, data[10:20].u)
    np.testing.assert_array_equal(data[-5:].u, data.u[-5:])
    assert not data.between(0.7, 0.9).observed[0, 0]


@pytest.mark.parametrize(
    ("cut", "said"),
    [
        (lambda d: d.between(5.0, 2.0), "the start first"),
        (lambda d: d.between(0.0, 7.0), r"seconds from 0 to 6"),
        (lambda d: d.between(0.0, 0.1), "holds 1 sample"),
        (lambda d: d[2.0:3.0], r"for seconds use data.between\(2.0, 8.0\)"),
        (lambda d: d[3], "cut by whole samples"),
        (lambda d: d[::2], "resample"),
        (lambda d: d[50:51], "fewer than the 2"),
        (lambda d: sysid.IOData.merge(d, d).between(5.0, 7.0), "border of two experiments"),
    ],
)
def test_a_cut_that_is_none_is_refused_in_a_sentence(data, cut, said):
    with pytest.raises(sysid.InputError, match=said):
        cut(data)


def test_a_record_is_no_sequence_of_samples(data):
    with pytest.raises(TypeError):
        iter(data)


def test_read_keeps_names_and_units_and_cuts_in_seconds(data, tmp_path):
    path = tmp_path / "log.csv"
    rows = np.column_stack([data.t, data.u, np.degrees(data.y)])
    np.savetxt(path, rows, delimiter=",", header="time_s,voltage_V,angle_deg", comments="")
    found = sysid.read(path)
    assert (found.Ts, found.u_unit, found.y_unit) == (pytest.approx(0.1), "V", "rad")
    np.testing.assert_allclose(found.y, data.y)
    cut = sysid.read(path, input="voltage_V", output="angle_deg", start=1.0, stop=2.9)
    np.testing.assert_allclose(cut.u, data.u[10:30])
    with pytest.raises(sysid.InputError, match=r"log\.csv: unknown column 'volts'.*'voltage_V'"):
        sysid.read(path, input="volts")
    with pytest.raises(sysid.InputError, match=r"Ts is 0\.2 s but column 'time_s' steps by 0\.1 s"):
        sysid.read(path, "voltage_V", "angle_deg", Ts=0.2, time="time_s")


def test_what_read_says_names_its_arguments_and_no_option_of_the_command_line():
    said = "give it with --ts SECONDS or name a time column with --time; --time-unit is 'h'; keep one with --range 1:2"
    assert words_for_python(said) == (
        "give it with Ts=SECONDS or name a time column with time=; time_unit is 'h'; keep one with start= and stop= 1:2"
    )


@pytest.mark.parametrize("table", [None, 3, "log.csv", [1, 2], {"u": [1]}, np.zeros((3, 2)), int])
@pytest.mark.parametrize(("read", "wanted"), [("from_pandas", "pandas DataFrame"), ("from_xarray", "xarray Dataset")])
def test_what_is_no_table_is_refused_by_what_it_is(read, wanted, table):
    with pytest.raises(sysid.InputError, match=f"^the table is .*; give a {wanted}$"):
        getattr(sysid.IOData, read)(table, "u", "y", 0.1)


@pytest.mark.parametrize(("into", "back"), [("to_pandas", "from_pandas"), ("to_xarray", "from_xarray")])
def test_a_role_without_a_column_is_refused(into, back, data):
    for names, role in ((([], "angle"), "input"), (("volt", []), "output")):
        with pytest.raises(sysid.InputError, match=f"^{role} names no column"):
            getattr(sysid.IOData, back)(getattr(data, into)(), *names, 0.1)


@pytest.mark.parametrize(("name", "unit"), [("t", "ms"), ("t", "us since start"), ("t [ms]", None), ("t_us", None)])
def test_times_in_another_unit_are_refused(name, unit):
    """20 milliseconds were 20 s."""
    columns = {"a": np.sin(np.arange(20.0)), "b": np.cos(np.arange(20.0))}
    table = pandas.DataFrame(columns, index=pandas.Index(20.0 * np.arange(20), name=name))
    table.attrs["units"] = {name: unit} if unit else {}
    with pytest.raises(sysid.InputError, match=r"the index is in '[mu]s'; convert it to seconds"):
        sysid.IOData.from_pandas(table, "a", "b")
    grid = (name, 20.0 * np.arange(20), {"units": unit} if unit else {})
    variables = {key: (name, column) for key, column in columns.items()}
    with pytest.raises(sysid.InputError, match=r"the coordinate .* is in '[mu]s'; convert it to seconds"):
        sysid.IOData.from_xarray(xarray.Dataset(variables, coords={name: grid}), "a", "b")


@pytest.mark.parametrize(
    ("name", "unit"), [("t", "s"), ("t [s]", ""), ("time (raw)", None), (None, "seconds"), (3, "")]
)
def test_times_in_seconds_by_any_name_are_taken(name, unit):
    table = pandas.DataFrame({"a": np.arange(20.0), "b": np.arange(20.0)}, index=0.02 * np.arange(20))
    table.index.name, table.attrs["units"] = name, {name: unit}
    assert sysid.IOData.from_pandas(table, "a", "b").Ts == 0.02


def uniform(index, name=None, **columns):
    n = len(index)
    columns = columns or {"u": np.arange(n) / 7.0, "y": np.cos(np.arange(n))}
    return pandas.DataFrame(columns, index=pandas.Index(index, name=name))


ORDER = np.r_[0:9, 12:20]
BROKEN = {
    "gap": ORDER,
    "reversed": np.arange(20)[::-1],
    "shuffled": np.random.default_rng(0).permutation(20),
    "repeated": np.r_[0:9, 8:20],
    "gap of one": np.r_[0:9, 10:20],
}


@pytest.mark.parametrize("rows", BROKEN.values(), ids=BROKEN)
def test_a_given_sampling_time_hides_no_broken_clock(rows):
    n = len(rows)
    signals = {"u": np.arange(n) / 7.0, "y": np.cos(np.arange(n))}
    start = pandas.Timestamp("2026-01-01")
    stamps = pandas.DatetimeIndex([start + pandas.Timedelta(seconds=int(k)) for k in rows])
    for index in (1.0 * rows, stamps, stamps - start, stamps.astype(object), rows):
        with pytest.raises(sysid.InputError, match=r"reset_index\(drop=True\)"):
            sysid.IOData.from_pandas(uniform(index, **signals), "u", "y", Ts=1.0)
    both = pandas.MultiIndex.from_arrays([np.repeat([1, 2], n), np.r_[1.0 * np.arange(n), 1.0 * rows]])
    twice = {name: np.r_[values, values] for name, values in signals.items()}
    with pytest.raises(sysid.InputError, match=r"reset_index\(drop=True\)"):
        sysid.IOData.from_pandas(pandas.DataFrame(twice, index=both), "u", "y", Ts=1.0)
    table = xarray.Dataset({name: ("t", values) for name, values in signals.items()}, {"t": 1.0 * rows})
    with pytest.raises(sysid.InputError, match="drop_vars"):
        sysid.IOData.from_xarray(table, "u", "y", Ts=1.0)
    assert n == sysid.IOData.from_xarray(table.drop_vars("t"), "u", "y", Ts=1.0).N


def test_each_experiment_has_the_given_sampling_time():
    index = pandas.MultiIndex.from_arrays([np.repeat([1, 2], 20), np.r_[0.1 * np.arange(20), 0.2 * np.arange(20)]])
    table = pandas.DataFrame({"u": np.arange(40.0), "y": np.arange(40.0)}, index=index)
    with pytest.raises(sysid.InputError, match=r"Ts is 0\.1 s and the times of the table step by 0\.2 s"):
        sysid.IOData.from_pandas(table, "u", "y", Ts=0.1)
    assert sysid.IOData.from_pandas(table[:20], "u", "y", Ts=0.1).Ts == 0.1


def test_stamps_off_by_less_than_half_a_step_and_thinned_rows_go_with_a_given_sampling_time():
    jitter = np.random.default_rng(1).uniform(-0.2, 0.2, 300)
    assert sysid.IOData.from_pandas(uniform(np.arange(300) + jitter), "u", "y", Ts=1.0).Ts == 1.0
    assert sysid.IOData.from_pandas(uniform(np.arange(0, 40, 2)), "u", "y", Ts=0.02).N == 20  # every second row
    lost = uniform(pandas.date_range("2026-01-01", periods=20, freq="s").insert(20, pandas.NaT))
    assert sysid.IOData.from_pandas(lost, "u", "y", Ts=1.0).N == 21


@pytest.mark.parametrize(
    "name", ["millis", "time/ms", "time.ms", "t [MS]", "t (h)", "time_days", "ticks", "Zeit [µs]", "t_nanoseconds"]
)
def test_an_index_whose_name_has_another_unit_is_refused(name):
    with pytest.raises(sysid.InputError, match="convert it to seconds"):
        sysid.IOData.from_pandas(uniform(10.0 * np.arange(20), name), "u", "y")


@pytest.mark.parametrize("name", ["time", "atoms", "items", "t [s]", "h2", "Zeit in s", "sins"])
def test_an_index_whose_name_only_ends_like_a_unit_is_in_seconds(name):
    assert sysid.IOData.from_pandas(uniform(0.01 * np.arange(20), name), "u", "y").Ts == 0.01


def test_stamps_since_1970_in_a_smaller_unit_are_refused():
    for unit in (1e3, 1e6, 1e9):
        with pytest.raises(sysid.InputError, match="no seconds since 1970; convert it to seconds"):
            sysid.IOData.from_pandas(uniform((1_790_000_000 + 0.5 * np.arange(20)) * unit), "u", "y")
    assert sysid.IOData.from_pandas(uniform(1_790_000_000 + 0.5 * np.arange(20)), "u", "y").Ts == 0.5


@pytest.mark.parametrize("values", [
    np.arange(20) + 1j, pandas.date_range("2026", periods=20), pandas.timedelta_range("1s", periods=20),
], ids=["complex", "dates", "differences"])  # fmt: skip
def test_a_signal_is_real_numbers(values):
    for columns in ({"u": values, "y": np.arange(20.0)}, {"u": np.arange(20.0), "y": values}):
        with pytest.raises(sysid.InputError, match="values that are not numbers"):
            sysid.IOData.from_pandas(uniform(0.1 * np.arange(20), **columns), "u", "y")
        dataset = xarray.Dataset({name: ("t", np.asarray(each)) for name, each in columns.items()})
        with pytest.raises(sysid.InputError, match="values that are not numbers"):
            sysid.IOData.from_xarray(dataset, "u", "y", Ts=0.1)


def test_a_name_that_two_columns_have_names_none():
    table = pandas.DataFrame(np.ones((9, 3)), columns=["u", "y", "y"])
    deep = pandas.DataFrame(np.ones((9, 3)), columns=pandas.MultiIndex.from_tuples([("u", 1), ("y", 1), ("y", 2)]))
    for each in (table, deep):
        with pytest.raises(sysid.InputError, match="columns are named"):
            sysid.IOData.from_pandas(each, "u", "y", Ts=0.1)


def test_odd_tables_are_taken_or_refused_in_a_sentence():
    table = uniform(0.1 * np.arange(20))
    assert sysid.IOData.from_pandas(table, (name for name in ["u"]), (name for name in ["y"])).y_name == "y"
    for units in (None, {"u": None}, {}):
        table.attrs["units"] = units
        assert sysid.IOData.from_pandas(table, "u", "y").u_unit == ""
    table.attrs["units"] = ["V", "rad"]
    with pytest.raises(sysid.InputError, match="give a dict"):
        sysid.IOData.from_pandas(table, "u", "y")
    for index in (pandas.DatetimeIndex([]), pandas.PeriodIndex([], freq="s"), []):
        with pytest.raises(sysid.InputError, match="the table has no rows"):
            sysid.IOData.from_pandas(uniform(index), "u", "y")
    with pytest.raises(sysid.InputError, match="has no values"):
        sysid.IOData.from_xarray(xarray.Dataset({"u": ("t", []), "y": ("t", [])}), "u", "y", Ts=1.0)
    for labels in (list("abcdefghi"), [f"2026-01-01 00:00:0{k}" for k in range(9)]):
        with pytest.raises(sysid.InputError, match=r"pandas\.to_datetime, or leave it out"):
            sysid.IOData.from_pandas(uniform(labels), "u", "y", Ts=5.0)


def test_an_experiment_is_what_its_rows_are_and_has_numbers_of_its_own():
    rng = np.random.default_rng(3)
    records = []
    for n, lost in ((30, [4, 5, 29]), (20, []), (25, [0])):
        missing = np.zeros((n, 2), dtype=bool)
        missing[lost, 1] = True
        y = np.where(missing, np.nan, rng.normal(size=(n, 2)))
        records.append(sysid.IOData(rng.normal(size=n), y, 0.1, missing=missing, y_offset=[1.0, 2.0], u_unit="V"))
    whole = sysid.IOData.merge(*records)
    before = whole.y.copy()
    for part, record, end in zip(whole.experiments, records, (30, 50, 75), strict=True):
        rows = whole.select(end - record.N, end)
        for name in (field.name for field in dataclasses.fields(sysid.IOData)):
            np.testing.assert_array_equal(getattr(part, name), getattr(rows, name), err_msg=name)
            np.testing.assert_array_equal(getattr(part, name), getattr(record, name), err_msg=name)
        for numbers in (part.u, part.y, part.u_offset, part.y_offset):
            numbers[:] = 0.0
    np.testing.assert_array_equal(whole.y, before)
    assert whole.experiments[0].y_offset.tolist() == [1.0, 2.0]


def test_records_of_swapped_channels_do_not_merge():
    first = sysid.IOData(np.arange(9.0), np.ones(9), 0.1, u_name="volt", y_name="angle")
    swapped = sysid.IOData(np.ones(9), np.arange(9.0), 0.1, u_name="angle", y_name="volt")
    with pytest.raises(sysid.InputError, match="record 2 has 'angle' as input and 'volt' as output"):
        sysid.IOData.merge(first, swapped)
    other = sysid.IOData(np.arange(9.0), np.ones(9), 0.1, u_name="Spannung", y_name="Winkel")
    assert sysid.IOData.merge(first, other).lengths == (9, 9)


def test_an_object_that_is_no_array_for_a_reason_of_its_own_is_refused():
    class Tensor:
        def __array__(self, dtype=None, copy=None):
            raise RuntimeError("detach it first")

    with pytest.raises(sysid.InputError, match="values that are not real numbers"):
        sysid.IOData(Tensor(), np.ones(9), 0.1)
