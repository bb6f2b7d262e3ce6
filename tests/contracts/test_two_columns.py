"""Two columns are an input and an output: time beside an output is no record, and the order of unnamed ones counts."""

import numpy as np
import pytest

from sysid.base.errors import InputError
from sysid.workflow.record import read_record

N = 300
RNG = np.random.default_rng(4)
U = np.repeat(RNG.choice([-3.0, 3.0], N // 10), 10)
Y = np.cumsum(U) * 0.01 + 0.01 * RNG.normal(size=N)
EVEN = 0.02 * np.arange(N)
TIMES = {
    "even": EVEN,
    "uneven": np.cumsum(np.where(RNG.random(N) < 0.5, 0.01, 0.03)),
    "rounded": np.round(EVEN + 0.004 * RNG.random(N), 3),
    "samples": np.arange(N) + 1.0,
}


def write(path, header, *columns):
    rows = [",".join(f"{value:.6g}" for value in row) for row in zip(*columns, strict=True)]
    path.write_text("\n".join([*([header] if header else []), *rows]) + "\n")
    return path


@pytest.mark.parametrize("time", TIMES)
@pytest.mark.parametrize("header", ["", "time,angle", "sample,angle", "x,angle", "angle,time"])
def test_time_beside_an_output_is_no_record(header, time, tmp_path):
    columns = (Y, TIMES[time]) if header == "angle,time" else (TIMES[time], Y)
    path = write(tmp_path / "a.csv", header, *columns)
    with pytest.raises(InputError):
        read_record(path)
    with pytest.raises(InputError, match="no column is left"):
        read_record(path, Ts=0.02)


@pytest.mark.parametrize("time", TIMES)
def test_a_ramp_that_is_named_is_an_input(time, tmp_path):
    """The way out that the sentence names."""
    path = write(tmp_path / "a.csv", "", TIMES[time], Y)
    with pytest.raises(InputError, match="if 1 is no time, name it with --input or --output"):
        read_record(path, Ts=0.02)
    record = read_record(path, Ts=0.02, input="1", output="2")
    np.testing.assert_allclose(record.data.u[:, 0], TIMES[time], rtol=1e-5, atol=1e-6)


def test_an_input_that_stands_second_is_questioned(tmp_path):
    path = write(tmp_path / "a.csv", "", Y, U)
    with pytest.raises(InputError, match="--input 2 --output 1"):
        read_record(path, Ts=0.02)
    np.testing.assert_allclose(read_record(path, Ts=0.02, input="2", output="1").data.u[:, 0], U)
    right = read_record(write(tmp_path / "b.csv", "", U, Y), Ts=0.02)
    np.testing.assert_allclose(right.data.u[:, 0], U)


def test_one_column_that_is_named_leaves_the_other_to_its_name(tmp_path):
    path = write(tmp_path / "a.csv", "time_s,voltage_V,speed,position", EVEN, U, np.gradient(Y), Y)
    record = read_record(path, output="speed")
    np.testing.assert_allclose(record.data.u[:, 0], U)
    assert any("'voltage_V' is the input: its name says so" in note for note in record.notes)
    with pytest.raises(InputError, match="name one with --output"):
        read_record(write(tmp_path / "b.csv", "time_s,a,b,c", EVEN, U, np.gradient(Y), Y), input="a")
