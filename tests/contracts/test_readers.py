"""What each format's reader takes out of files that other programs lay out: columns, units, metadata, notes."""

import csv
import datetime
import json
import sys

import h5py
import numpy as np
import polars
import pytest
import scipy.io
from hypothesis import given
from hypothesis import strategies as st
from mat_bytes import level_5, vector

from sysid.base.errors import InputError
from sysid.formats import _text, read_table, write_table
from sysid.formats._units import units_of

T = np.arange(6) / 10
U = np.array([0.0, 1.5, -2.25, 3.125, 4.0, -5.5])


def columns(table) -> dict[str, list[float]]:
    return {name: table.numbers(name).tolist() for name in table.names}


# -- text tables -------------------------------------------------------------------------------------------------------

HEADS = {  # text, names, units
    "brackets": ("t [ms],angle (deg),u {V}\n0,1,2\n", ["t [ms]", "angle (deg)", "u {V}"], ["ms", "deg", "V"]),
    "degree sign": ("t/s,angle [\u00b0]\n0,1\n", ["t/s", "angle [\u00b0]"], ["s", "\u00b0"]),
    "tails": (
        "time_s,u_V,pos/deg,x_1,u_in\n0,1,2,3,4\n",
        ["time_s", "u_V", "pos/deg", "x_1", "u_in"],
        ["s", "V", "deg"],
    ),
    "units below": ("time,u,n\ns,V,\n0,1,2\n", ["time", "u", "n"], ["s", "V"]),
    "units below in brackets": ("time;u\n[ms];[mV]\n0;1\n", ["time", "u"], ["ms", "mV"]),
    "names in a comment": ("# t u_V\n0 1\n", ["t", "u_V"], [None, "V"]),
    "remark of as many words": ("# 2 runs\n0 1\n", ["1", "2"], []),
    "column without a name": (",u\n0,1\n", ["1", "u"], []),
    "numbers as names": ("time,1,2\n0.5,1,2\n", ["time", "1", "2"], []),
}


@pytest.mark.parametrize(("text", "names", "units"), HEADS.values(), ids=HEADS)
def test_names_and_units(text, names, units, tmp_path):
    path = tmp_path / "a.csv"
    path.write_text(text, encoding="utf-8")
    table = read_table(path)
    assert list(table.names) == names
    assert table.units == {name: unit for name, unit in zip(names, units, strict=False) if unit}
    assert all(len(values) == 1 for values in columns(table).values())


UNITS = {
    **{"speed [rad/s]": "rad/s", "acc [m/s^2]": "m/s^2", "M [N\u00b7m]": "N\u00b7m", "k [V/(rad*s)]": "V/(rad*s)"},
    **{"Time(s)": "s", "TIME_MS": "ms", "Time ms": "ms", "speed_rad_s": "rad/s", "acc_m_s2": "m/s^2", "U/V": "V"},
    **{"i_A": "A", "height_m": "m", "temp_C": "C", "voltage_thigh_V": "V", "speed / rpm": "rpm", "pwm [%]": "%"},
}
NO_UNITS = (  # a name, an index, a phase, a measured or desired value
    *("q[0]", "x(k)", "f(t)", "angle (raw)", "motor(s)", "phase_A", "y_m", "x_s", "x_d", "u_s", "t_min", "u_max"),
    *("u_in", "acc_g", "encoder_A", "km/h", "m/s", "U/min", "in/out", "/topic/m", "s", "position", "load_raw"),
)


def test_units_of_names():
    assert units_of(UNITS) == UNITS
    assert {name: units_of([name]) for name in NO_UNITS} == {name: {} for name in NO_UNITS}
    assert units_of(["i_U", "i_V", "i_W"]) == units_of(["phase [A]", "phase [B]"]) == {}
    assert units_of(["motor_V", "motor_rpm"]) == {"motor_V": "V", "motor_rpm": "rpm"}


def test_what_qpal_wrote_as_text_is_read_back_whole_and_by_others(tmp_path):
    meta = {"joint": "thigh", "said": "line\nbreak, \u00b0 # %", "deep": {"a": [1, None]}}
    path = write_table(tmp_path / "a.csv", {"t": T, "u": U}, json.dumps(meta))
    table = read_table(path)
    assert table.meta == meta
    assert columns(table) == {"t": T.tolist(), "u": U.tolist()}
    assert list(table.rows[0]) == [3, 4, 5, 6, 7, 8]  # the comment is row 1, the names row 2
    np.testing.assert_array_equal(np.genfromtxt(path, delimiter=",", names=True, skip_header=1)["u"], U)
    assert polars.read_csv(path, comment_prefix="#")["u"].to_list() == U.tolist()


@pytest.mark.parametrize("suffix", [".csv", ".mat", ".parquet"])
@pytest.mark.parametrize("header", ["", "not JSON", "[1, 2]", "[" * 9999, "two\nlines"])
def test_a_header_that_is_no_object_gives_no_meta(header, suffix, tmp_path):
    from sysid.formats import read_header

    path = write_table(tmp_path / f"a{suffix}", {"t": T, "u": U}, header)
    assert read_table(path).meta == {}
    assert read_header(path) == header


@given(
    rows=st.lists(
        st.tuples(
            st.integers(-(10**9), 10**9),
            st.floats(allow_nan=False, allow_infinity=False).filter(lambda x: abs(x) < 1e99),
            st.sampled_from(["x", "-1.5", "", "a b", "7"]),
            st.sampled_from(["", "", "", "# said", "  ", "\n"]),
        ),
        min_size=2,
        max_size=40,
    ),
    quoted=st.booleans(),
    size=st.integers(8, 200),
)
def test_blocks_of_any_size_and_lines_of_any_kind_read_alike(rows, quoted, size, tmp_path_factory):
    """Against the csv module on the whole file: quotes, comments and blank lines send a block down the slow path."""
    path = tmp_path_factory.mktemp("blocks") / "a.csv"
    mark = '"' if quoted else ""
    lines = ["a,b,c"]
    for a, b, c, between in rows:
        lines += [between] if between else []
        lines.append(f"{mark}{a}{mark},{b!r},{mark}{c}{mark}")
    text = "\n".join(lines) + "\n"
    path.write_text(text, encoding="utf-8")
    wanted = [(number, line) for number, line in enumerate(text.split("\n"), 1) if line.strip() and line[0] != "#"][1:]
    cells = list(csv.reader([line for _, line in wanted]))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(_text.blocks, "__defaults__", (size,))
        patch.setattr(_text, "BLOCK", size)
        table = read_table(path)
    assert list(table.rows[0]) == [number for number, _ in wanted]
    assert table.numbers("a").tolist() == [float(row[0]) for row in cells]
    assert table.numbers("b").tolist() == [float(row[1]) for row in cells]
    wrong = next((k for k, row in enumerate(cells) if row[2] in ("x", "", "a b")), None)
    if wrong is None:
        assert table.numbers("c").tolist() == [float(row[2]) for row in cells]
    elif not any(row[2] == "" for row in cells):
        with pytest.raises(InputError, match=f"row {wanted[wrong][0]}, column 'c'.* not a number"):
            table.numbers("c")


# -- Parquet, NumPy, JSON ----------------------------------------------------------------------------------------------


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


# -- MATLAB ------------------------------------------------------------------------------------------------------------


def structs(*entries: dict) -> np.ndarray:
    """A MATLAB struct array 1xn."""
    found = np.empty((1, len(entries)), dtype=[(name, object) for name in entries[0]])
    for k, entry in enumerate(entries):
        found[0, k] = tuple(entry.values())
    return found


def test_matlab_5_structs_cells_and_structure_with_time(tmp_path):
    pair = np.column_stack([U, -U])
    signals = structs({"values": U[:, None], "label": "pos_deg"}, {"values": pair, "label": ""})
    content = {
        "s": {"u": U, "about": {"k": 3.0, "by": "me"}},
        "log": {"time": T[:, None], "signals": signals, "blockName": "model/To Workspace"},
        "one": {"time": T[:, None], "signals": {"values": pair.T.reshape(1, 2, 6), "label": "q", "dimensions": 2.0}},
        "wide": {"time": T[:, None], "signals": {"values": np.arange(48.0).reshape(1, 8, 6), "label": ""}},
        "points": structs({"t": 0.5, "x": U}, {"t": 1.5, "x": -U}),
        "c": np.array([U, "text"], dtype=object),
        "on": U > 0,
    }
    scipy.io.savemat(tmp_path / "a.mat", content)
    table = read_table(tmp_path / "a.mat")
    u, t = U.tolist(), T.tolist()
    assert columns(table) == {
        **{"s.u": u, "log.time": t, "log.pos_deg": u, "log.signals(2):1": u, "log.signals(2):2": (-U).tolist()},
        **{"one.time": t, "one.q:1": u, "one.q:2": (-U).tolist()},
        "wide.time": t,
        **{f"wide.signals:{j + 1}": list(range(6 * j, 6 * j + 6)) for j in range(8)},  # more signals than samples
        **{"points.t": [0.5, 1.5], "points(1).x": u, "points(2).x": (-U).tolist(), "c{1}": u},
        "on": (U > 0).astype(float).tolist(),
    }
    assert table.units == {"log.time": "s", "one.time": "s", "wide.time": "s", "log.pos_deg": "deg"}
    assert table.meta == {"s.about.k": 3.0, "s.about.by": "me", "c{2}": "text"}


def test_matlab_5_of_either_byte_order_and_compressed(tmp_path):
    scipy.io.savemat(
        tmp_path / "a.mat", {"u": U, "S": scipy.sparse.csc_array(np.diag(U)), "z": "x"}, do_compression=True
    )
    assert read_table(tmp_path / "a.mat").numbers("u").tolist() == U.tolist()
    (tmp_path / "b.mat").write_bytes(level_5(vector(b"u", U)))
    assert read_table(tmp_path / "b.mat").numbers("u").tolist() == U.tolist()
    scipy.io.savemat(tmp_path / "c.mat", {"u": U}, format="4")
    assert read_table(tmp_path / "c.mat").numbers("u").tolist() == U.tolist()


def matlab_73(path, build) -> None:
    """A file of version 7.3 as MATLAB lays it out: a text block in front, classes as attributes, axes reversed."""
    with h5py.File(path, "w", userblock_size=512) as file:
        build(file)
    with path.open("r+b") as raw:
        raw.write(b"MATLAB 7.3 MAT-file, Platform: PCWIN64".ljust(124) + bytes([0, 2]) + b"IM")


def put(group, name: str, values: np.ndarray, kind: str = "double"):
    node = group.create_dataset(name, data=values)
    node.attrs["MATLAB_class"] = np.bytes_(kind)
    return node


def struct_in(group, name: str):
    node = group.create_group(name)
    node.attrs["MATLAB_class"] = np.bytes_("struct")
    return node


def letters(text: str) -> np.ndarray:
    return np.array([[ord(letter)] for letter in text], dtype=np.uint16)


def test_matlab_73(tmp_path):
    def build(file):
        refs = file.create_group("#refs#")
        put(file, "u", U[None, :])  # 6x1 in MATLAB
        put(file, "M", np.stack([T, U]))  # 6x2 in MATLAB
        put(file, "gain", np.array([[2.5]]))
        put(file, "name", letters("leg"), "char")
        put(file, "empty", np.array([0, 0], dtype=np.uint64)).attrs["MATLAB_empty"] = np.uint8(1)
        s = struct_in(file, "s")
        put(s, "t_ms", T[None, :] * 1000)
        put(struct_in(s, "deep"), "y", -U[None, :])
        log = struct_in(file, "log")
        put(log, "time", T[None, :])
        signals = struct_in(log, "signals")  # an array 1x2 of structs: each field a list of references
        kept = {"values": (U[None, :], -U[None, :]), "label": (letters("pos"), letters("vel"))}
        for field, pair in kept.items():
            made = [
                put(refs, f"{field}{k}", each, "char" if field == "label" else "double") for k, each in enumerate(pair)
            ]
            signals.create_dataset(field, data=np.array([[node.ref] for node in made], dtype=h5py.ref_dtype))
        wide = struct_in(file, "wide")
        put(wide, "time", T[None, :])
        put(struct_in(wide, "signals"), "values", np.arange(48.0).reshape(8, 6))  # 6x8 in MATLAB
        cell = file.create_dataset("c", data=np.array([[refs["values0"].ref]], dtype=h5py.ref_dtype))
        cell.attrs["MATLAB_class"] = np.bytes_("cell")
        ts = put(file, "ts", np.array([[0xDD000000, 2, 1, 1, 1, 1]], dtype=np.uint32), "timeseries")
        ts.attrs["MATLAB_object_decode"] = np.int32(3)

    matlab_73(tmp_path / "a.mat", build)
    table = read_table(tmp_path / "a.mat")
    u, t = U.tolist(), T.tolist()
    assert columns(table) == {
        **{"u": u, "M:1": t, "M:2": u, "s.t_ms": (T * 1000).tolist(), "s.deep.y": (-U).tolist()},
        **{"log.time": t, "log.pos": u, "log.vel": (-U).tolist(), "c{1}": u},
        "wide.time": t,
        **{f"wide.signals:{j + 1}": list(range(6 * j, 6 * j + 6)) for j in range(8)},
    }
    assert table.meta == {"gain": 2.5, "name": "leg"}
    assert table.units == {"s.t_ms": "ms", "log.time": "s", "wide.time": "s"}
    assert any("ts (timeseries object)" in note and "t = ts.Time; y = ts.Data" in note for note in table.notes)


# -- captures ----------------------------------------------------------------------------------------------------------

FORMS = {
    "commas": ("{0},{1},{2}", "ms,adc,pwm"),
    "semicolons": ("{0}; {1}; {2}", "# ms;adc;pwm"),
    "blanks": ("{0} {1} {2}", "ms adc pwm"),
    "pairs": ("ms={0} adc={1} pwm={2}", ""),
    "pairs with colons": ("ms: {0}, adc: {1}, pwm: {2}", "hello"),
    "stamped by a terminal": ("12:00:01.234 -> {0},{1},{2}", "ms,adc,pwm"),
}


@pytest.mark.parametrize("suffix", [".log", ".txt"])
@pytest.mark.parametrize(("form", "names"), FORMS.values(), ids=FORMS)
def test_captures_of_every_form(form, names, suffix, tmp_path):
    samples = [(5 * k, 500 + k % 7, (-1) ** (k // 9) * 80) for k in range(60)]
    lines = ["rst:0x1 (POWERON_RESET)", names, *(form.format(*sample) for sample in samples)]
    lines[40] = lines[40][:4]
    path = tmp_path / f"a{suffix}"
    path.write_text("\r\n".join(lines) + "\r\n", newline="")
    table = read_table(path)
    assert table.names == ("ms", "adc", "pwm")
    assert np.column_stack(table.columns).tolist() == [list(each) for k, each in enumerate(samples) if k != 38]
    assert list(table.rows[0]) == [k + 3 for k in range(60) if k != 38]
    assert any("1 garbled line (row 41)" in note for note in table.notes)


def test_pairs_alone_called_txt_are_a_capture(tmp_path):
    path = tmp_path / "a.txt"
    path.write_text("t=1 adc=512\nt=2 adc=513\nt=3 adc=511\nt=4 adc=512\nt=5 adc=510\n")
    assert columns(read_table(path)) == {"t": [1, 2, 3, 4, 5], "adc": [512, 513, 511, 512, 510]}


@pytest.mark.parametrize("seed", range(6))
def test_garbled_captures_lose_no_good_line_and_few_bad_ones_pass(seed, tmp_path):
    """2 % of the lines garbled in four ways: every good line comes back as it was, at most 8 % of the bad ones pass.

    Those are the ones that no rule can see, such as a changed sign where the level changes too.
    """
    rng = np.random.default_rng(seed)
    n = 4000
    t = 12000 + np.cumsum(rng.integers(9, 12, n))
    adc = np.round(512 + 300 * np.sin(np.arange(n) / 50) + rng.normal(0, 2, n)).astype(int)
    pwm = np.repeat(rng.integers(-255, 256, n // 20), 20)
    whole = [f"{a},{b},{c}" for a, b, c in zip(t, adc, pwm, strict=True)]
    out, right, k = ["boot", "t_ms,adc,pwm"], [None, None], 0
    while k < n:
        line = whole[k]
        bad = rng.random() < 0.02 and k + 1 < n
        if bad:
            i, way = rng.integers(0, len(line)), rng.integers(0, 4)
            after = whole[k + 1]
            line = (
                line[:i] + line[i + 1 :],
                line[:i] + chr(rng.integers(128, 255)) + line[i + 1 :],
                line[:i] + after[rng.integers(0, len(after)) :],
                line + after,
            )[way]
            k += way > 1
        out.append(line)
        right.append(None if bad else (t[k], adc[k], pwm[k]))
        k += 1
    path = tmp_path / "a.log"
    path.write_text("\n".join(out) + "\n", encoding="latin-1")
    table = read_table(path)
    found = dict(zip(table.rows[0], np.column_stack(table.columns).tolist(), strict=True))
    good = {row: list(each) for row, each in enumerate(right, 1) if each}
    assert {row: found.get(row) for row in good} == good
    passed = [row for row in found if row not in good]
    assert len(passed) <= 0.08 * sum(each is None for each in right[2:])


# -- robots ------------------------------------------------------------------------------------------------------------

START = 1_700_000_000_123_456_789  # [ns]


def joint_states(store, k: int):
    """A message with its joints in changing order, stamped 1 ms before it was logged."""
    message, header, stamp = (
        store.types[kind]
        for kind in ("sensor_msgs/msg/JointState", "std_msgs/msg/Header", "builtin_interfaces/msg/Time")
    )
    at = START + k * 10_000_000 - 1_000_000
    order = [0, 1] if k % 2 else [1, 0]
    return message(
        header=header(stamp=stamp(sec=at // 10**9, nanosec=at % 10**9), frame_id=""),
        name=[("thigh", "shank")[i] for i in order],
        position=np.array([(k * 0.5, -k * 0.25)[i] for i in order]),
        velocity=np.array([]),
        effort=np.array([]),
    )


@pytest.mark.parametrize("storage", ["SQLITE3", "MCAP"])
def test_a_bag_of_ros_2_as_folder_and_as_file(storage, tmp_path):
    pytest.importorskip("rosbags")
    from rosbags.rosbag2 import StoragePlugin, Writer
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS2_HUMBLE)
    with Writer(tmp_path / "bag", version=9, storage_plugin=StoragePlugin[storage]) as bag:
        states = bag.add_connection("/joint_states", "sensor_msgs/msg/JointState", typestore=store)
        volts = bag.add_connection("/u", "std_msgs/msg/Float64", typestore=store)
        names = bag.add_connection("/said", "std_msgs/msg/String", typestore=store)
        for k in range(8):
            at = START + k * 10_000_000
            bag.write(states, at, store.serialize_cdr(joint_states(store, k), "sensor_msgs/msg/JointState"))
            if k % 2:
                kind = store.types["std_msgs/msg/Float64"]
                bag.write(volts, at + 5, store.serialize_cdr(kind(data=k / 8), "std_msgs/msg/Float64"))
            text = store.types["std_msgs/msg/String"](data="x")
            bag.write(names, at, store.serialize_cdr(text, "std_msgs/msg/String"))
    (inner,) = (path for path in (tmp_path / "bag").iterdir() if path.suffix in (".db3", ".mcap"))
    for path in (tmp_path / "bag", inner):
        table = read_table(path)
        found = columns(table)
        assert found["joint_states.position[thigh]"] == [k * 0.5 for k in range(8)]
        assert found["joint_states.position[shank]"] == [-k * 0.25 for k in range(8)]
        assert found["joint_states.time"] == [k * 0.01 for k in range(8)]
        assert found["joint_states.header.stamp"] == [(k * 10 - 1) / 1000 for k in range(8)]
        assert found["u.data"] == [k / 8 for k in (1, 3, 5, 7)]
        np.testing.assert_allclose(found["u.time"], [k * 0.01 + 5e-9 for k in (1, 3, 5, 7)], rtol=1e-12)
        assert set(table.names) == {
            *("joint_states.time", "joint_states.position[thigh]", "joint_states.position[shank]"),
            *("joint_states.header.stamp", "u.time", "u.data"),
        }
        assert {name for name, unit in table.units.items() if unit == "s"} == {
            *("joint_states.time", "joint_states.header.stamp", "u.time"),
        }
        assert table.meta["start_ns"] == START


def test_mcap_in_json_is_kept_up_to_where_it_was_cut(tmp_path):
    writer = pytest.importorskip("mcap.writer")
    path = tmp_path / "a.mcap"
    with path.open("wb") as file:
        bag = writer.Writer(file, chunk_size=256)
        bag.start()
        schema = bag.register_schema("m", "jsonschema", b"{}")
        motor, raw = bag.register_channel("/motor", "json", schema), bag.register_channel("/raw", "protobuf", schema)
        for k in range(100):
            content = {"u_V": k / 4, "on": k > 50, "name": "m", "n": {"x": [k, -k]}, "scan": [0] * 100, "time": 7}
            bag.add_message(motor, START + k * 1_000_000, json.dumps(content).encode(), 0)
        bag.add_message(raw, START, b"\1\2", 0)
        bag.finish()
    table = read_table(path)
    found = columns(table)
    assert found["motor.u_V"] == [k / 4 for k in range(100)]
    assert found["motor.n.x[1]"] == [-k for k in range(100)]
    assert found["motor.on"] == [float(k > 50) for k in range(100)]
    assert found["motor.time"] == pytest.approx([k / 1000 for k in range(100)], abs=1e-12)
    assert found["motor.message.time"] == [7.0] * 100
    assert not any("scan" in name for name in table.names)
    assert table.units == {"motor.time": "s", "motor.u_V": "V"}
    assert any("/raw (messages in protobuf)" in note for note in table.notes)
    path.write_bytes(path.read_bytes()[:9000])
    table = read_table(path)
    count = len(table.columns[0])
    assert 10 < count < 100
    assert table.numbers("motor.u_V").tolist() == [k / 4 for k in range(count)]
    assert any(f"kept the {count} messages" in note for note in table.notes)


@pytest.mark.parametrize("suffix", [".mcap", ".bag", ".db3"])
def test_without_the_extra_a_sentence_says_how_to_install_it(suffix, tmp_path, monkeypatch):
    for name in ("mcap.reader", "rosbags.highlevel"):
        monkeypatch.setitem(sys.modules, name, None)
    (tmp_path / f"a{suffix}").write_bytes(b"x")
    with pytest.raises(InputError, match=r"needs mcap and rosbags; install them with pip install 'qpal\[robot\]'"):
        read_table(tmp_path / f"a{suffix}")
