"""What the reader of text tables takes out of files that other programs lay out: columns, units, metadata, notes."""

import csv
import json

import numpy as np
import polars
import pytest
from few_rows import T, U, columns
from hypothesis import given
from hypothesis import strategies as st

from sysid.base.errors import InputError
from sysid.formats import _cells, read_table, write_table
from sysid.formats._unit_names import units_of

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
    **{
        "Spannung in V": "V",
        "Winkel in \u00b0": "\u00b0",
        "Winkel in Grad": "Grad",
        "Angle (degr\u00e9s)": "degr\u00e9s",
    },
    **{"i_A": "A", "height_m": "m", "temp_C": "C", "voltage_thigh_V": "V", "speed / rpm": "rpm", "pwm [%]": "%"},
}
NO_UNITS = (  # a name, an index, a phase, a measured or desired value
    *("q[0]", "x(k)", "f(t)", "angle (raw)", "motor(s)", "phase_A", "y_m", "x_s", "x_d", "u_s", "t_min", "u_max"),
    *(
        "u_in",
        "acc_g",
        "encoder_A",
        "km/h",
        "m/s",
        "U/min",
        "in/out",
        "/topic/m",
        "s",
        "speed in raw",
        "u in",
        "position",
        "load_raw",
    ),
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
        patch.setattr(_cells.blocks, "__defaults__", (size,))
        patch.setattr(_cells, "BLOCK", size)
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
