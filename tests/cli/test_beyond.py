"""The actuated joint on the twin: identified from a file, beside the paper's structure, and with parts left out."""

import io
import json
import re
import runpy
from contextlib import redirect_stdout

import numpy as np
import pytest
from exported import agrees

import sysid
import twin
from sysid.export import c as export_c
from sysid.structures import ActuatedJoint
from sysid.workflow.setting import Setting
from twin import IMPERFECTIONS
from twin.cli import main
from twin.report import actuated_joint as report
from twin.studies import ablation, beyond, protocol

# What an actuated joint can say exactly: a motor with dry friction between two stops, read with noise.
EXACT = tuple(name for name in IMPERFECTIONS if name not in ("friction", "asymmetry", "end_stops", "delay", "noise"))


@pytest.fixture(scope="module")
def plain_log(tmp_path_factory):
    """A log of the shoulder without what the structure leaves out, as a file."""
    path = tmp_path_factory.mktemp("plain") / "shoulder.csv"
    experiment = twin.Experiment(joint="shoulder", excitation="aprbs", duration=200.0, seed=2, without=EXACT)
    experiment.run().save(path)
    return path


@pytest.fixture(scope="module")
def identified(plain_log, tmp_path_factory):
    """What `qpal identify` printed of the joint, and the folder of its results."""
    out, printed = tmp_path_factory.mktemp("identified") / "out", io.StringIO()
    with redirect_stdout(printed):
        assert main(["identify", str(plain_log), "--structure", "actuated_joint", "--out", str(out)]) == 0
    return out, printed.getvalue()


def test_identify_finds_the_physical_values_of_a_joint(identified):
    out, printed = identified
    assert "speed per volt, mid stroke" in printed
    assert "deg/s/V" in printed
    summary = json.loads((out / "summary.json").read_text(encoding="utf-8"))
    assert summary["read"]["detrend"] == "none"
    assert summary["setting"]["orders"] == {}
    assert summary["poles"] == []
    assert summary["stable"]
    values = {v["name"]: v["value"] for v in summary["values"]}
    p = twin.Parameters().replace({"shoulder.stribeck": 0.0, "shoulder.load_friction": 0.0, "dead_band": 0.0})
    true = beyond.twin_truth("shoulder", 0.1, p)
    assert values["speed_per_volt"] == pytest.approx(np.degrees(true["speed_per_volt"]), rel=0.02)
    assert values["end_low"] == pytest.approx(np.degrees(true["end_low"]), abs=0.5)
    assert values["end_high"] == pytest.approx(np.degrees(true["end_high"]), abs=0.5)
    # A sweep has no slow starts from rest; without Stribeck friction its moving friction is the break-away.
    assert "breakaway_up" not in values
    assert values["moving_friction_up"] == pytest.approx(true["breakaway_up"], rel=0.1)
    assert values["moving_friction_down"] == pytest.approx(true["breakaway_down"], rel=0.1)
    # And a sample of 0.1 s does not tell the time constant from the delay.
    assert values["lag_and_delay"] == pytest.approx(true["time_constant"] + true["delay"], abs=0.02)
    assert {v["unit"] for v in summary["values"]} == {"deg/s/V", "s", "V", "deg"}


def test_a_joint_is_written_as_json_c_python_and_text(plain_log, identified):
    out, _ = identified
    assert {path.name for path in out.glob("model.*")} == {"model.json", "model.h", "model.c", "model.py"}
    fit, summary = sysid.load(out / "model.json"), json.loads((out / "summary.json").read_text(encoding="utf-8"))
    assert fit.model.structure == "actuated_joint"
    assert dict(zip(fit.model.names, fit.theta.tolist(), strict=True)) == {
        p["name"]: p["value"] for p in summary["parameters"]
    }
    volts = np.loadtxt(plain_log, delimiter=",", skiprows=2)[:, 1]
    simulate = runpy.run_path(str(out / "model.py"))["simulate"]
    agrees(simulate(volts.tolist()), fit.simulate(volts))  # both from where the record began
    assert (out / "model.c").read_text(encoding="utf-8") == export_c.source(fit)
    html = (out / "report.html").read_text(encoding="utf-8")
    assert "The model in closed form" in html
    assert "x ends at 0 and at 1, where v becomes 0" in html
    assert "Physical values with 95 % intervals" in html
    names = {path.stem for path in (out / "figures").iterdir()}
    assert {"free-run", "residuals", "static-maps"} <= names
    assert not names & {"pole-zero", "step-response"}
    assert "where the line is steep, the joint turns far for each stroke" in html
    captions = re.findall(r"<figcaption>(.*?)</figcaption>", html, re.DOTALL)
    assert len(captions) == len(names)
    assert not [caption for caption in captions if "What to see: " not in caption]


def test_identify_takes_driver_and_sensor(plain_log, tmp_path):
    arguments = ["--structure", "actuated_joint", "--input-map", "saturation", "--output-map", "polynomial"]
    assert main(["identify", str(plain_log), *arguments, "--seconds", "1e-9", "--out", str(tmp_path / "out")]) == 0
    summary = json.loads((tmp_path / "out" / "summary.json").read_text(encoding="utf-8"))
    assert {"driver.upper", "sensor.c1"} <= {p["name"] for p in summary["parameters"]}


@pytest.mark.nightly
def test_data_sheets_come_in_by_options_and_bad_ones_end_in_a_sentence(plain_log, tmp_path, capsys):
    joint = ["identify", str(plain_log), "--structure", "actuated_joint", "--starts", "1"]
    wide = tmp_path / "wide"
    assert main([*joint, "--driver-step", "0.05", "--sensor-linearity", "0.01", "--out", str(wide)]) == 0
    assert main([*joint, "--driver-step", "0.05", "--out", str(tmp_path / "narrow")]) == 0
    ends = []
    for name in ("wide", "narrow"):
        summary = json.loads((tmp_path / name / "summary.json").read_text(encoding="utf-8"))
        assert summary["setting"]["driver_step"] == 0.05
        ends.append(next(v for v in summary["values"] if v["name"] == "end_high"))
    assert ends[0]["value"] == ends[1]["value"]
    half = [0.5 * (end["high"] - end["low"]) for end in ends]
    assert half[0] == pytest.approx(np.hypot(half[1], 1.959964 * np.degrees(0.01) / np.sqrt(2)), rel=1e-6)
    capsys.readouterr()
    for bad, word in (("--driver-step", "step is -1"), ("--sensor-linearity", "linearity is -1")):
        assert main([*joint, bad, "-1", "--out", str(tmp_path / "bad")]) == 2
        assert word in capsys.readouterr().err
        assert main(["identify", str(plain_log), bad, "0.1", "--out", str(tmp_path / "bad")]) == 2
        assert f"{bad} is given with --structure hammerstein_wiener" in capsys.readouterr().err
    assert not (tmp_path / "bad").exists()


def test_the_report_shows_what_the_record_shows_of_each_part(identified):
    out, printed = identified
    summary = json.loads((out / "summary.json").read_text(encoding="utf-8"))
    parts, names = summary["joint_fit"]["parts"], {p["name"] for p in summary["parameters"]}
    assert summary["setting"]["search"] == "lm"
    tried = {part["name"] for part in parts}
    assert tried == {"motor.stick", "motor.stick_down", "motor.loss", "motor.jam", "play.width"}
    assert summary["joint_fit"]["log_odds"] < 0.0  # this twin has none of them
    assert not tried & names
    assert (out / "figures" / "parts.png").exists()
    assert "It leaves open" in printed
    assert "A joint without these parts is likelier" in printed


@pytest.fixture(scope="module")
def shoulder():
    """The paper's protocol on the shoulder alone, and beyond."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(protocol, "PAPER", {"shoulder": protocol.PAPER["shoulder"]})
        return protocol.run(seed=0, duration=150.0)


@pytest.mark.nightly
def test_both_structures_see_the_same_records_and_the_joint_is_far_ahead_where_nothing_repeats(shoulder):
    sweep, drawn = shoulder.joints[0].beyond.trials
    for trial in (sweep, drawn):
        scale = trial.paper.estimation.y + trial.paper.estimation.y_offset
        np.testing.assert_allclose(scale, trial.joint.estimation.y, atol=1e-12)
        assert trial.paper.validation_fit < trial.ceiling
        assert trial.joint.validation_fit < trial.ceiling + 0.2
    assert sweep.log is shoulder.joints[0].log
    assert drawn.gain > 15.0
    assert sweep.near


@pytest.mark.nightly
@pytest.mark.parametrize("joint", twin.JOINTS)
def test_the_record_that_does_not_repeat_meets_both_ends(joint):
    log = beyond.irregular(joint, 0, 250.0, 0.1)
    low, high = twin.truth(joint).end_angles
    travel = (log.y_true - low) / (high - low)
    assert travel.min() < 0.03
    assert travel.max() > 0.97
    assert len(np.unique(log.u)) > 10
    assert np.abs(log.u).min() >= 0.6 * 12.0
    assert np.abs(log.u).max() <= 12.0


@pytest.mark.nightly
def test_recovered_values_stand_beside_the_truth_in_its_own_units(shoulder):
    found = {r.name: r for r in shoulder.joints[0].beyond.recovered}
    true = twin.truth("shoulder")
    assert found["speed_per_volt"].true == true.gain
    assert found["time_constant"].true == pytest.approx(-1 / true.continuous_pole)
    assert found["lag_and_delay"].true == pytest.approx(true.delay - 1 / true.continuous_pole)
    assert {r.unit for r in found.values()} == {"rad", "rad/s/V", "V", "s"}
    assert (found["breakaway_down"].true, found["breakaway_up"].true) == true.breakaway_voltage
    assert 0 < found["coulomb_up"].true < found["breakaway_up"].true  # Stribeck friction is less once it moves
    assert found["breakaway_down"].true < found["coulomb_down"].true < 0
    assert found["end_high"].aim == pytest.approx(np.radians(0.5))
    assert found["backlash"].aim == pytest.approx(0.2 * true.backlash)
    always = ("speed_per_volt", "coulomb_up", "coulomb_down", "end_low", "end_high")  # what either record shows
    assert all(set(found[name].found) == set(beyond.RECORDS) for name in always)
    assert found["backlash"].found.keys() <= set(beyond.RECORDS)  # where a play earned its place
    assert json.loads(json.dumps(found["delay"].as_dict()))["truth"] == true.delay


@pytest.mark.nightly
def test_the_tables_show_the_papers_row_both_structures_and_every_value(shoulder):
    grid = report.table(shoulder)
    assert [row[1:3] for row in grid.rows] == [
        ("the rig, 2016", "paper"),
        ("sweep", "paper's structure"),
        ("sweep", "actuated joint"),
        ("drawn sweep", "paper's structure"),
        ("drawn sweep", "actuated joint"),
    ]
    assert grid.rows[0][3] == "71.06 %"
    assert len(report.values_table(shoulder).rows) == len(shoulder.joints[0].beyond.recovered)
    assert report.ablation_section(shoulder) is None


@pytest.mark.nightly
def test_without_its_end_stops_or_its_friction_a_joint_is_lost_and_without_what_is_not_there_it_loses_nothing(shoulder):
    sweep, drawn = shoulder.joints[0].beyond.trials
    rows = {row.part: row for row in ablation.without_parts(drawn)}
    assert set(rows) == {*ablation.PARTS, ablation.ALIKE}
    assert rows["play"].fit is not None
    assert rows["jam"].fit is not None
    lost = {part: drawn.joint.validation_fit - row.fit for part, row in rows.items() if row.fit is not None}
    assert lost["end stops"] == max(lost.values())
    assert lost["end stops"] > 10.0
    assert lost["dry friction"] > 2.0
    assert abs(lost["linkage (straight line)"]) < 2.0  # the shoulder has none
    assert ablation.experiment(sweep.log).run().y.tolist() == sweep.log.y.tolist()


@pytest.mark.nightly
def test_ablation_in_the_report(monkeypatch, tmp_path, capsys):
    monkeypatch.setattr(protocol, "PAPER", {"shoulder": protocol.PAPER["shoulder"]})
    monkeypatch.setattr(ablation, "PARTS", {name: ablation.PARTS[name] for name in ("end stops", "play")})
    monkeypatch.setattr(ablation, "SHARED", ("end_stops", "noise"))
    monkeypatch.setattr(ablation, "ALL_BUT_STOPS", ("noise",))
    main(["reproduce", "--duration", "60", "--ablation", "--out", str(tmp_path / "out")])
    summary = json.loads((tmp_path / "out" / "summary.json").read_text(encoding="utf-8"))
    found = summary["ablation"]["shoulder"]
    assert set(found) == set(beyond.RECORDS)
    for record in found.values():
        assert set(record["actuated_joint"]["without"]) == {"end stops", "play", ablation.ALIKE}
        quiet = record["paper_structure"]["without"]["noise"]
        assert quiet == record["paper_structure"]["without"]["all but end stops"]
        assert quiet["ceiling"] > 98.0
    assert "Causes of the losses" in (tmp_path / "out" / "report.html").read_text(encoding="utf-8")
    assert (tmp_path / "out" / "figures" / "ablation.png").exists()


def test_a_fit_below_zero_counts_as_none():
    rows = (ablation.Row("friction", 30.0), ablation.Row("noise", -500.0), ablation.Row("end_stops", None, 20.0, "off"))
    a = ablation.Ablation("thigh", "drawn sweep", 98.0, (ablation.Row("play", 97.0),), -200.0, rows)
    assert [a.points_gained(row) for row in rows[:2]] == [30.0, 0.0]
    assert np.isnan(a.points_gained(rows[2]))
    assert a.points_lost(a.joint[0]) == 1.0
    assert a.behind == 98.0


def test_a_joint_has_no_orders():
    assert Setting(ActuatedJoint()).as_dict()["orders"] == {}
