"""Signals with clocks of their own in plain tables: a plant that is known in continuous time comes back from each."""

import json
import re
from datetime import datetime, timedelta
from itertools import zip_longest
from pathlib import Path

import numpy as np
import pytest
from plants_in_time import GAIN, TAU, level_at, pole_and_gain, response, steps
from scipy.io import savemat

import sysid
from sysid.base.errors import InputError
from sysid.channels.guess import guess
from sysid.channels.mapping import Channel, ChannelMap, Clock
from sysid.channels.mapping_file import read_map, write_map
from sysid.channels.reading import read_signals
from sysid.workflow.record import read_record

SECONDS, TS = 12.0, 0.02
POLE = np.exp(-TS / TAU)
Each = tuple[np.ndarray, ...]
RATES = {"shift": (0.02, 0.0031), "slow input": (0.06, 0.0031), "fast input": (0.005, 0.0)}  # step of u, shift of y
NAMES = [
    *("t_u,u,t_y,y", "time_u [s],u,time_y [s],y", "u_time,u_value,y_time,y_value", "t1,u,t2,y", "t_in,u,t_out,y"),
    *("time,voltage,time_2,angle", "stamp_cmd,cmd,stamp_pos,pos", "CmdTime,CmdVolt,JointTime,JointAngle"),
    *("Time,u,Time,y", "Time (s),u,Time (s),y", "t,cmd,t,pos"),
]


def recorded(u_step: float, shift: float) -> Each:
    """Times and values of input and output; the output is sampled every 20 ms on a clock that is later by `shift`."""
    changes, levels = steps(3, 0.24, SECONDS)
    t_u, t_y = np.arange(0.0, SECONDS - 1e-9, u_step), np.arange(0.0, SECONDS - 1e-9, TS) + shift
    return t_u, level_at(t_u, changes, levels), t_y, response(t_y, changes, levels)


def write(path: Path, each: Each, head: str = "t_u,u,t_y,y") -> Path:
    """The columns in the format of the suffix."""
    if path.suffix == ".csv":
        rows = (",".join("" if x is None else f"{x:.12g}" for x in row) for row in zip_longest(*each))
        path.write_text("\n".join([head, *rows]) + "\n")
    elif path.suffix == ".json":
        t_u, u, t_y, y = (x.tolist() for x in each)
        path.write_text(json.dumps({"input": {"t": t_u, "v": u}, "output": {"t": t_y, "v": y}}))
    elif path.suffix == ".npz":
        np.savez(path, **dict(zip(head.split(","), each, strict=True)))
    else:
        t_u, u, t_y, y = each
        savemat(path, {"u": {"Time": t_u, "Data": u}, "y": {"Time": t_y, "Data": y}})
    return path


def check(record, each: Each, shift: float) -> None:
    """No sample of the output is lost, the input is held, the shift is told, and the plant comes back."""
    assert (record.N, int(record.missing.sum())) == (len(each[3]), 0)
    assert pytest.approx(TS, rel=1e-9) == record.Ts
    np.testing.assert_allclose(record.output[0].values, each[3], rtol=1e-11)
    assert set(np.round(record.input[0].values, 9)) <= set(np.round(each[1], 9))
    assert pole_and_gain(record.input[0].values, record.output[0].values) == pytest.approx((POLE, GAIN), abs=1e-5)
    said = " ".join(record.notes)
    assert (f"each {1e3 * shift:.4g} ms before one of the output's" if shift else "at stamps of the output's") in said


@pytest.mark.parametrize("kind", RATES)
@pytest.mark.parametrize("head", NAMES)
def test_the_names_or_the_places_say_whose_clock_it_is(head, kind, tmp_path):
    each = recorded(*RATES[kind])
    record = read_signals(write(tmp_path / "a.csv", each, head))
    check(record, each, RATES[kind][1])
    assert any("signals have clocks of their own" in note for note in record.notes)


@pytest.mark.parametrize("kind", RATES)
@pytest.mark.parametrize("suffix", [".json", ".npz", ".mat"])
def test_the_rule_is_one_for_every_format(suffix, kind, tmp_path):
    each = recorded(*RATES[kind])
    check(read_signals(write(tmp_path / f"a{suffix}", each)), each, RATES[kind][1])


def test_the_fit_is_that_of_one_table_with_one_clock(tmp_path):
    """The same plant written with the input at the output's stamps; both fits find its pole and gain."""
    own = write(tmp_path / "own.csv", recorded(0.005, 0.0))
    _, u, t, y = recorded(TS, 0.0)
    one = write(tmp_path / "one.csv", (t, u, y), "t,u,y")
    fits = [sysid.fit(sysid.structures.output_error(1, 1, 1), sysid.read(path), starts=1) for path in (own, one)]
    for fit in fits:
        b, f = (fit.theta[fit.model.names.index(f"linear.{name}")] for name in ("b0", "f1"))
        assert (-f, b / (1.0 + f)) == pytest.approx((POLE, GAIN), abs=1e-4)


@pytest.mark.parametrize("head", ["X,Y,X2,Y2", "X1,Y1,X2,Y2", "1,2,3,4"])
def test_pairs_of_x_and_y_are_read_where_the_roles_are_named(head, tmp_path):
    each = recorded(*RATES["slow input"])
    names = head.split(",")
    path = write(tmp_path / "a.csv", each, head if names[0] != "1" else "")
    path.write_text(path.read_text().lstrip("\n"))
    with pytest.raises(InputError, match="--output"):
        read_record(path)
    check(read_record(path, input=names[1], output=names[3]).signals, each, RATES["slow input"][1])


@pytest.mark.parametrize("kind", RATES)
def test_the_mapping_says_whose_clock_it_is_where_nothing_else_does(kind, tmp_path):
    each = recorded(*RATES[kind])
    path = write(tmp_path / "a.csv", each, "time_a,u,time_b,y")
    text = '[[input]]\ncolumn = "u"\nclock = "time_a"\n[[output]]\ncolumn = "y"\nclock = "time_b"\n'
    (tmp_path / "m.toml").write_text(text)
    record = read_signals(path, tmp_path / "m.toml")
    check(record, each, RATES[kind][1])
    assert record.mapping.clock.column == "time_b"
    one_clock = ChannelMap(
        clock=Clock(column="time_b"), input=(Channel(column="u", clock="time_b"),), output=(Channel(column="y"),)
    )
    if kind == "shift":  # which takes the rows as of one time again
        np.testing.assert_allclose(read_signals(path, one_clock).input[0].values, each[1], rtol=1e-11)


def test_the_mapping_that_is_written_names_the_clocks_and_reads_the_same(tmp_path):
    path = write(tmp_path / "a.csv", recorded(*RATES["slow input"]))
    mapping = read_map(write_map(guess(path).mapping, tmp_path / "a.toml"))
    assert (mapping.clock.column, mapping.input[0].clock, mapping.output[0].clock) == ("t_y", "t_u", "")
    np.testing.assert_array_equal(read_signals(path, mapping).io().u, read_signals(path).io().u)


def test_a_clock_that_does_not_fit_its_channel_is_refused_with_one_that_does(tmp_path):
    path = write(tmp_path / "a.npz", recorded(*RATES["slow input"]))
    wrong = ChannelMap(input=(Channel(column="u", clock="t_y"),), output=(Channel(column="y", clock="t_y"),))
    with pytest.raises(InputError, match=r"clock of \[\[input\]\] is 't_y', which has 600.*200; .*such as 't_u'"):
        read_signals(path, wrong)
    both = ChannelMap(
        clock=Clock(column="t_u"), input=(Channel(column="u"),), output=(Channel(column="y", clock="t_y"),)
    )
    with pytest.raises(InputError, match="leave one of the two out"):
        read_signals(path, both)
    with pytest.raises(InputError, match=r"unknown column 't_q' \(input.clock of the mapping\)"):
        read_signals(path, ChannelMap(input=(Channel(column="u", clock="t_q"),), output=(Channel(column="y"),)))


@pytest.mark.parametrize("form", ["%Y-%m-%dT%H:%M:%S.%f", "%Y-%m-%dT%H:%M:%S.%fZ", "%H:%M:%S.%f"])
@pytest.mark.parametrize("start", ["2026-03-01T12:00:00", "2026-03-01T23:59:59.999"])
def test_dates_and_times_of_day_are_counted_from_one_origin(form, start, tmp_path):
    t_u, u, t_y, y = recorded(*RATES["slow input"])
    first = datetime.fromisoformat(start)
    cells = [[(first + timedelta(seconds=float(each))).strftime(form) for each in t] for t in (t_u, t_y)]
    columns = (cells[0], [f"{x:.12g}" for x in u], cells[1], [f"{x:.12g}" for x in y])
    rows = (",".join(row) for row in zip_longest(*columns, fillvalue=""))
    (tmp_path / "a.csv").write_text("\n".join(["t_u,u,t_y,y", *rows]) + "\n")
    check(read_signals(tmp_path / "a.csv"), (t_u, u, t_y, y), RATES["slow input"][1])


@pytest.mark.parametrize("suffix", [".csv", ".json", ".npz"])
def test_newest_first_keeps_the_columns_of_other_lengths(suffix, tmp_path):
    each = recorded(*RATES["slow input"])
    path = write(tmp_path / f"a{suffix}", tuple(x[::-1] for x in each))
    check(read_signals(path), each, RATES["slow input"][1])


def test_two_clocks_of_whole_rows_stay_so(tmp_path):
    """A second clock that shows the same time, in another unit or since another day, belongs to no signal."""
    t_u, u, t_y, y = recorded(TS, 0.0)
    for head, second in (("t_ms,u,time_s,y", t_y), ("time,u,stamp,y", t_y + 1.7e9), ("time_s,u,elapsed_s,y", t_y + 5)):
        first = 1e3 * t_u if head.startswith("t_ms") else t_u
        record = read_signals(write(tmp_path / "a.csv", (first, u, second, y), head))
        np.testing.assert_allclose(record.input[0].values, u, rtol=1e-11)
        assert not any("clocks of their own" in note for note in record.notes)


@pytest.mark.parametrize(("stamp", "said"), [("1e18", "time must increase"), ("nan", "row 42, column 't_y': found no")])
def test_a_value_without_a_time_of_its_own_is_refused_where_it_stands(stamp, said, tmp_path):
    """A time so large that a step adds nothing to it is no division by zero."""
    t_u, u, t_y, y = recorded(*RATES["fast input"])
    texts = [[f"{x:.9g}" for x in column] for column in (t_u, u, t_y, y)]
    texts[2][40] = stamp
    rows = (",".join(row) for row in zip_longest(*texts, fillvalue=""))
    (tmp_path / "a.csv").write_text("\n".join(["t_u,u,t_y,y", *rows]) + "\n")
    with np.errstate(all="raise"), pytest.raises(sysid.InputError, match=re.escape(said)):
        read_signals(tmp_path / "a.csv")


@pytest.mark.parametrize("cell", ["abc", "", "nan"])
def test_a_value_of_the_input_without_a_time_is_refused_where_it_stands(cell, tmp_path):
    """Else the value before would be held in its place, and nothing would say so."""
    path = write(tmp_path / "a.csv", recorded(0.02, 0.0031))
    lines = path.read_text().splitlines()
    lines[41] = cell + lines[41][lines[41].index(",") :]
    path.write_text("\n".join(lines) + "\n")
    with pytest.raises(InputError, match="row 42, column 't_u': found"):
        read_record(path)
