"""Joints whose sensor counts the other way, or tells a speed: they have the values of the same joint."""

import json
import re
from dataclasses import replace

import numpy as np
import pytest
from motion import Reference

import sysid
from sysid.data.record import IOData
from sysid.estimation.initial_state import with_initial_states
from sysid.joint import posterior
from sysid.joint.evidence import stop_tests
from sysid.joint.full import colour_level
from sysid.joint.values import joint_values
from sysid.structures import actuated_joint
from sysid.structures.actuated_joint import joint_motor
from sysid.workflow.record import read_record
from twin.cli import main

TS, NOISE = 0.05, 0.1
ARM_TS = 0.02
ARM = {"gain": 0.2, "lag": 3.0, "rise": 1.0, "fall": 1.0, "stick": 0.3, "stick_speed": 0.02, "delay": 1.0, "x0": 5.0}
ARM |= {"lower": -20.0, "upper": 20.0}


def levels(N, largest, seed):
    rng, u = np.random.default_rng([seed, 51]), np.zeros(N)
    k = 0
    while k < N:
        n = int(rng.uniform(4, 30))
        u[k : k + n] = rng.uniform(-largest, largest) * (rng.random() > 0.15)
        k += n
    return u


def sweep(N, largest):
    t = np.arange(N) * TS
    return largest * np.sin(2 * np.pi * t * (0.05 + 0.2 * t / t[-1]))


def record(reference, u, sign, seed):
    y = sign * reference.run(u) + NOISE * np.random.default_rng([seed, 52]).standard_normal(len(u))
    return IOData(u, y, TS, u_unit="V", y_unit="deg")


def points_lost(fit, data):
    """Points of the free run's fit below what the noise allows."""
    e = data.y[:, 0] - np.ravel(fit.simulate(data))
    return 100.0 * (np.sqrt(np.mean(e**2)) - NOISE) / np.std(data.y)


@pytest.mark.nightly  # by day: the pendulum of test_joint_verdict.py
@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize("stops", ["none", "both"])
def test_a_pendulum_over_several_turns_fits_another_input_with_either_sign(sign, stops):
    pendulum = Reference(
        lambda x: 2.0 * np.sin(np.deg2rad(x)), gain=1.9, lag=1.2, rise=1.0, fall=1.2, delay=0.4, x0=0.0
    )
    joint = actuated_joint(motor=joint_motor("periodic", stops, 360.0), knots=None, play=False)
    found = sysid.fit_joint(record(pendulum, levels(1200, 8.0, 1), sign, 1), joint)
    assert points_lost(found.fit, record(pendulum, sweep(800, 7.0), sign, 2)) < 1.0


@pytest.mark.nightly
def test_a_joint_between_stops_has_the_mirror_image_of_its_values():
    """Up is where the output rises: what moved the joint up moves it down where its sensor counts the other way."""
    leg = Reference(gain=1.0, lag=1.0, rise=1.0, fall=1.6, delay=0.3, x0=10.0, lower=-10.0, upper=45.0)
    found = []
    for sign in (1.0, -1.0):
        data = record(leg, levels(1500, 8.0, 3), sign, 4)
        fit = sysid.fit_joint(data).fit
        found.append({value.name: value for value in joint_values(fit, data=data)})
    up, down = found
    for name, mirrored, factor in (
        *(("end_low", "end_high", -1.0), ("end_high", "end_low", -1.0), ("speed_per_volt", "speed_per_volt", -1.0)),
        *(("coulomb_up", "coulomb_down", 1.0), ("coulomb_down", "coulomb_up", 1.0)),
    ):
        assert up[name].value == pytest.approx(factor * down[mirrored].value, rel=0.03, abs=0.3)
    for value, truth in (("end_low", -45.0), ("end_high", 10.0), ("coulomb_up", -1.6), ("coulomb_down", 1.0)):
        assert down[value].value == pytest.approx(truth, rel=0.05, abs=0.2)


def test_a_log_of_a_speed_gives_the_values_of_the_joint_and_its_model_runs_on_another_one(tmp_path):
    """A tachometer with noise of 0.5 deg/s."""
    leg = Reference(gain=0.5, lag=1.2, rise=1.0, fall=1.2, delay=0.4, x0=0.0)
    for name, u in (("first", levels(1200, 8.0, 5)), ("second", sweep(800, 7.0))):
        speed = np.gradient(leg.run(u), TS) + 0.5 * np.random.default_rng(len(u)).standard_normal(len(u))
        table = np.column_stack([np.arange(len(u)) * TS, u, speed])
        header = "time [s],voltage [V],speed [deg/s]"
        np.savetxt(tmp_path / f"{name}.csv", table, delimiter=",", header=header, comments="", fmt="%.6g")
    out = str(tmp_path / "out")
    assert main(["identify", str(tmp_path / "first.csv"), "--structure", "actuated_joint", "--out", out]) == 0
    values = {v["name"]: v for v in json.loads((tmp_path / "out/summary.json").read_text())["values"]}
    for name, true in (("speed_per_volt", 10.0), ("coulomb_up", 1.0), ("coulomb_down", -1.2)):
        assert values[name]["value"] == pytest.approx(true, rel=0.03)
        assert values[name]["determined"]
    run = ["run", f"{out}/model.json", str(tmp_path / "second.csv"), "--out", str(tmp_path / "run")]
    assert main(run) == 0
    summary = json.loads((tmp_path / "run/summary.json").read_text())
    assert summary["fit_percent"]["free_run"] > 90.0


def test_the_stretches_with_the_drive_off_are_left_out(tmp_path):
    """A leg that its weight turns while the drive is off: without the column that says so no joint explains it."""
    rng, lines, t = np.random.default_rng(7), [], 0.0
    for k in range(6):
        leg = Reference(gain=0.6, lag=1.2, rise=1.0, fall=1.2, delay=0.4, x0=float(rng.uniform(-10, 20)))
        u = levels(200, 8.0, 10 + k)
        y = np.concatenate([leg.run(u), np.linspace(0.0, rng.uniform(-30, 30), 30)])  # the hand of a person
        for volts, angle, on in zip([*u, *u[:30]], y, [1] * 200 + [0] * 30, strict=True):
            lines.append(f"{t:.3f},{volts:.4f},{angle + NOISE * rng.standard_normal():.4f},{on}")
            t += TS
    path = tmp_path / "log.csv"
    path.write_text("\n".join(["time [s],voltage [V],angle [deg],torque_enable", *lines]))
    data = sysid.read(path)
    assert data.lengths == (200,) * 6
    mapping = tmp_path / "map.toml"
    mapping.write_text(
        '[clock]\ncolumn = "time [s]"\nunit = "s"\n[[input]]\ncolumn = "voltage [V]"\n'
        '[[output]]\ncolumn = "angle [deg]"\n[range]\ndrive = "torque_enable"\n'
    )
    assert sysid.read(path, map=mapping).lengths == data.lengths
    found = sysid.fit_joint(data)
    assert np.degrees(np.sqrt(found.fit.criteria.mse)) < 1.1 * NOISE


@pytest.fixture(scope="module")
def parts_of_a_log():
    """A joint without load, in three parts of a log that begin while it moves."""
    starts = ((0.0, 0.0), (-50.0, 6.0), (40.0, -5.0))  # place [deg], speed [deg/sample]
    records = []
    for k, (x0, v0) in enumerate(starts):
        joint = Reference(gain=2.0, lag=4.0, rise=0.5, fall=0.9, delay=1.4, x0=x0, v0=v0)
        records.append(record(joint, levels(300, 5.0, 20 + k), 1.0, 30 + k))
    return IOData.merge(*records)


def test_parts_of_a_log_may_begin_in_motion(parts_of_a_log):
    found = sysid.fit_joint(parts_of_a_log)
    assert np.sqrt(found.fit.criteria.mse) < 1.05 * NOISE
    assert not {"motor.loss", "play.width"} & set(found.shown)  # friction differs by direction, and no load is there


def test_a_search_begins_at_the_speed_of_the_first_readings():
    chain = actuated_joint(motor=joint_motor("none", "none"), knots=None, play=False)
    chain, k = replace(chain, fixed={}), np.arange(30.0)
    ramps = [IOData(np.sin(k), y, TS, u_unit="V", y_unit="deg") for y in (3 + 2 * k, 8 - 0.5 * k, 5 + 0 * k)]
    thetas = with_initial_states(chain, np.ones(len(chain.names)), IOData.merge(*ramps))
    np.testing.assert_allclose(thetas[:, chain.names.index("motor.v0")], [2.0, -0.5, 0.0], rtol=1e-6)


def with_backlash(y, width):
    link = np.array(y)
    for k in range(1, len(y)):
        link[k] = np.clip(link[k - 1], y[k] - width / 2, y[k] + width / 2)
    return link


@pytest.mark.nightly
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_rest_at_an_end_is_judged_by_the_voltage_that_moves_the_joint_there(sign):
    """A sweep alone shows it late (2.5 and 2.1 V): the joint crosses its backlash, and answers after its delay."""
    arm = Reference(lambda x: 0.4 * np.cos(np.deg2rad(x)), **ARM)
    u = 3.8 * np.sin(2 * np.pi * np.arange(2000) * ARM_TS * (0.1 + 0.2 * np.arange(2000) / 2000))
    y = with_backlash(arm.run(u), 0.8) + 0.1 * np.random.default_rng(4).standard_normal(len(u))
    data = IOData(u, sign * y, ARM_TS, u_unit="V", y_unit="deg")
    tests = stop_tests(sysid.fit_joint(data).fit, data)
    low, high = (1.1 * (ARM["rise"] + ARM["stick"] + way * 0.4 * np.cos(np.deg2rad(20.0))) for way in (-1, 1))
    low, high = (low, high) if sign > 0.0 else (high, low)
    assert tests["end_low"].moves == pytest.approx(low, rel=0.1)
    assert tests["end_high"].moves == pytest.approx(high, rel=0.1)


def test_the_noise_of_a_record_of_parts_is_that_of_its_readings(parts_of_a_log):
    """The level of the prior: with a speed of zero at the first samples of each part it was 150 times the noise."""
    chain = actuated_joint(motor=joint_motor("none", "none"), knots=None, play=False)
    chain = replace(chain, fixed={})
    true = {"gain": 2.0, "lag": 4.0, "rise": 0.5, "fall": 0.9, "delay": 1.4}
    start = [true.get(name.split(".")[1], 0.0) for name in chain.names]
    fit = sysid.fit(chain, parts_of_a_log, start=start, search="lm", objective=sysid.Objective(knots=0))
    assert colour_level(fit, parts_of_a_log) == pytest.approx(NOISE, rel=0.2)


@pytest.mark.nightly
def test_mid_stroke_is_the_middle_of_the_way_in_any_unit():
    """Without a linkage it was 0.5 of the output's unit: half a degree, or half a radian."""
    arm = Reference(lambda x: 0.8 * np.sin(np.deg2rad(x)), gain=1.5, lag=1.2, rise=1.0, fall=1.2, delay=0.4, x0=35.0)
    data = record(arm, levels(1200, 4.0, 5), 1.0, 6)
    load = 0.8 * np.sin(np.deg2rad(0.5 * (data.y.min() + data.y.max())))
    for unit, size in (("deg", 1.0), ("rad", np.pi / 180)):
        fit = sysid.fit_joint(replace(data, y=data.y * size, y_unit=unit))
        values = {v.name: v.value for v in joint_values(fit.fit, data=replace(data, y=data.y * size, y_unit=unit))}
        assert values["coulomb_up"] == pytest.approx(1.0 + load, abs=0.06)
        assert values["coulomb_down"] == pytest.approx(-1.2 + load, abs=0.06)


@pytest.mark.parametrize(
    ("name", "cells", "reason"),
    [
        ("torque_enable", "0 0 0 0", "it holds 0:"),
        ("enable", "-1 0 0 -1", "it holds -1 and 0:"),
        ("enable", "1 2 2 1", "it holds 1 and 2:"),
        ("enable", "0 1 2 2", "it holds 3 values"),
        ("motor enabled", "go go halt go", "it holds text"),
        ("disabled", "0 0 1 1", "its name says that it is 0 then"),
        ("enable,armed", "0,1 1,0 1,1 0,0", "so may"),
        ("torque_enable", "1 1 1 1", ""),
        ("enable_brake", "0 1 0 1", ""),
        ("re_enable_count", "0 1 1 1", ""),
    ],
)
def test_a_column_that_may_be_the_switch_and_is_not_is_told(name, cells, reason, tmp_path):
    path, values = tmp_path / "log.csv", cells.split()
    u, y = levels(240, 8.0, 3), np.cumsum(levels(240, 8.0, 3))
    rows = [f"{k * TS:.3f},{u[k]:.3f},{y[k]:.3f},{values[k // 60]}" for k in range(240)]
    path.write_text("\n".join([f"time [s],voltage [V],angle [deg],{name}", *rows]))
    record = read_record(path)
    assert record.data.lengths == (240,)
    notes = [note for note in record.notes if "may say when the drive is on" in note]
    assert [reason in note for note in notes] == ([True] if reason else [])


def test_what_the_switch_leaves_out_is_counted(tmp_path):
    on = np.ones(240, dtype=int)
    on[50:100] = on[110:150] = 0
    path, u = tmp_path / "log.csv", levels(240, 8.0, 3)
    rows = [f"{k * TS:.3f},{u[k]:.3f},{np.sum(u[:k]):.3f},{on[k]}" for k in range(240)]
    path.write_text("\n".join(["time [s],voltage [V],angle [deg],torque_enable", *rows]))
    note = "the drive is on in 2 stretches and 1 shorter than 20 samples: 100 of 240 samples are left out"
    assert note in read_record(path).notes


def test_a_mapping_takes_a_column_that_is_no_switch_away_and_the_rest_is_guessed(tmp_path, capsys):
    """The mapping is the one that the note of the switch proposes."""
    on = (np.arange(240) < 100).astype(int)
    path, u = tmp_path / "log.csv", levels(240, 8.0, 3)
    rows = [f"{k * TS:.3f},{u[k]:.3f},{np.sum(u[:k]):.3f},{on[k]}" for k in range(240)]
    path.write_text("\n".join(["time [s],voltage [V],angle [deg],torque_enable", *rows]))
    guessed = read_record(path)
    assert guessed.data.lengths == (100,)
    (note,) = (note for note in guessed.notes if "is 0 while the drive is off" in note)
    table, line = tmp_path / "map.toml", re.search(r'(drive = "") under (\[range\])', note)
    table.write_text(f"{line[2]}\n{line[1]}\n")
    every = read_record(path, mapping=table)
    assert every.data.lengths == (240,)
    assert (every.input, every.output, every.data.y_unit) == ("voltage [V]", "angle [deg]", "rad")
    assert not any("drive" in note for note in every.notes)
    table.write_text("[range]\nstop = 5.0\n")  # without a word on the switch it is guessed too
    assert read_record(path, mapping=table).data.lengths == (min(100, round(5.0 / TS) + 1),)
    table.write_text('[range]\ndrive = ""\n')
    arguments = [str(path), "--map", str(table), "--write-map", str(tmp_path / "whole.toml"), "--range", "0:10"]
    assert main(["info", *arguments, "--out", str(tmp_path / "info"), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["record"]["samples"] == round(10.0 / TS) + 1
    whole = read_record(path, mapping=tmp_path / "whole.toml").data
    assert whole.lengths == (round(10.0 / TS) + 1,)


def test_a_speed_beside_a_column_of_the_drive_in_short_stretches_is_read_and_inspected(tmp_path):
    t, rng = np.arange(600) * TS, np.random.default_rng(8)
    u, on = levels(600, 8.0, 9), (np.arange(600) % 40 < 25).astype(int)
    path = tmp_path / "log.csv"
    table = np.column_stack([t, u, 3.0 * u + rng.standard_normal(600), on])
    header = "time [s],voltage [V],speed [deg/s],torque_enable"
    np.savetxt(path, table, delimiter=",", header=header, comments="", fmt="%.6g")
    data = sysid.read(path)
    assert data.y_unit == "rad/s"
    assert data.lengths == (25,) * 15
    assert main(["info", str(path), "--out", str(tmp_path / "info")]) == 0


@pytest.mark.nightly
def test_a_sweep_against_both_ends_meets_both():
    """A load that changes over the way does not hide the rests, since the model knows it; the ends are 40 deg apart."""
    arm, k = Reference(lambda x: 0.4 * np.cos(np.deg2rad(x)), **ARM), np.arange(2000)
    u = 3.8 * np.sin(2 * np.pi * k * ARM_TS * (0.1 + 0.2 * k / len(k)))
    y = with_backlash(arm.run(u), 0.8) + 0.1 * np.random.default_rng(4).standard_normal(len(k))
    data = IOData(u, y, ARM_TS, u_unit="V", y_unit="deg")
    tests = stop_tests(sysid.fit_joint(data).fit, data)
    assert all(test.met for test in tests.values())
    assert abs(tests["end_high"].farthest - tests["end_low"].farthest - (40.0 - 0.8)) < 0.5


@pytest.mark.nightly
def test_a_part_of_a_long_record_does_not_replace_what_the_whole_shows(monkeypatch):
    """The last search of a record that was thinned goes over its first 5000 samples; here it is led astray."""
    k, searched = np.arange(5200), []
    original = posterior._Search._round

    def astray(self, chain, points, data, units, level):
        fit = original(self, chain, points, data, units, level)
        searched.append(data.N)
        if data.N == 5000:
            wrong = {"motor.gain": 0.2, "motor.lag": 10.0, "motor.rise": 2.0, "motor.upper": 0.6}
            fit = replace(fit, theta=fit.theta * [wrong.get(name, 1.0) for name in fit.model.names])
        return fit

    monkeypatch.setattr(posterior._Search, "_round", astray)
    monkeypatch.setattr(posterior, "_ROUNDS", 1)
    u = 2.6 * np.sign(np.sin(k**1.05 / 90.0))
    y = Reference(lambda x: 0.3, **{**ARM, "gain": 0.15, "lag": 2.0}).run(u)
    data = IOData(u, y + 0.1 * np.random.default_rng(4).standard_normal(len(k)), ARM_TS, u_unit="V", y_unit="deg")
    fit = sysid.fit_joint(data).fit
    assert 5000 in searched
    assert fit.criteria.mse < 1.1 * 0.1**2
