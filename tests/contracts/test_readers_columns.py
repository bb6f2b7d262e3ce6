"""What the readers of Parquet, NumPy, JSON and MAT records take out of files that other programs lay out."""

import datetime
import json

import numpy as np
import polars
import pytest
import scipy.io
from few_rows import T, U, columns

from sysid.base.errors import InputError
from sysid.formats import read_table


def test_parquet_times_booleans_and_nested_columns(tmp_path):
    at = datetime.datetime(2026, 3, 1, 12, 0, 0)
    frame = polars.DataFrame(
        {
            "at": [at, at + datetime.timedelta(microseconds=250), None],
            "since": [at - datetime.timedelta(seconds=2)] * 3,
            "span": [datetime.timedelta(milliseconds=1.5)] * 3,
            "on": [True, False, True],
            "imu": [{"x": 1.0, "n": 2}] * 3,
            "q": [[1.0, 2.0], [3.0, 4.0], [5.0, 6.0]],
            "label": ["a", "b", "c"],
            "t_ms": [1, 2, 3],
        }
    )
    frame.write_parquet(tmp_path / "a.parquet")
    table = read_table(tmp_path / "a.parquet")
    np.testing.assert_array_equal(table.columns[0], [2.0, 2.00025, np.nan])
    assert table.columns[1].tolist() == [0.0] * 3
    found = {name: np.asarray(values).tolist() for name, values in zip(table.names, table.columns, strict=True)}
    assert table.names == ("at", "since", "span", "on", "imu.x", "imu.n", "q[0]", "q[1]", "t_ms")
    assert found["span"] == [0.0015] * 3
    assert found["on"] == [1.0, 0.0, 1.0]
    assert found["q[1]"] == [2.0, 4.0, 6.0]
    assert table.units == {"at": "s", "since": "s", "span": "s", "t_ms": "ms"}
    assert table.meta["start"].startswith("2026-03-01T11:59:58")
    assert any("label (String)" in note for note in table.notes)


def test_numpy_matrices_records_and_what_is_no_signal(tmp_path):
    record = np.zeros(6, dtype=[("t", "f8"), ("n", "i4")])
    record["t"] = T
    np.savez(tmp_path / "a.npz", M=np.stack([T, U]), r=record, gain=2.5, name="leg", cube=np.zeros((2, 3, 4)), z=T + 1j)
    table = read_table(tmp_path / "a.npz")
    assert columns(table) == {"M:1": T.tolist(), "M:2": U.tolist(), "r.t": T.tolist(), "r.n": [0.0] * 6}
    assert table.meta == {"gain": 2.5, "name": "leg"}
    assert any("cube (numeric 2x3x4)" in note and "z (complex 6)" in note for note in table.notes)
    big = np.array([1_700_000_000_123_456_789, 1_700_000_000_133_456_789])
    np.save(tmp_path / "big.npy", big)
    table = read_table(tmp_path / "big.npy")
    assert table.numbers("1").tolist() == [1.7000000001234568e18, 1.7000000001334568e18]
    assert any("2^53" in note for note in table.notes)


SHAPES = {  # JSON value: columns, meta
    "samples": (
        [{"t": 0, "q": [1, 2], "m": {"u": 5}}] * 2,
        {"t": [0, 0], "q[0]": [1, 1], "q[1]": [2, 2], "m.u": [5, 5]},
        {},
    ),
    "entries": (
        {"kp": 100, "entries": [{"t": 0, "on": True}, {"t": 1, "on": False}]},
        {"t": [0, 1], "on": [1, 0]},
        {"kp": 100},
    ),
    "two lists": ({"a": [{"t": 0}], "b": [{"t": 1}, {"t": 2}]}, {"a.t": [0], "b.t": [1, 2]}, {}),
    "columns": ({"t": [0, 1], "u": [2, 3], "by": "me"}, {"t": [0, 1], "u": [2, 3]}, {"by": "me"}),
    "columns in an object": ({"data": {"t": [0, 1]}, "about": {"m": 1}}, {"data.t": [0, 1]}, {"about": {"m": 1}}),
    "rows": ([[0, 5], [1, 6], [2, 7]], {"1": [0, 1, 2], "2": [5, 6, 7]}, {}),
    "rows of channels": ([[0, 1, 2], [5, 6, 7]], {"1": [0, 1, 2], "2": [5, 6, 7]}, {}),
    "numbers": ([1, 2, 3], {"1": [1, 2, 3]}, {}),
    "pandas, columns": ({"t": {"0": 0.5, "1": 1.5}, "u": {"0": 2, "1": 3}}, {"t": [0.5, 1.5], "u": [2, 3]}, {}),
    "pandas, split": (
        {"columns": ["t", "u"], "index": [0, 1], "data": [[0, 2], [1, 3]]},
        {"t": [0, 1], "u": [2, 3]},
        {},
    ),
    "empty beside": ({"t": [0, 1], "events": []}, {"t": [0, 1]}, {"events": []}),
}


@pytest.mark.parametrize(("value", "right", "meta"), SHAPES.values(), ids=SHAPES)
def test_json_of_every_shape(value, right, meta, tmp_path):
    path = tmp_path / "a.json"
    path.write_text(json.dumps(value))
    table = read_table(path)
    assert columns(table) == right
    assert table.meta == meta


def test_json_lines_keep_their_rows_and_a_first_line_about_the_record(tmp_path):
    path = tmp_path / "a.jsonl"
    path.write_text('{"mass": 0.5}\n\n{"t": 0, "u_V": 1}\n{"t": 1, "u_V": "x"}\n')
    table = read_table(path)
    assert table.meta == {"mass": 0.5}
    assert table.units == {"u_V": "V"}
    with pytest.raises(InputError, match="row 4, column 'u_V': found 'x'"):
        table.numbers("u_V")


def test_the_servo_records(records):
    path = sorted((records / "bam_xl330").glob("*.json"))[0]
    table = read_table(path)
    raw = json.loads(path.read_text())
    assert table.meta == {name: value for name, value in raw.items() if name != "entries"}
    assert table.numbers("position").tolist() == [entry["position"] for entry in raw["entries"]]
    assert table.units == {"input_volts": "volts"}


@pytest.mark.parametrize("name", ["ced/DATAUNIF", "emps/DATA_EMPS"])
def test_matlab_files_of_others(name, records):
    path = next(
        path
        for path in (records / name).parent.iterdir()
        if path.stem == name.split("/")[1] and "csv" not in path.suffix
    )
    table = read_table(path)
    raw = {key: value for key, value in scipy.io.loadmat(path).items() if not key.startswith("__") and value.size > 1}
    assert set(table.names) == set(raw)
    for key, value in raw.items():
        np.testing.assert_array_equal(table.numbers(key), value.ravel())
