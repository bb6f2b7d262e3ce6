"""A file's own unit is what people read; inside, all is SI."""

import copy
import pickle
from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import lfilter

import sysid
from sysid import IOData
from sysid.base.quantities import Quantity, Unit, display_quantity, of_place, unit_of_channel
from sysid.channels.conversion import unit_of_file
from sysid.data.trends import Trend
from sysid.joint.values import displayed_value, joint_values
from sysid.plots.records import channels
from sysid.report.identify_answer import run_figure, values
from sysid.solver.iterate import Options
from sysid.structures import OutputError, ProcessModel
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
    assert labels == {"place [cm]", "error [cm]"}
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


@pytest.mark.parametrize(
    ("u", "y", "unit"),
    [("pump [l/min]", "level [mm]", "mm/(l/min)"), ("coil [mV]", "place [cm]", "cm/mV"), ("v [%]", "w [rpm]", "rpm/%")],
)
def test_the_gain_of_a_process_is_in_the_units_of_the_file(tmp_path, u: str, y: str, unit: str):
    result = identify_file(log(tmp_path / "a.csv", f"t [s],{u},{y}"), Setting(ProcessModel("P1"), starts=1), u, y)
    row = values(result.evaluation).rows[0]
    assert (row[0], row[-1]) == ("gain", unit)
    assert float(row[1]) == pytest.approx(2.0, rel=0.01)


def test_the_rate_of_an_integrator_is_in_the_units_of_the_file(tmp_path):
    """It rises by 3 mm each second for each mV."""
    path, u = tmp_path / "a.csv", np.repeat(np.random.default_rng(3).choice([-1.0, 1.0], 40), 10)
    table = np.column_stack([np.arange(400.0), u, np.cumsum(np.concatenate([[0.0], 3.0 * u[:-1]]))])
    np.savetxt(path, table, delimiter=",", header="t [s],coil [mV],place [mm]", comments="", fmt="%.6f")
    result = identify_file(path, Setting(ProcessModel("P0I"), starts=1), "coil [mV]", "place [mm]")
    row = values(result.evaluation).rows[0]
    assert (row[0], row[-1]) == ("gain", "mm/mV/s")
    assert float(row[1]) == pytest.approx(3.0, rel=0.01)


def test_the_values_of_a_joint_are_in_the_unit_of_the_file():
    """The same record whose places are read in mm has the same speed and the same end, times a thousand."""
    rng = np.random.default_rng(4)
    u = np.repeat(rng.uniform(-6.0, 6.0, 30), 10)
    y = np.clip(np.cumsum(0.02 * u), -1.0, 1.0) + 0.01 * rng.normal(size=300)
    data = IOData(u, y, 0.1, u_unit="V", y_unit="m")
    fit = sysid.fit(sysid.structures.actuated_joint(knots=4), data, starts=1, options=Options(max_iterations=2))
    in_m, in_mm = (joint_values(fit, data=replace(data, y_unit=unit)) for unit in ("m", Unit("m", "mm", 1e3)))
    pairs = {a.name: (displayed_value(a), displayed_value(b)) for a, b in zip(in_m, in_mm, strict=True)}
    assert pairs["speed_per_volt"][1].unit == "mm/s/V"
    for name in ("speed_per_volt", "end_low", "end_high", "backlash"):
        si, shown = pairs[name]
        assert (si.unit, shown.unit) == (si.unit, si.unit.replace("m", "mm"))
        assert shown.value == pytest.approx(1e3 * si.value)


def test_the_place_of_a_speed_is_read_in_the_unit_of_the_file():
    assert display_quantity("", of_place(Unit("m/s", "mm/s", 1e3))) == Quantity("", "mm", 1e3)
    assert of_place(Unit("rad/s", "rpm", 60.0 / 2.0 / np.pi)) == "rad"
    assert display_quantity("", of_place(Unit("rad/s", "rpm", 9.5))).unit == "deg"
    assert display_quantity("", of_place(Unit("m", "mm", 1e3))).unit == "mm"


def test_a_level_that_was_removed_is_told_in_the_unit_of_the_file(tmp_path):
    data = read_record(log(tmp_path / "a.csv", "t [s],coil [mV],place [mm]"), "coil [mV]", "place [mm]").data
    said = Trend.of(data, "mean").sentence
    assert said == f"means removed: {1e3 * data.y.mean():.4g} mm of the output"


def test_each_of_several_channels_is_in_its_own_unit(tmp_path):
    """Two outputs whose units differ: notes, findings, tables and axes name that of each."""
    rng = np.random.default_rng(5)
    u = np.repeat(rng.uniform(-1.0, 1.0, (60, 2)), 10, axis=0) * np.linspace(0.5, 1.0, 600)[:, None]
    lags = [lfilter([0.0, 0.2], [1.0, -0.8], u @ gains) for gains in (np.array([3.0, 1.0]), np.array([-20.0, 50.0]))]
    table = np.column_stack([np.arange(600), 1e3 * u[:, 0], u[:, 1], lags[0], np.round(lags[1] / 4) * 4])
    header = "t [s],coil [mV],pump [V],place [mm],flow [rpm]"
    np.savetxt(tmp_path / "a.csv", table, delimiter=",", header=header, comments="", fmt="%.6f")
    setting = Setting(OutputError(1, 1, 1), starts=1)
    result = identify_file(tmp_path / "a.csv", setting, "coil [mV],pump [V]", "place [mm],flow [rpm]", detrend="mean")
    low, high = 1e3 * u[:300, 0].min(), 1e3 * u[:300, 0].max()
    assert any(note.startswith(f"coil was seen from {low:.4g} to {high:.4g} mV") for note in result.evaluation.notes)
    assert any("moves in steps of 4 rpm" in a.sentence for a in result.advice)
    assert [c.quantity.unit for c in channels(result.record.data)] == ["mV", "V", "mm", "rpm"]
    assert [row[-1] for row in values(result.evaluation).rows] == ["mm", "rpm"]
    assert Trend.of(result.record.data, "mean").sentence.endswith("rpm of the output")
    data = result.record.data
    for each in (data, pickle.loads(pickle.dumps(data)), IOData.merge(data, data), data.select(0, 50)):
        assert (each.y_unit, unit_of_channel(each.y_unit, 1), each.y_unit.each[0].shown) == ("", "rad/s", "mm")
