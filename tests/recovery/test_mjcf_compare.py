"""`qpal compare --model`: which kind of parameter is off, that none is, and that the model lacks something."""

import json
import shlex

import numpy as np
import pytest
import robots

from twin.cli import main
from twin.mjcf import advice, comparison, logs, robot
from twin.report import mjcf_comparison as report

TS, NOISE = 0.01, 1e-3  # [s], [rad]
NAMES = ("servo",)
OPTIONS = ["--model", "robot.xml", "--actuator", "servo"]


def record(truth, names=NAMES, text=robots.SERVO, amplitude=1.0, seconds=5.0, **more):
    """A log of levels and a chirp, with what `robots.record` makes of `truth`."""
    rng, N = np.random.default_rng(4), round(seconds / TS)
    t = np.arange(N) * TS
    u = robots.levels(rng, len(names), N, 40, 0.5) + robots.chirp(t, 0.2, 2.5, 0.25)[:, None]
    y = robots.record(text, {"delay": 0.0} | truth, names, amplitude * u, TS, NOISE, rng, **more)
    return logs.RobotLog("log", amplitude * u, y, TS)


def compared(log, folder, names=NAMES, text=robots.SERVO):
    (folder / "robot.xml").write_text(text)
    return comparison.compare(robot.read(folder / "robot.xml", names), log, 1)


def test_the_kind_that_is_off_is_named_and_the_next_command_mends_it(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "robot.xml").write_text(robots.SERVO)
    log = record({"servo.armature": 0.012})
    robots.write_table("log.csv", NAMES, log.u, log.y, TS)
    assert main(["compare", "log.csv", *OPTIONS, "--out", "out"]) == 0
    out = capsys.readouterr().out
    number, sentence = out.splitlines()[:2]
    assert "◐ usable: RMS from the log to the model at servo" in number
    assert sentence.startswith("Armature explains ")
    summary = json.loads((tmp_path / "out" / "summary.json").read_text())
    assert (summary["verdict"], summary["named"]) == ("known", ["armature"])
    (change,) = summary["chain"][0]["changes"]
    assert abs(change["value"] / 0.012 - 1.0) < 0.05
    best, *others = summary["alone"]
    assert best["kinds"] == ["armature"]
    assert best["share"] > 0.999 > 0.9 > max(cause["share"] for cause in others)
    html = (tmp_path / "out" / "report.html").read_text(encoding="utf-8")
    assert all(f"{title}</h2>" in html for title in ("In words", "Model and log", "Kinds of parameters"))
    words = shlex.split(summary["next"].removeprefix("Next: "))
    assert words == ["qpal", "calibrate", "log.csv", *OPTIONS, "--free", "armature"]
    assert summary["next"] in out
    assert main([*words[1:], "--out", "mended"]) == 0
    (score,) = json.loads((tmp_path / "mended" / "summary.json").read_text())["scores"]
    assert score["rms_after"] < 1.1 * NOISE < 5.0 * NOISE < score["rms_before"]


def test_where_nothing_is_off_nothing_is_named(tmp_path):
    result = compared(record({}), tmp_path)
    assert result.nothing
    assert (result.named, result.chain) == ((), ())
    assert report.sentences(result)[0].startswith("No departure that matters: robot.xml follows log within 0.05")
    assert "noise makes 0.05" in report.sentences(result)[0]
    following = advice.after_comparison(result, "log.csv", OPTIONS)
    assert following.endswith("qpal compare OTHER.csv --model robot.xml --actuator servo")


def test_what_the_model_lacks_is_no_kind_of_parameter(tmp_path):
    """Cogging: a torque that varies with the place."""
    log = record({}, force=lambda q, v: 0.4 * np.sin(18.0 * q))
    result = compared(log, tmp_path)
    assert (result.known, result.named) == (False, ())
    first, second, *_ = report.sentences(result)
    assert first.startswith("The robot does something that robot.xml lacks")
    assert "times the noise" in second
    assert report.page(result, "Next: this.").sections


def test_of_damping_and_kv_the_sum_alone_acts(tmp_path):
    result = compared(record({"servo.damping": 0.3}), tmp_path)
    kinds = {result.named[0], *result.chain[0].alike}
    assert kinds == {"damping", "kv"}
    assert report.sentences(result)[0].startswith(("Damping, or kv in place of damping,", "Kv, or damping in place"))
    assert any("no log tells them apart" in text for text in report.sentences(result))


@pytest.mark.nightly
def test_two_kinds_at_once_are_both_named(tmp_path):
    """The gain alone explains 99 %, and is none of the two."""
    result = compared(record({"servo.damping": 0.3, "servo.armature": 0.01}), tmp_path)
    assert set(result.named) in ({"armature", "damping"}, {"armature", "kv"})


@pytest.mark.nightly
def test_of_two_joints_the_one_that_departs_is_said(tmp_path):
    names, truth = (robots.HIP, robots.KNEE), {f"{robots.KNEE}.frictionloss": 0.3}
    result = compared(record(truth, names, robots.PENDULUM), tmp_path, names, robots.PENDULUM)
    assert result.named == ("frictionloss",)
    values = {change.name: change.value for change in result.chain[0].changes}
    assert abs(values[f"{robots.KNEE}.frictionloss"] / 0.3 - 1.0) < 0.05
    assert max(result.departures, key=lambda each: each.share).drive == robots.KNEE
    assert "gain" not in {cause.kinds[0] for cause in result.alone}


@pytest.mark.nightly
def test_a_motor_in_another_unit_and_readings_that_are_lost(tmp_path):
    log = record({"delay": 0.02}, ("motor",), robots.MOTOR, 1.5)
    log.y[100:120] = np.nan
    log.y[300] += 1.0
    result = compared(log, tmp_path, ("motor",), robots.MOTOR)
    assert result.named == ("delay",)
    assert abs(result.chain[0].changes[0].value / 0.02 - 1.0) < 0.05
    assert "gain" in {cause.kinds[0] for cause in result.alone}
    assert [text for text in result.remarks if "rows" in text or "row 301" in text][-1].endswith("(row 301).")


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"--joint": "thigh"}, "--joint belongs to the leg, and --model is robot.xml; leave one of the two out"),
        ({"--against": "a.json"}, "--against belongs to the leg"),
        ({"--align": "delay"}, "--align belongs to the leg"),
        ({"--without": "noise"}, "--without belongs to the leg"),
        ({"--params": "a.toml"}, "--params belongs to the leg"),
        ({"--pot-side": "link"}, "--pot-side belongs to the leg"),
        ({"--realisation": "tendon"}, "--realisation belongs to the leg"),
        ({"--model": None}, "--actuator belongs to a robot's MJCF: give it with --model, or leave --actuator out"),
        ({"--actuator": "elbow"}, "unknown actuator 'elbow'"),
        ({"--output": "elbow"}, "'elbow'"),
        ({"--seconds": "0"}, "--seconds is 0; give a positive number"),
    ],
)
def test_what_cannot_be_compared_is_refused_in_a_sentence(change, said, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "robot.xml").write_text(robots.SERVO)
    u = np.sin(np.arange(100.0))[:, None]
    robots.write_table("log.csv", NAMES, u, u, TS)
    options = dict(zip(OPTIONS[::2], OPTIONS[1::2], strict=True)) | change
    words = [word for pair in options.items() if pair[1] is not None for word in pair]
    assert main(["compare", "log.csv", *words, "--out", "no"]) == 2
    err = capsys.readouterr().err
    assert said in err
    assert err.count("\n") == 1
    assert not (tmp_path / "no").exists()
