"""A file's own unit is what people read; inside, all is SI."""

import copy
import pickle

import numpy as np
import pytest
from scipy.signal import lfilter

from sysid.base.quantities import display_quantity
from sysid.channels.conversion import unit_of_file
from sysid.plots.records import channels
from sysid.report.identify_answer import run_figure, values
from sysid.structures import OutputError
from sysid.workflow.identification import identify_file
from sysid.workflow.record import read_record
from sysid.workflow.setting import Setting
from twin.cli import main

ORDERS = ["--structure", "output_error", "--orders", "1,1,1", "--starts", "1", "--trials", "0"]


def log(path, header: str):
    """A lag with a gain of 2 in the units of the file, and a noise of 0.5 in them."""
    rng, a = np.random.default_rng(11), np.exp(-1.0 / 8.0)
    u = np.repeat(rng.uniform(-100.0, 100.0, 40), 20)
    y = lfilter([0.0, 2.0 * (1.0 - a)], [1.0, -a], u) + 0.5 * rng.normal(size=len(u))
    table = np.column_stack([np.arange(len(u)), u, y])
    np.savetxt(path, table, delimiter=",", header=header, comments="", fmt="%.6f")
    return path


@pytest.mark.parametrize(
    ("u", "y", "shown", "error"),
    [
        ("coil [mV]", "place [cm]", "cm/mV", "cm"),
        ("coil [V]", "place [mm]", "mm/V", "mm"),
        ("coil [V]", "current [mA]", "mA/V", "mA"),
        ("coil [V]", "speed [rad/s]", "rad/s/V", "rad/s"),
        ("coil [V]", "speed [rpm]", "rpm/V", "rpm"),
        ("coil [V]", "angle [rad]", "deg/V", "deg"),
    ],
)
def test_gain_and_error_are_in_the_units_of_the_file(tmp_path, u: str, y: str, shown: str, error: str):
    path = log(tmp_path / "a.csv", f"t [s],{u},{y}")
    result = identify_file(path, Setting(OutputError(1, 1, 1), starts=1), u, y)
    gain, *_, left = values(result.evaluation).rows
    scale = 180.0 / np.pi if error == "deg" else 1.0
    assert (gain[3], left[3]) == (shown, error)
    assert float(gain[1]) == pytest.approx(2.0 * scale, rel=0.01)
    assert float(left[1]) == pytest.approx(0.5 * scale, rel=0.1)


def test_the_record_stays_si_and_a_copy_keeps_what_is_shown(tmp_path):
    data = read_record(log(tmp_path / "a.csv", "t [s],coil [mV],place [mm]"), "coil [mV]", "place [mm]").data
    assert (data.u_unit, data.y_unit) == ("V", "m")
    assert np.abs(data.u).max() <= 0.1
    for unit in (data.y_unit, pickle.loads(pickle.dumps(data.y_unit)), copy.deepcopy(data.y_unit)):
        q = display_quantity("place", unit)
        assert (q.unit, q.factor) == ("mm", pytest.approx(1000.0))


def test_a_figure_is_in_the_units_of_the_table_beside_it(tmp_path):
    result = identify_file(
        log(tmp_path / "a.csv", "t [s],coil [mV],place [cm]"), Setting(OutputError(1, 1, 1), starts=1)
    )
    labels = {panel.y.label for panel in run_figure(result.evaluation).panels}
    assert labels == {"place [cm]"}
    y = channels(result.record.data)[1].of(result.record.data)
    assert np.ptp(y) == pytest.approx(100.0 * np.ptp(result.record.data.y))


def test_what_is_read_as_it_is_has_no_other_unit():
    assert all(
        type(unit_of_file(text)) is str for text in ("V", "m", "%", "degC", "deg", "deg/s", "rad", "furlong", "")
    )


def test_a_saved_model_and_info_show_the_unit_too(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    log(tmp_path / "a.csv", "t [s],coil [mV],place [mm]")
    given = ["--input", "coil [mV]", "--output", "place [mm]"]
    assert main(["identify", "a.csv", *given, *ORDERS, "--out", "m"]) == 0
    said = capsys.readouterr().out
    assert "column 'place [mm]' goes from mm to m and is shown in mm: its header names mm" in said
    assert main(["run", "m/model.json", "a.csv", *given, "--out", "again"]) == 0
    (row,) = [line.split() for line in capsys.readouterr().out.splitlines() if line.split()[:1] == ["place"]]
    assert row[-1] == "mm"
    assert float(row[-2]) == pytest.approx(0.5, rel=0.1)
