"""Logs that can be read in two ways: what an examiner found, each with the one right answer or the right sentence."""

import json
import zipfile

import numpy as np
import pytest

import sysid
from sysid import InputError
from sysid.workflow.record import read_record

K = np.arange(60)
U, Y = K % 7, (K * K) % 11


def table(head, *columns):
    rows = [",".join(f"{cell}" for cell in row) for row in zip(*columns, strict=True)]
    return "\n".join([head, *rows]) + "\n"


@pytest.fixture
def path(tmp_path):
    return tmp_path / "rig.csv"


PAIRS = ["controller_output,process_value", "actuator_output,sensor_input", "drive_out,sensor_in", "pid_output,angle"]


@pytest.mark.parametrize("head", PAIRS)
@pytest.mark.parametrize("clock", [True, False])
def test_the_output_of_a_controller_may_be_the_input_of_its_plant(head, clock, path):
    path.write_text(table(f"t,{head}", K / 100, U, Y) if clock else table(head, U, Y))
    with pytest.raises(InputError, match=f"{head.split(',')[0]}' fits an input and an output; name the columns"):
        sysid.read(path, Ts=0.1)
    one, two = head.split(",")
    assert sysid.read(path, one, two, Ts=0.1).u[:, 0].tolist() == U.tolist()


def test_heat_flow_is_no_joint_angle(path):
    path.write_text(table("time_s,Q1,T1", K / 100, U, Y))
    with pytest.raises(InputError, match="name one with input= and one with output="):
        sysid.read(path)
    path.write_text(table("time_s,u,q1", K / 100, U, Y))
    assert sysid.read(path).y[:, 0].tolist() == Y.tolist()


def test_ticks_of_100_ns_are_not_microseconds(path):
    path.write_text(table("time,u,y", 133485408000000000 + K * 100000, U, Y))
    with pytest.raises(InputError, match=r"as a clock of 100 ns has .*give the sampling time with Ts="):
        sysid.read(path)
    path.write_text(table("time,u,y", 1700000000000000 + K * 10000, U, Y))
    assert sysid.read(path).Ts == pytest.approx(0.01)


def test_stamps_of_32_bits_are_a_uniform_clock(path):
    stamps = np.float32(3600 + 0.005 * np.arange(1200))
    u = np.arange(1200) // 10 % 7
    path.write_text(table("t,u,y", map(float, stamps), u, u**2))
    data = sysid.read(path)
    assert pytest.approx(0.005, rel=1e-3) == data.Ts
    np.testing.assert_array_equal(data.u[:, 0], u)  # no held input moves by a sample


@pytest.mark.parametrize("unit", ["DEG", "Deg", "deg"])
def test_degrees_are_degrees_in_letters_of_any_size(unit, path):
    path.write_text(table(f"t,u,angle [{unit}]", K / 100, U, Y))
    np.testing.assert_allclose(sysid.read(path).y[:, 0], np.deg2rad(Y))


@pytest.mark.parametrize("name", ["angle_x10_deg", "angle_deci_deg", "angle_100x_deg"])
def test_tenths_of_a_unit_are_not_the_unit(name, path):
    path.write_text(table(f"t,u,{name}", K / 100, U, Y))
    np.testing.assert_array_equal(sysid.read(path).y[:, 0], Y)


def test_a_clock_whose_last_digits_are_gone_after_1000_s_is_refused(path):
    stamps = 100 - 4 + 0.05 * np.arange(40_000) / 10  # the step is 5 ms; five digits show it below 100 s
    few = slice(0, 900)
    path.write_text(table("time_s,u,y", [f"{t:.5g}" for t in stamps[few]], *(np.arange(900) % n for n in (7, 11))))
    with pytest.raises(InputError, match=r"the clock is too coarse for its samples: give the sampling time with Ts="):
        sysid.read(path)


def test_a_row_that_was_written_twice_is_still_dropped(path):
    rows = np.repeat(K, np.where(np.isin(K, (20, 40)), 2, 1))
    path.write_text(table("time_s,u,y", rows / 100, U[rows], Y[rows]))
    assert len(K) == sysid.read(path).N


def test_a_number_of_5000_digits_is_told_without_advice_for_programmers(path):
    source = path.with_suffix(".json")
    source.write_text('[{"t": 0, "u": ' + "1" * 5000 + ', "y": 1}]')
    with pytest.raises(InputError, match="a whole number of more than 4300 digits"):
        sysid.read(source)


def test_a_unit_that_nobody_knows_is_said(path):
    path.write_text(table("t,u,angle [grad]", K / 100, U, Y))
    assert any("names 'grad', which is no known unit" in note for note in read_record(path).notes)


@pytest.mark.parametrize("beside", [{"Ts_unit": "ms"}, {"unit": "Hz"}, {"time_unit": "us"}])
def test_a_sampling_time_of_another_unit_is_refused(beside, path):
    source = path.with_suffix(".json")
    source.write_text(json.dumps({"Ts": 10, **beside, "u": U.tolist(), "y": Y.tolist()}))
    with pytest.raises(InputError, match=r"Ts is 10 and \w+ '\w+'; give the sampling time in seconds with Ts="):
        sysid.read(source)


def test_a_stated_sampling_time_is_said_of_a_file_with_two_columns(path):
    source = path.with_suffix(".json")
    source.write_text(json.dumps({"Ts": 10, "u": U.tolist(), "y": Y.tolist()}))
    assert "the sampling time is 10 s: the file says so" in read_record(source).notes


@pytest.mark.parametrize("cell", [[1], {"x": 1}])
def test_a_list_among_numbers_is_not_a_missing_number(cell, path):
    source = path.with_suffix(".json")
    samples = [{"t": k / 10, "u": int(u), "y": int(y)} for k, u, y in zip(K, U, Y, strict=True)]
    samples[5]["u"] = cell
    source.write_text(json.dumps(samples))
    with pytest.raises(InputError, match="entry 6: found a list or an object for 'u', which is a number elsewhere"):
        sysid.read(source)
    for sample, u in zip(samples, U, strict=True):
        sample["u"] = [int(u)] if isinstance(cell, list) else {"x": int(u)}
    source.write_text(json.dumps(samples))
    assert len(K) == sysid.read(source, "u[0]" if isinstance(cell, list) else "u.x", "y").N


def test_of_two_arrays_of_one_name_none_is_taken(path):
    source = path.with_suffix(".npz")
    np.savez(source, u=U, y=Y)
    with zipfile.ZipFile(source, "a") as file, pytest.warns(UserWarning, match="Duplicate"):
        file.writestr("u.npy", file.read("y.npy"))
    with pytest.raises(InputError, match="two of its arrays are called 'u'; save it again"):
        sysid.read(source, Ts=0.1)


CODES = ["9.9E+37", "-9.9E37", "9.91E37", "3.4028235E+38", "-3.40282E38", "1e20", "-1E30", "9.96921e36"]


@pytest.mark.parametrize("code", CODES)
@pytest.mark.parametrize("missing", ["mark", "refuse"])
def test_the_code_of_an_instrument_for_an_overflow_is_no_measurement(code, missing, path):
    cells = [code if k in (20, 41) else "" if k == 50 and missing == "mark" else y for k, y in enumerate(Y)]
    path.write_text(table("time_s,u,y", K / 100, U, cells))
    with pytest.raises(InputError, match=r"row 22, column 'y': found .*\(and 1 more like it\).*overflow.*empty"):
        sysid.read(path, missing=missing)
    path.write_text(table("time_s,u,y", K / 100, U, ["" if k in (20, 41) else y for k, y in enumerate(Y)]))
    data = sysid.read(path)  # what the sentence advises
    assert np.flatnonzero(data.missing[:, 0]).tolist() == [20, 41]
    assert data.y[data.observed[:, 0], 0].tolist() == np.delete(Y, [20, 41]).tolist()


def test_an_output_that_overflows_at_zero_is_refused_too(path):
    path.write_text(table("time_s,u,y", K / 100, U, np.where(K < 50, 0.0, 9.9e37)))
    with pytest.raises(InputError, match=r"row 52, .*9 more like it"):
        sysid.read(path)


@pytest.mark.parametrize("scale", [1e15, 1e20, 9.9e37, 1e60])
def test_a_record_in_an_odd_unit_holds_no_codes(scale, path):
    path.write_text(table("time_s,u,y", K / 100, U * scale, np.round(np.sin(K), 3) * scale))
    data = sysid.read(path)
    np.testing.assert_allclose(data.u[:, 0], U * scale, rtol=1e-12)
    np.testing.assert_allclose(data.y[:, 0], np.round(np.sin(K), 3) * scale, rtol=1e-12)
