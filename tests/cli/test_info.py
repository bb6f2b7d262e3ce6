"""`qpal info`: parameters with their sources, truth in the units that people read, and two figures of known shape."""

import json
import math
from dataclasses import dataclass, fields
from typing import Any

import numpy as np
import pytest

import twin
from twin import parameter_file
from twin.cli import main
from twin.imperfections import of_group
from twin.parameters import TABLE, Parameters
from twin.report import info as report
from twin.studies import beyond
from twin.studies.information import Information, Joint, inform
from twin.truth import Truth

IDEAL = {row.name: 0.0 for row in TABLE if row.lower == 0}  # no friction, gravity, dead band, noise
ROD_JOINTS = twin.JOINTS[1:]


def test_summary_holds_every_parameter_and_the_truth_of_every_joint(tmp_path, capsys):
    assert main(["info", "--ts", "0.05", "--json", "--out", str(tmp_path / "out")]) == 0
    out, err = capsys.readouterr()
    assert err == ""
    summary = json.loads(out)
    assert summary == json.loads((tmp_path / "out" / "summary.json").read_text(encoding="utf-8"))
    assert [p["name"] for p in summary["parameters"]] == [row.name for row in TABLE]
    for p, row in zip(summary["parameters"], TABLE, strict=True):
        assert (p["value"], p["nominal"], p["lower"], p["upper"]) == (row.nominal, row.nominal, row.lower, row.upper)
        assert (p["unit"], p["source"], p["enters"], p["changed"]) == (row.unit, row.source, row.enters, False)
    assert set(summary["truth"]) == set(twin.JOINTS)
    for joint, truth in summary["truth"].items():
        assert truth == json.loads(json.dumps(twin.truth(joint, 0.05).as_dict()))
    assert {"python", "numpy", "mujoco", "qpal"} <= set(summary["versions"])


def test_terminal_and_report_show_names_degrees_and_versions(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert main(["info"]) == 0
    out = capsys.readouterr().out
    (folder,) = (tmp_path / "runs").iterdir()
    assert folder.name.endswith("-info")
    html = (folder / "report.html").read_text(encoding="utf-8")
    for text in (out, html):
        assert all(row.name in text for row in TABLE)
        for angle in map(math.degrees, twin.truth("thigh").end_angles):
            assert f"{angle:.2f}".replace("-", "−") in text
        assert "mujoco" in text
    for row in TABLE:
        assert row.enters.replace("'", "&#39;").replace("<", "&lt;").replace(">", "&gt;") in html
    assert "src=" in html
    assert "http" not in html.replace("http://www.w3.org", "").replace("http-equiv", "")
    names = {path.name for path in (folder / "figures").iterdir()}
    assert names == {"speed-over-voltage.png", "geometry.png"}
    assert f"Report: {folder.relative_to(tmp_path) / 'report.html'}" in out


def test_one_joint_has_its_own_parameters_and_the_shared_ones(tmp_path, capsys):
    assert main(["info", "--joint", "shoulder", "--json", "--out", str(tmp_path / "out")]) == 0
    summary = json.loads(capsys.readouterr().out)
    assert list(summary["truth"]) == ["shoulder"]
    expected = {row.name for row in TABLE if not row.name.startswith(("thigh.", "shank."))}
    assert {p["name"] for p in summary["parameters"]} == expected
    names = {path.name for path in (tmp_path / "out" / "figures").iterdir()}
    assert names == {"speed-over-voltage.png"}  # its motor sits on the joint: there is no linkage to draw


def test_changed_parameters_are_marked_and_reach_the_truth(tmp_path, capsys):
    file = tmp_path / "leg.toml"
    file.write_text("[thigh]\nbacklash = 0.0349065850398866  # 2 degrees\n")
    assert main(["info", "--params", str(file), "--out", str(tmp_path / "out")]) == 0
    out = capsys.readouterr().out
    assert "thigh.backlash 2 deg instead of 0.5" in out
    (row,) = [line.split() for line in out.splitlines() if line.split()[:1] == ["thigh.backlash"]]
    assert row[-5:-3] == ["2", "0.5"]
    assert row[-1] == "deg"
    summary = json.loads((tmp_path / "out" / "summary.json").read_text(encoding="utf-8"))
    assert [p["name"] for p in summary["parameters"] if p["changed"]] == ["thigh.backlash"]
    assert summary["truth"]["thigh"]["backlash"] == 0.0349065850398866
    assert summary["file"] == str(file)
    result = inform(None, 0.1, parameter_file.read(file), str(file))
    grids = [report.value_grid(name, group, result) for name, group in result.groups().items()]
    loud = [grid.rows[k][0] for grid in grids for k in range(len(grid.rows)) if k not in grid.quiet_rows]
    assert loud == ["thigh.backlash"]
    assert not any(
        report.value_grid(name, group, inform()).quiet_rows for name, group in inform().groups().items()
    )  # nothing changed, nothing in grey


@pytest.mark.parametrize("name", ["out/leg.toml", "leg.json", "deep/leg.toml"])
def test_written_parameters_read_back_and_give_the_same_information(name, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "deep").mkdir()
    (tmp_path / "given.json").write_text('{"thigh.coulomb": 41, "gravity": 1.62}')
    assert main(["info", "--params", "given.json", "--write-params", name, "--out", "out"]) == 0
    assert f"Parameters: {name}" in capsys.readouterr().out
    assert parameter_file.read(name) == Parameters({"thigh.coulomb": 41.0, "gravity": 1.62})
    first = json.loads((tmp_path / "out" / "summary.json").read_text(encoding="utf-8"))
    assert main(["info", "--params", name, "--out", "again", "--json"]) == 0
    again = json.loads(capsys.readouterr().out)
    assert again["parameters"] == first["parameters"]
    assert again["truth"] == first["truth"]


BAD: dict[str, tuple[list[str], list[str]]] = {
    "joint": (["--joint", "knee"], ["joint 'knee'", "shoulder, thigh, shank"]),
    "ts": (["--ts", "0"], ["Ts is 0", "milliseconds"]),
    "ts text": (["--ts", "fast"], ["'--ts'", "'fast'", "give a number"]),
    "no file": (["--params", "nowhere.toml"], ["nowhere.toml", "does not exist"]),
    "unknown name": (["--params", "unknown.toml"], ["unknown.toml", "'thigh.coulom'", "thigh.coulomb"]),
    "out of bounds": (["--params", "bounds.toml"], ["bounds.toml", "gravity is -1 m/s2", "0 to 20 m/s2"]),
    "no leg": (["--params", "no_leg.toml"], ["no_leg.toml", "shank", "the actuator cannot be"]),
    "write suffix": (["--write-params", "leg.yaml"], ["leg.yaml", ".toml or .json"]),
    "write folder": (["--write-params", "nowhere/leg.toml"], ["nowhere/leg.toml", "no folder"]),
    "write is a folder": (["--write-params", "taken.toml"], ["taken.toml", "folder"]),
    "out": (["--out", "bounds.toml"], ["cannot write to bounds.toml"]),
}


@pytest.mark.parametrize(("arguments", "fragments"), BAD.values(), ids=BAD)
def test_bad_input_is_one_sentence_and_leaves_nothing(arguments, fragments, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "unknown.toml").write_text("thigh.coulom = 3")
    (tmp_path / "bounds.toml").write_text("gravity = -1")
    (tmp_path / "no_leg.toml").write_text("shank.retracted_length = 0.3")
    (tmp_path / "taken.toml").mkdir()
    before = sorted(tmp_path.rglob("*"))
    assert main(["info", *arguments]) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert err.count("\n") == 1
    for fragment in fragments:
        assert fragment in err
    assert sorted(tmp_path.rglob("*")) == before


@pytest.mark.parametrize("joint", ROD_JOINTS)
def test_geometry_runs_from_end_to_end_and_its_arm_is_the_slope(joint):
    p = Parameters()
    curve = inform(joint).joints[0].geometry
    assert curve is not None
    assert curve.length[0] == pytest.approx(p[f"{joint}.retracted_length"])
    assert curve.length[-1] == pytest.approx(p[f"{joint}.retracted_length"] + p[f"{joint}.stroke"])
    slope = np.gradient(curve.length, curve.angle, edge_order=2)
    np.testing.assert_allclose(curve.arm, slope, rtol=1e-3)
    assert inform("shoulder").joints[0].geometry is None


@pytest.mark.parametrize("joint", twin.JOINTS)
def test_an_ideal_joint_crosses_its_travel_at_no_load_speed(joint):
    p = Parameters({**IDEAL, "supply_voltage": 6.0})
    found = inform(joint, parameters=p).joints[0]
    travel = p["shoulder.upper"] - p["shoulder.lower"] if joint == "shoulder" else p[f"{joint}.stroke"]
    expected = travel / (p[f"{joint}.no_load_speed"] * 6.0 / p[f"{joint}.rated_voltage"])
    for way, sign in ((found.down, -1), (found.up, 1)):
        assert way.crossing == pytest.approx(expected, rel=1e-6)
        assert way.voltage[-1] == pytest.approx(6.0 * sign)
        np.testing.assert_allclose(way.speed, found.truth.closed_form_gain * way.voltage, rtol=1e-6)


@pytest.mark.parametrize("joint", twin.JOINTS)
def test_speed_over_voltage_is_that_of_the_simulation(joint):
    """Constant volts through mid stroke, with all imperfections of drive and friction and none of measurement."""
    volts = 8.0  # 170 of the 255 levels of PWM
    options = {"amplitude": volts, "half_period": 15.0}
    without = of_group("sensor")
    record = twin.Experiment(joint, duration=40.0, Ts=0.01, without=without, options=options).run()
    found = inform(joint).joints[0]
    q = record.y_true
    assert q is not None
    speed = np.gradient(q, record.Ts)
    for way, sign in ((found.down, -1), (found.up, 1)):
        expected = float(np.interp(volts, sign * way.voltage, sign * way.speed)) * sign
        through = np.abs(q - found.truth.operating_point) < 0.02
        moving = speed[through & (record.u == sign * volts) & (record.t > 3.0)]
        assert len(moving) > 3
        assert np.median(moving) == pytest.approx(expected, rel=5e-3)


@pytest.mark.parametrize("joint", twin.JOINTS)
def test_motion_begins_at_the_break_away_voltage(joint):
    for stribeck in (0.0, 2.0):
        found = inform(joint, parameters=Parameters({f"{joint}.stribeck": stribeck})).joints[0]
        for way, sign in ((found.down, -1), (found.up, 1)):
            assert way.starts
            assert np.all(np.diff(sign * way.speed) > 0)
            if stribeck == 0.0:  # friction of rest is friction of motion: no jump, and nothing below break-away
                assert way.voltage[0] == pytest.approx(way.breakaway, rel=1e-3)
                assert abs(way.jump) < 1e-3 * abs(way.top_speed)
            else:
                assert sign * way.voltage[0] < 0.9 * sign * way.breakaway
                assert abs(way.jump) > 0.02 * abs(way.top_speed)


def test_a_joint_that_the_supply_cannot_start_is_said_to_stand():
    p = Parameters({"shoulder.coulomb": 20.0})
    stuck = inform("shoulder", parameters=p)
    joint = stuck.joints[0]
    assert not joint.down.starts
    assert not joint.up.starts
    assert (joint.up.crossing, joint.up.top_speed) == (math.inf, 0.0)
    assert "at 12 V it does not start down or up." in report.sentences(stuck)[0]
    assert report.pictures(stuck)  # and can be drawn
    assert stuck.as_dict()["static"]["shoulder"]["up"]["least_voltage"] is None


@dataclass(frozen=True)
class Later(Truth):
    """A truth with fields that the report has never heard of."""

    @classmethod
    def of(cls, truth: Truth, **extra: Any) -> "Later":
        later = cls(**{f.name: getattr(truth, f.name) for f in fields(Truth)})
        object.__setattr__(later, "extra", extra)
        return later

    def as_dict(self) -> dict[str, Any]:
        return {**super().as_dict(), **self.extra}  # type: ignore[attr-defined]


def test_a_field_that_the_table_does_not_know_is_listed_under_its_own_name():
    joint = inform("thigh").joints[0]
    extra = {
        "new_level": 0.25,
        "new_pair": [1.0, None],
        "new_curve": [0.0] * 50,
        "new_zeros": [[0.5, 0.25], [0.5, -0.25]],
        "new_group": {"backlash": math.radians(3.0), "other": True},
        "new_word": "both",
    }
    later = Joint("thigh", Later.of(joint.truth, **extra), joint.down, joint.up, joint.geometry)
    rows = dict(report.truth_grid(Information((), (later,), 0.1, 12.0)).rows)
    assert rows["new level"] == "0.25"
    assert rows["new pair"] == "1, –"
    assert rows["new curve"] == "50 values"
    assert rows["new zeros"] == "0.50000 + 0.25000i, 0.50000 − 0.25000i"
    assert rows["new group: backlash"] == "3 deg"  # the unit of the parameter of that name
    assert rows["new group: other"] == "yes"
    assert rows["new word"] == "both"
    assert rows["backlash, whole width [deg]"] == "0.5"


def test_the_voltages_of_motion_are_those_that_reproduce_compares_with():
    """One number for friction and load in motion: in the summary, in the table, and as the truth of an estimate."""
    result = inform("thigh")
    known = beyond.twin_truth("thigh", 0.1)
    pair = [known["coulomb_down"], known["coulomb_up"]]
    assert result.as_dict()["truth"]["thigh"]["moving_voltage"] == pair
    (row,) = (row for row in report.truth_grid(result).rows if row[0].startswith("voltage for friction and load"))
    assert [float(v.replace("−", "-")) for v in row[1].removesuffix(" V").split(", ")] == pytest.approx(pair, abs=2e-3)
    # Friction at rest is 1.3 times that in motion here, and the two differ by that share of the friction alone.
    below, above = result.joints[0].truth.breakaway_voltage
    assert 0.3 < pair[0] - below < 0.5
    assert 0.3 < above - pair[1] < 0.5
