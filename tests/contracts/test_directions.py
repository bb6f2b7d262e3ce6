"""A duty without its sign beside a column that says which way the bridge drives."""

import numpy as np
import pytest

from sysid.base.errors import InputError
from sysid.workflow.record import read_record
from twin.cli import main

U = np.repeat(np.random.default_rng(1).uniform(-1, 1, 20), 10)
Y = np.convolve(U, 0.3 * 0.7 ** np.arange(60))[: len(U)]


def write(path, back, forth):
    rows = [
        f"{20 * k},{abs(u):.5f},{forth if u > 0 else back},{y:.7g}" for k, (u, y) in enumerate(zip(U, Y, strict=True))
    ]
    path.write_text("\n".join(["t_ms,duty,dir,speed", *rows, ""]))
    return path


@pytest.mark.parametrize("ways", [("0", "1"), ("-1", "1"), ("False", "True")])
def test_the_direction_is_told_and_its_entry_restores_the_sign(ways, tmp_path):
    path, mapping = write(tmp_path / "a.csv", *ways), tmp_path / "m.toml"
    record = read_record(path)
    assert (record.data.u_name, record.data.y_name) == ("duty", "speed")
    assert any('set direction = "dir" in [[input]]' in note for note in record.notes)
    main(["info", str(path), "--write-map", str(mapping)])
    text = mapping.read_text()
    mapping.write_text(
        text.replace("[[input]]\n", '[[input]]\ndirection = "dir"\n', 1).replace('direction = "" ', "# ")
    )
    record = read_record(path, mapping=mapping)
    np.testing.assert_allclose(record.data.u[:, 0], U, atol=1e-5)
    assert not any("may say which way" in note for note in record.notes)


def test_a_duty_with_its_sign_needs_no_direction(tmp_path):
    path = write(tmp_path / "a.csv", 0, 1)
    path.write_text(path.read_text().replace(",0.", ",-0.", 30))
    assert not any("which way" in note for note in read_record(path).notes)


def test_the_column_itself_is_no_direction(tmp_path):
    path = write(tmp_path / "a.csv", 0, 1)
    (tmp_path / "m.toml").write_text(
        '[clock]\ncolumn = "t_ms"\nunit = "ms"\n[[input]]\ncolumn = "duty"\ndirection = "duty"\n'
        '[[output]]\ncolumn = "speed"\n'
    )
    with pytest.raises(InputError, match="direction is 'duty', the column itself"):
        read_record(path, mapping=tmp_path / "m.toml")
