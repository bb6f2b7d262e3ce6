"""Files of measurement programs and robots: each is written by its published layout or its library, and the plant comes
back, also where input and output have times of their own.
"""

import struct
import sys
from contextlib import suppress

import numpy as np
import pytest
from loggers import WRITERS, Series, wpilog_record, wpilog_start
from plants_in_time import GAIN, TAU, level_at, pole_and_gain, response, steps

from sysid.base.errors import InputError
from sysid.formats import read_table
from sysid.formats._groups import Group, group_of
from sysid.workflow.record import read_record

TS, SHIFT = 0.02, 0.0031
LEVELS = steps(3, 0.24, 12.0)
T = np.arange(600) * TS
KINDS: dict[str, tuple[Series, Series]] = {  # input [V] and output [rad]
    "one clock": ((T, level_at(T, *LEVELS)), (T, response(T, *LEVELS))),
    "on change": (LEVELS, (T + SHIFT, response(T + SHIFT, *LEVELS))),
    "slow input": ((T[::4], level_at(T[::4], *LEVELS)), (T, response(T, *LEVELS))),
}


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("file", WRITERS)
def test_the_plant_comes_back_from_every_logger(file, kind, tmp_path):
    u, y = KINDS[kind]
    WRITERS[file](tmp_path / file, u, y)
    record = read_record(tmp_path / file)
    assert (record.data.N, round(record.data.Ts, 7), record.data.missing) == (600, TS, None)
    np.testing.assert_allclose(record.data.y[:, 0], y[1], rtol=0, atol=1e-12)
    found = pole_and_gain(record.data.u[:, 0], record.data.y[:, 0])
    assert found == pytest.approx((np.exp(-TS / TAU), GAIN), abs=1e-6)
    assert any("rates of their own" in note for note in record.notes) == (kind != "one clock")
    if kind == "on change":
        assert any("3.1 ms before" in note for note in record.notes)


@pytest.mark.parametrize(
    ("module", "suffix", "extra"), [("asammdf", ".mf4", "mdf"), ("nptdms", ".tdms", "tdms"), ("pyulog", ".ulg", "ulog")]
)
def test_without_the_extra_a_sentence_says_how_to_install_it(module, suffix, extra, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, module, None)
    (tmp_path / f"a{suffix}").write_bytes(b"x")
    with pytest.raises(InputError, match=rf"needs \w+; install it with pip install 'qpal\[{extra}\]'"):
        read_table(tmp_path / f"a{suffix}")


@pytest.mark.parametrize(
    "file", [pytest.param(n, marks=pytest.mark.nightly) if n == "a.mdf" else n for n in WRITERS if n != "a.csv"]
)
def test_a_damaged_file_is_a_sentence_or_a_table(file, tmp_path):
    """Cut at drawn places, and with drawn bytes changed: a sentence, or a table."""
    WRITERS[file](tmp_path / file, *KINDS["on change"])
    whole, rng = (tmp_path / file).read_bytes(), np.random.default_rng(0)
    for k in range(12):
        raw = bytearray(whole[: rng.integers(1, len(whole))] if k % 2 else whole)
        if not k % 2:
            places = rng.integers(0, min(len(raw), 400), 5)
            for place in places:
                raw[place] = rng.integers(0, 256)
        (tmp_path / file).write_bytes(raw)
        with suppress(InputError):
            table = read_table(tmp_path / file)
            assert len(table.names) == len(table.columns) > 0


def test_segments_without_x_columns_follow_each_other_by_their_dates(tmp_path):
    """Two segments of 300 samples, the second by its date; decimal commas; the file is split by commas elsewhere."""
    (_, u), (_, y) = KINDS["one clock"]
    lines = [
        "LabVIEW Measurement\t",
        "Separator\tTab",
        "Decimal_Separator\t,",
        "X_Columns\tNo",
        "***End_of_Header***",
        "",
    ]
    for first in (0, 300):
        time = f"12:00:{30 + first * TS:09.6f}".replace(".", ",")
        lines += ["Channels\t2", "Samples\t300\t300", "Date\t2024/05/16\t2024/05/16", f"Time\t{time}\t{time}"]
        lines += [
            "X0\t0,0\t0,0",
            f"Delta_X\t{TS}\t{TS}".replace(".", ","),
            "***End_of_Header***",
            "X_Value\tu\ty\tComment",
        ]
        rows = (f"\t{u[k]}\t{float(y[k])!r}".replace(".", ",") for k in range(first, first + 300))
        lines += [*rows, ""]
    (tmp_path / "a.lvm").write_text("\n".join(lines))
    record = read_record(tmp_path / "a.lvm")
    assert (record.data.N, round(record.data.Ts, 9)) == (600, TS)
    assert pole_and_gain(record.data.u[:, 0], record.data.y[:, 0]) == pytest.approx((np.exp(-TS / TAU), GAIN), abs=1e-6)


@pytest.mark.parametrize("columns", ["No", "Multi"])
def test_channels_that_begin_at_times_of_their_own_are_that_far_apart(columns, tmp_path):
    u, y = np.arange(8.0), 10.0 + np.arange(8.0)
    gap = "\t\t" if columns == "Multi" else "\t"
    times = f"Date\t2026/03/17{gap}2026/03/17", f"Time\t10:00:00{gap}10:00:01.04"
    head = [
        "LabVIEW Measurement\t",
        "Separator\tTab",
        f"X_Columns\t{columns}",
        "***End_of_Header***",
        "",
        "Channels\t2",
    ]
    rows = [f"\t{a}\t{b}" for a, b in zip(u, y, strict=True)]
    if columns == "Multi":
        rows = [f"{0.02 * k}\t{a}\t{0.02 * k}\t{b}" for k, (a, b) in enumerate(zip(u, y, strict=True))]
    names = "X_Value\tu\tX_Value\ty\tComment" if columns == "Multi" else "X_Value\tu\ty\tComment"
    lines = [*head, *times, f"X0\t0{gap}0", f"Delta_X\t0.02{gap}0.02", "***End_of_Header***", names, *rows, ""]
    (tmp_path / "a.lvm").write_text("\n".join(lines))
    table = read_table(tmp_path / "a.lvm")
    values = dict(zip(table.names, table.columns, strict=True))
    shift = values[table.clocks["y"]] - values[table.clocks["u"]]
    np.testing.assert_allclose(shift, 1.04, atol=1e-9)


def test_arrays_truth_values_and_a_cut_end_of_a_log_of_wpilib(tmp_path):
    path = tmp_path / "a.wpilog"
    raw = (
        b"WPILOG" + struct.pack("<HI", 0x0100, 0) + wpilog_start(1, "xy", "float[]") + wpilog_start(2, "on", "boolean")
    )
    raw += wpilog_start(3, "n", "int64")
    for k in range(20):
        raw += wpilog_record(1, k * 0.02, struct.pack("<2f", k, -k)) + wpilog_record(2, k * 0.02, bytes([k % 2]))
        raw += wpilog_record(3, k * 0.02, struct.pack("<q", -k))
    path.write_bytes(raw[:-3])
    table = read_table(path)
    assert table.numbers("xy[1]").tolist() == [-float(k) for k in range(20)]
    assert table.numbers("on").tolist() == [k % 2 for k in range(20)]
    assert table.numbers("n").tolist() == [-k for k in range(19)]
    assert "the file is cut off; its last record is left out" in table.notes
    assert table.clocks["xy[0]"] == table.clocks["on"] != table.clocks["n"]


def test_channels_without_a_time_stand_beside_those_that_have_one():
    t = np.array([0.0, 0.1])
    groups: list[Group] = []
    timed, plain = group_of(groups, "a", t), group_of(groups, "b", None)
    assert [group.name for group in groups] == ["a", "b"]
    assert group_of(groups, "c", None) is plain
    assert group_of(groups, "d", t.copy()) is timed
