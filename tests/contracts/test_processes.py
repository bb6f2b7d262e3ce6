"""Logs of processes: a heater and a temperature beside a clock, in the units that such logs have."""

from pathlib import Path

import numpy as np
import pytest

from sysid import InputError
from sysid.channels.conversion import convert
from sysid.formats import unit_in
from sysid.workflow.record import read_record

U, Y = np.random.default_rng(4).normal(size=(2, 60)).round(3)


def log(path: Path, header: str) -> Path:
    rows = (f"{0.1 * k:.1f},{a},{b},{k % 4}\n" for k, (a, b) in enumerate(zip(U, Y, strict=True)))
    width = header.count(",") + 1
    path.write_text(f"{header}\n" + "".join(",".join(row.strip().split(",")[:width]) + "\n" for row in rows))
    return path


@pytest.mark.parametrize(
    ("header", "unit"),
    [
        ("time [s],heater [V],temperature [degC]", "degC"),
        ("time [s],heater [V],temperature [°C]", "°C"),
        ("time [s],input,temp [K]", "K"),
        ("time [s],command,pressure [bar]", "bar"),
        ("time [s],u,flow (l/min)", "l/min"),
    ],
)
def test_the_only_other_column_is_the_output_in_its_unit(tmp_path: Path, header: str, unit: str):
    record = read_record(log(tmp_path / "a.csv", header))
    np.testing.assert_array_equal(record.data.u[:, 0], U)
    np.testing.assert_array_equal(record.data.y[:, 0], Y)
    assert record.data.y_unit == unit
    assert any("is the output: it is the only other one" in note for note in record.notes)
    assert not any("known unit" in note or "unknown unit" in note for note in record.notes)


@pytest.mark.parametrize(
    "header", ["time [s],heater [V],temperature [degC],flow (l/min)", "time [s],voltage,supply [V]", "time [s],u,error"]
)
def test_what_may_be_something_else_is_asked_for(tmp_path: Path, header: str):
    with pytest.raises(InputError, match="--output"):
        read_record(log(tmp_path / "a.csv", header))


def test_a_letter_for_left_is_no_litre():
    assert unit_in("angle (L)") == ""
    assert not convert("L").known
    assert convert("%").factor == 0.01
