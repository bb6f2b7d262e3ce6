"""Logs of processes: a heater and a temperature beside a clock, in the units that such logs have."""

import json
from pathlib import Path

import numpy as np
import pytest
from scipy.signal import lfilter

import sysid
from sysid import InputError
from sysid.base.quantities import display_quantity
from sysid.channels.conversion import convert
from sysid.estimation.origin import Origin
from sysid.formats import unit_in
from sysid.joint.values import displayed_value
from sysid.plots.responses import step_figure
from sysid.report.figures import TABLE
from sysid.report.identify_answer import values
from sysid.report.verdict import too_narrow
from sysid.structures import ProcessModel, process
from sysid.uncertainty import bands
from sysid.uncertainty.intervals import Band
from sysid.workflow.evaluation import evaluate
from sysid.workflow.identification import identify_file
from sysid.workflow.record import read_record
from sysid.workflow.setting import Setting
from twin.cli import main

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


@pytest.mark.parametrize(
    ("unit", "shown", "factor"),
    [("share", "%", 100.0), ("degC/share", "degC/%", 0.01), ("share/V/s", "%/V/s", 100.0), ("share/share", "%/%", 1.0)],
)
def test_a_share_is_shown_in_per_cent_and_what_counts_by_it_too(unit: str, shown: str, factor: float):
    q = display_quantity("", unit)
    assert (q.unit, q.factor) == (shown, pytest.approx(factor))


def test_gains_of_a_log_in_per_cent_are_those_of_its_columns(tmp_path: Path, monkeypatch, capsys):
    """0.6 degC for each per cent of a heater, which moves between 20 and 80 %; SI inside."""
    monkeypatch.chdir(tmp_path)
    rng = np.random.default_rng(1)
    u = 50.0 + 30.0 * np.repeat(rng.uniform(-1.0, 1.0, 24), 25)
    y = 20.0 + lfilter([0.0, 0.6 * (1.0 - np.exp(-1 / 8))], [1.0, -np.exp(-1 / 8)], u) + 0.05 * rng.normal(size=600)
    rows = np.column_stack([np.arange(600.0), u, y])
    np.savetxt("oven.csv", rows, "%.6g", ",", header="time [s],heater [%],temperature [degC]", comments="")
    found = read_record("oven.csv")
    assert (found.data.u_unit, found.data.u.max()) == ("share", pytest.approx(u.max() / 100.0, rel=1e-5))
    for structure in (["process"], ["output_error", "--orders", "1,1,1"]):
        assert main(["identify", "oven.csv", "--structure", *structure, "--starts", "1", "--out", "out"]) == 0
        said = capsys.readouterr().out
        (row,) = [line.split() for line in said.splitlines() if line.strip().startswith("gain")][:1]
        numbers = [float(word) for word in row if word.replace(".", "").isdigit() and "." in word]
        value, low, high = numbers[:3]
        assert value == pytest.approx(0.6, abs=0.005)
        assert low < (0.6 if structure == ["process"] else value) < high
        assert "degC/%" in said.replace(" per ", "/")
        assert "heater [%]" in Path("out/report.html").read_text(encoding="utf-8")
    assert json.loads(Path("out/model.json").read_text())["origin"]["u_unit"] == "share"
    assert main(["run", "out/model.json", "oven.csv", "--out", "again"]) == 0
    assert " % of the input's samples lie outside" not in capsys.readouterr().out


def test_a_step_is_drawn_for_one_per_cent():
    x, response = np.array([0.0, 1.0]), np.array([0.0, 60.0])  # degC for each 1
    panel = step_figure(Band.bare(x, response), "degC", "share", "temperature").panels[0]
    assert panel.y.unit == "degC/%"
    np.testing.assert_allclose(panel.items[0].y, [0.0, 0.6])


def test_a_model_saved_before_shares_had_a_name_takes_their_records():
    record = type("R", (), {"u_unit": "share", "y_unit": "degC"})
    assert Origin("heater", "temperature", "1", "degC", 600, 99.0).other_unit(record) is None
    assert Origin("heater", "temperature", "V", "degC", 600, 99.0).other_unit(record) is not None


def test_a_run_from_rest_waits_for_its_delay_where_the_input_begins_at_once():
    """By the closed form, and by the exported Python; the record of the fit begins at rest."""
    rng, Ts = np.random.default_rng(0), 1.0
    u = np.repeat(rng.uniform(-1.0, 1.0, 40), 10)
    u[:20] = 0.0
    a = np.exp(-Ts / 9.0)
    y = np.concatenate([np.zeros(6), lfilter([2.0 * (1.0 - a)], [1.0, -a], u)])[: len(u)]
    data = sysid.IOData(u, y + 0.01 * rng.standard_normal(len(u)), Ts)
    fit = sysid.fit(process("P1D"), data, starts=1)
    value = {p.name.rpartition(".")[2]: p.value for p in fit.parameters}
    t = Ts * np.arange(30)
    expected = value["y0"] + value["K"] * -np.expm1(-np.maximum(t - value["Td"], 0.0) / value["T1"])
    assert value["Td"] == pytest.approx(5.0, abs=0.1)
    np.testing.assert_allclose(fit.simulate(np.ones(30)), expected, atol=1e-12)
    info, moves = sysid.information(fit, data), t > value["Td"]
    for band in (bands.linear(info, np.ones(30)), bands.monte_carlo(info, np.ones(30), draws=50)):
        np.testing.assert_allclose(band.y, expected, atol=1e-12)
        assert np.ptp(band.std[~moves]) < 1e-12  # of the offset alone
    module: dict = {}
    exec(sysid.export.python.source(fit), module)
    np.testing.assert_allclose(module["simulate"]([1.0] * 30), expected, atol=1e-12)


@pytest.mark.parametrize(("noise", "narrow"), [(1.0, False), (8.0, True)])
def test_an_output_that_becomes_smaller_is_no_model_that_becomes_worse(noise: float, narrow: bool):
    """A chirp through a lag, with the same noise in both halves, and with more in the second."""
    N, Ts = 4000, 0.01
    t = Ts * np.arange(N)
    u, a = np.cos(2.0 * np.pi * (0.1 + 0.1 * t) * t), np.exp(-Ts / 0.5)
    e = 0.01 * np.random.default_rng(1).standard_normal(N) * np.where(np.arange(N) < N // 2, 1.0, noise)
    data = sysid.IOData(u, lfilter([0.0, 2.0 * (1.0 - a)], [1.0, -a], u) + e, Ts)
    evaluation = evaluate(Setting(ProcessModel("P1"), starts=1), data.select(0, N // 2), data.select(N // 2, N))
    assert evaluation.estimation_fit > evaluation.validation_fit + 3.0
    assert bool(too_narrow(evaluation)) == narrow


def test_a_gain_has_one_unit_wherever_it_is_shown(tmp_path):
    """In the table of values, in the first screen, on the axis of the step response and in its caption."""
    rng, Ts = np.random.default_rng(5), 0.5
    u = np.repeat(rng.uniform(20.0, 80.0, 20), 40)
    y = 20.0 + lfilter([0.0, 0.0, 2.0 * (1.0 - np.exp(-Ts / 8.0))], [1.0, -np.exp(-Ts / 8.0)], u)
    table = np.column_stack([Ts * np.arange(len(u)), u, y + 0.1 * rng.normal(size=len(u))])
    np.savetxt(tmp_path / "oven.csv", table, delimiter=",", header="time [s],power [%],temperature [degC]", comments="")
    setting = Setting(ProcessModel("P1D"), starts=1)
    result = identify_file(tmp_path / "oven.csv", setting, "power [%]", "temperature [degC]")
    e = result.evaluation
    (gain,) = (displayed_value(v) for v in e.values if v.name == "gain")
    step, caption = TABLE["step-response"].figure(e), TABLE["step-response"].caption(e)
    assert gain.unit == step.panels[0].y.unit == "degC/%"
    assert gain.value == pytest.approx(2.0, rel=0.01)
    assert caption.endswith("degC/%.")
    assert any("degC/%" in row for row in values(e).rows)
