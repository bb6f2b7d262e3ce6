"""A column may be named without the unit in its header, where that names one."""

from pathlib import Path

import numpy as np
import pytest

from sysid import InputError
from sysid.workflow.record import read_record

U, Y = np.random.default_rng(3).normal(size=(2, 60)).round(3)


def log(path: Path, header: str) -> Path:
    rows = (f"{0.1 * k:.1f},{a},{b},{2 * b}\n" for k, (a, b) in enumerate(zip(U, Y, strict=True)))
    path.write_text(f"{header}\n{''.join(rows)}")
    return path


def test_names_are_taken_without_their_units(tmp_path: Path):
    path = log(tmp_path / "a.csv", "elapsed [s],heat (V),temperature [degC],level_mm")
    whole = read_record(path, input="heat (V)", output="temperature [degC]", time="elapsed [s]")
    record = read_record(path, input="heat", output="temperature", time="elapsed")
    np.testing.assert_array_equal(record.data.y, whole.data.y)
    np.testing.assert_array_equal(record.data.u[:, 0], U)
    assert record.data.y_unit == whole.data.y_unit
    mapping = tmp_path / "map.toml"
    entries = ('[clock]\ncolumn = "elapsed"', '[[input]]\ncolumn = "heat"', '[[output]]\ncolumn = "temperature"')
    mapping.write_text("\n".join(entries) + "\n")
    np.testing.assert_array_equal(read_record(path, mapping=mapping).data.y, whole.data.y)


def test_a_name_of_two_columns_is_refused(tmp_path: Path):
    path = log(tmp_path / "a.csv", "time [s],heat [V],temperature [degC],temperature [K]")
    with pytest.raises(InputError, match=r"unknown column 'temperature'.*temperature \[degC\]"):
        read_record(path, input="heat", output="temperature")
