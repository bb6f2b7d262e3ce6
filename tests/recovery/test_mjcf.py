"""Joints of a user's MJCF: values found from a bad start, written back, and refusals in a sentence."""

import io
import json
import re
import shlex
import shutil
import tomllib
from contextlib import redirect_stdout
from dataclasses import replace

import mujoco
import numpy as np
import pytest
from often import by_day
from robots import CART, HIP, KNEE, PENDULUM, TRUTH, chirp, levels, record, write_table

from twin.calibrate.problem import Simulations
from twin.cli import main
from twin.mjcf import advice, calibration, logs, problem, robot, simulation, writing
from twin.mjcf.parameters import parameters
from twin.report import mjcf as report

TS = 0.004
COLUMNS = [
    *("--input", f"{HIP} command [rad],{KNEE} command [rad]"),
    *("--output", f"{HIP} angle [deg],{KNEE} angle [deg]"),
]


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """robot.xml without friction, armature or delay, and two logs of a robot that has them."""
    made = tmp_path_factory.mktemp("robot")
    (made / "robot.xml").write_text(PENDULUM)
    rng, t = np.random.default_rng(0), np.arange(1500) * TS
    chirps = np.column_stack([chirp(t), chirp(t, 0.3, 4.0, 0.6)])
    for name, u in (("chirp.csv", chirps), ("steps.csv", levels(rng, 2, 1000, 120))):
        y = record(PENDULUM, TRUTH, (HIP, KNEE), u, TS, 1e-3, rng)
        write_table(made / name, (HIP, KNEE), u, y, TS)
    return made


@pytest.fixture(scope="module")
def verb(folder, tmp_path_factory):
    """`qpal calibrate` on both logs: where it ran, what it said, and the result that it had."""
    place, results, own = tmp_path_factory.mktemp("verb"), [], calibration.calibrate
    for name in ("robot.xml", "chirp.csv", "steps.csv"):
        shutil.copy(folder / name, place / name)
    command = ["calibrate", "chirp.csv", "--model", str(place / "robot.xml"), "--actuator", f"{HIP},{KNEE}", *COLUMNS]
    with pytest.MonkeyPatch.context() as patch, redirect_stdout(io.StringIO()) as said:
        patch.chdir(place)
        patch.setattr(calibration, "calibrate", lambda *a, **k: results.append(own(*a, **k)) or results[-1])
        assert main([*command, "--hold-out", "steps.csv", "--out", "out"]) == 0
    return place, said.getvalue(), results[0]


@pytest.fixture(scope="module")
def calibrated(folder, verb):
    used = logs.read(str(folder / "chirp.csv"), robot.read(folder / "robot.xml", (HIP, KNEE)), COLUMNS[1], COLUMNS[3])
    return verb[2], used


def test_hidden_values_are_found_from_none(calibrated):
    result, _ = calibrated
    assert result.optimum.stop.converged
    for name, truth in TRUTH.items():
        value = result[name]
        assert value.determined
        assert value.holds(truth) or abs(value.value - truth) < 0.02 * abs(truth), name
    for run in result.runs:
        assert run.rms("after") < 1.1e-3  # of which 1e-3 is noise
        assert run.rms("before") > 0.03


@pytest.mark.parametrize("moves", by_day([False, True], True))
def test_a_log_may_begin_with_a_step_or_in_motion(folder, moves):
    """Its first row is the 250th of a longer record: what was commanded before is not in it."""
    rng, t = np.random.default_rng(7), np.arange(1500) * TS
    u = np.column_stack([chirp(t), chirp(t, 0.3, 4.0, 0.6)]) if moves else levels(rng, 2, 1500, 250)
    y = record(PENDULUM, TRUTH, (HIP, KNEE), u, TS, 1e-3, rng)
    whole = logs.RobotLog("cut", u[250:], y[250:], TS)
    result = calibration.calibrate(
        robot.read(folder / "robot.xml", (HIP, KNEE)), [whole], [replace(whole, name="held")]
    )
    for name, truth in TRUTH.items():
        assert abs(result[name].value - truth) < max(0.02 * abs(truth), 3.0 * result[name].std), name
    assert max(run.rms("after") for run in result.runs) < 1.5e-3  # of which 1e-3 is noise


def test_the_written_robot_moves_as_the_calibrated_one(calibrated, folder, tmp_path):
    """In plain MuJoCo, whose own delay takes the commands later."""
    result, log = calibrated
    assert writing.write(result, tmp_path) == ["ranges.toml", "robot-calibrated.xml", "changes.diff"]
    model = mujoco.MjModel.from_xml_path(str(tmp_path / "robot-calibrated.xml"))
    data, bias = mujoco.MjData(model), np.array([model.numeric(f"{name}_bias").data[0] for name in (HIP, KNEE)])
    first, data.qvel[:], earlier = np.column_stack([run.start for run in result.runs if not run.held_out])
    data.qpos[:] = first - bias
    for k in range(2):
        mujoco.mj_initCtrlHistory(model, data, k, None, np.full(int(model.actuator_history[k, 0]), earlier[k]))
    y = np.zeros_like(log.u)
    for k, u in enumerate(log.u):
        y[k], data.ctrl[:] = data.qpos + bias, u
        mujoco.mj_step(model, data, round(TS / model.opt.timestep))
    after = np.column_stack([run.after for run in result.runs if not run.held_out])
    assert np.abs(y - after).max() < 1e-5
    table = tomllib.loads((tmp_path / "ranges.toml").read_text())
    std = [row["std"] for row in table["parameter"]]
    np.testing.assert_allclose(np.sqrt(np.diag(table["joint"]["covariance"])), std, rtol=1e-6)


def test_a_model_that_got_worse_is_not_offered(calibrated, tmp_path):
    result, _ = calibrated
    worse = [replace(run, before=run.after, after=run.before) if run.held_out else run for run in result.runs]
    result = replace(result, runs=tuple(worse))
    assert report.sentences(result)[0].startswith(
        "Do not use the calibrated model: the error of the free run goes from"
    )
    assert writing.write(result, tmp_path) == ["ranges.toml"]


def test_the_jacobian_is_that_of_single_differences(calibrated):
    """Also where trees of bodies are stepped together."""
    result, log = calibrated
    spec = mujoco.MjSpec.from_string(PENDULUM)
    spec.body("world").add_body(name="other", pos=[1, 0, 1])
    spec.attach(mujoco.MjSpec.from_string(PENDULUM), prefix="b_", site=spec.body("other").add_site())
    names = (HIP, KNEE, f"b_{HIP}", f"b_{KNEE}")
    model = spec.compile()
    path = result.robot.path
    pair = robot.Robot(path, spec, model, robot.drives_of(path, model, names), (), spec)
    assert len({drive.tree for drive in pair.drives}) == 2
    both = logs.RobotLog("both", *(np.tile(each[:200], 2) for each in (log.u, log.y)), TS)
    task = problem.Fit(simulation.Rig(pair, parameters(pair)), [both], np.full(4, 1e-3))
    p, columns = task.start, range(len(task.free))
    base, steps = task.responses_at(p), np.full(len(columns), 0.01)
    alone = Simulations._changes(task, p, base, columns, steps)
    single, task.simulations = task.simulations, 0
    np.testing.assert_allclose(task._changes(p, base, columns, steps), alone, atol=1e-9)
    assert task.simulations < 0.6 * single


def test_a_log_that_shows_nothing_determines_nothing(folder):
    rig = robot.read(folder / "robot.xml", (KNEE,))
    rng = np.random.default_rng(2)
    still = logs.RobotLog("still", np.zeros((300, 1)), 1e-3 * rng.standard_normal((300, 1)), TS)
    result = calibration.calibrate(rig, [still])
    names = {value.name for value in result.values if not value.determined}
    assert {f"{KNEE}.armature", f"{KNEE}.damping", "delay"} <= names


def test_what_a_log_does_not_tell_stays_as_the_robot_has_it(tmp_path):
    """A joint at rest under its weight tells the offset of its encoder, and nothing of the delay."""
    rng, truth = np.random.default_rng(12), {"delay": 0.009, f"{KNEE}.bias": 0.07}
    (tmp_path / "robot.xml").write_text(PENDULUM)
    u = np.full((1500, 1), 0.3)
    y = record(PENDULUM, truth, (KNEE,), u, TS, 1e-3, rng)
    rest = logs.RobotLog("rest", u[1000:], y[1000:], TS)
    rig = robot.read(tmp_path / "robot.xml", (KNEE,))
    result = calibration.calibrate(rig, [rest], names=("delay", "bias"))
    assert [value.name for value in result.values if value.determined] == [f"{KNEE}.bias"]
    assert abs(result[f"{KNEE}.bias"].value - 0.07) < 0.01
    writing.write(result, tmp_path)
    changes = (tmp_path / "changes.diff").read_text()
    assert "bias" in changes
    assert "delay=" not in changes
    table = tomllib.loads((tmp_path / "ranges.toml").read_text())
    row = next(row for row in table["parameter"] if row["name"] == "delay")
    assert (row["value"], row["determined"], "mean" in row) == (0.0, False, False)
    assert table["joint"]["names"] == [f"{KNEE}.bias"]


@pytest.mark.nightly
def test_lost_readings_and_spikes_are_left_out_and_named(folder, tmp_path):
    """Also in a log that is held out; a pulse that lasts is the joint's."""
    rig, columns = robot.read(folder / "robot.xml", (HIP, KNEE)), (COLUMNS[1], COLUMNS[3])
    for name in ("chirp.csv", "steps.csv"):
        lines = (folder / name).read_text().splitlines()
        cells = [line.split(",") for line in lines]
        for row, value in ((301, "200"), (801, "-90"), (900, "")):  # row 0 is the header
            cells[row][3] = value
        (tmp_path / name).write_text("\n".join(map(",".join, cells)))
    used, held = (logs.read(str(tmp_path / name), rig, *columns) for name in ("chirp.csv", "steps.csv"))
    result = calibration.calibrate(rig, [used], [held])
    for name, n in (("chirp.csv", 1500), ("steps.csv", 1000)):
        assert [text for text in result.remarks if text.startswith(name)] == [
            f"{name}: 1 of {n} readings of {HIP} are missing and were left out (row 900).",
            f"{name}: 2 of {n} readings of {HIP} leave their neighbours and come back at once, which no joint does, "
            "and were left out (rows 301, 801).",
        ]
    for name, truth in TRUTH.items():
        assert abs(result[name].value - truth) < max(0.02 * abs(truth), 3.0 * result[name].std), name
    assert max(run.rms("after") for run in result.runs) < 1.1e-3


def test_gains_and_a_play_are_found(folder):
    rng, truth = np.random.default_rng(3), {**TRUTH, "hip_servo.kp": 40.0}
    u = levels(rng, 2, 1500, 100)
    y = record(PENDULUM, truth, (HIP, KNEE), u, TS, 3e-4, rng)
    play = np.array([0.03, 0.0])
    for k in range(1, len(y)):
        y[k] = np.clip(y[k - 1], y[k] - play / 2, y[k] + play / 2)
    wrong = folder / "wrong.xml"
    wrong.write_text(PENDULUM.replace('kp="40"', 'kp="30"'))
    rig = robot.read(wrong, (HIP, KNEE))
    result = calibration.calibrate(
        rig,
        [logs.RobotLog("steps", u, y, TS)],
        names=("kp", "armature", "damping", "frictionloss", "delay", "bias", "backlash"),
    )
    assert abs(result["hip_servo.kp"].value / 40.0 - 1.0) < 0.02
    assert abs(result["hip_servo.backlash"].value / 0.03 - 1.0) < 0.1


@pytest.mark.nightly
def test_what_the_time_step_makes_of_the_values_is_told(folder):
    """The robot moves in steps a quarter as long; of an error of first order in the step three quarters are seen."""
    rng, t = np.random.default_rng(5), np.arange(1500) * TS
    u = np.column_stack([chirp(t), chirp(t, 0.3, 4.0, 0.6)])
    y = record(PENDULUM.replace("0.002", "0.0005"), TRUTH, (HIP, KNEE), u, TS, 1e-3, rng)
    result = calibration.calibrate(robot.read(folder / "robot.xml", (HIP, KNEE)), [logs.RobotLog("fine", u, y, TS)])
    for name in (f"{HIP}.armature", f"{KNEE}.armature", "delay"):
        value, truth = result[name], TRUTH[name]
        assert abs(value.value / truth - 1.0) > 0.03
        assert abs((value.value + 0.75 * (value.continuous - value.value)) / truth - 1.0) < 0.01, name
    assert any("2.00 ms" in text and "delay" in text for text in report.sentences(result))


@pytest.mark.nightly
def test_intervals_allow_for_a_play_that_is_not_calibrated(folder):
    """Without the functions of what the model lacks 4 of 9 hold."""
    rng, play = np.random.default_rng(11), np.array([0.01, 0.006])
    u = levels(rng, 2, 2000, 125, 0.5)
    y = record(PENDULUM, TRUTH, (HIP, KNEE), u, TS, 0.0, rng)
    for k in range(1, len(y)):
        y[k] = np.clip(y[k - 1], y[k] - play / 2, y[k] + play / 2)
    log = logs.RobotLog("play", u, y + 1e-3 * rng.standard_normal(y.shape), TS)
    result = calibration.calibrate(robot.read(folder / "robot.xml", (HIP, KNEE)), [log])
    assert np.mean([value.holds(TRUTH[value.name]) for value in result.values]) > 0.6
    assert min(value.learned for value in result.values) >= 0.0
    assert any("the robot does something that the model lacks" in text for text in report.sentences(result))
    following = advice.next_step(result, ["log.csv"], [], ["--model", "m.xml"], 0, folder)
    assert following.endswith("--free armature,damping,frictionloss,delay,bias,backlash")


@pytest.mark.nightly
def test_motors_in_other_units_with_lost_samples(folder):
    """A cart on springs with a pole: a slide and a hinge under forces, one of them through a gear."""
    rng, names = np.random.default_rng(5), ("cart", "pole")
    truth = {"cart.armature": 0.3, "cart.damping": 2.0, "cart.frictionloss": 1.5, "pole.armature": 0.02}
    truth |= {"pole.damping": 0.08, "pole.frictionloss": 0.05, "delay": 0.012, "cart.bias": 0.01, "pole.bias": 0.05}
    u = levels(rng, 2, 1500, 50, 1.0) * np.array([8.0, 1.2])
    y = record(CART, truth, names, u, TS, 5e-4, rng)
    y[700:720, 1] = np.nan
    (folder / "cart.xml").write_text(CART)
    result = calibration.calibrate(robot.read(folder / "cart.xml", names), [logs.RobotLog("forces", u, y, TS)])
    for name, value in truth.items():
        assert abs(result[name].value / value - 1.0) < 0.02 or result[name].holds(value), name
    assert (result["cart.damping"].unit, result["cart.bias"].unit) == ("N s/m", "m")


def test_a_search_that_is_stopped_says_so(folder):
    rig = robot.read(folder / "robot.xml", (HIP, KNEE))
    log = logs.read(str(folder / "steps.csv"), rig, COLUMNS[1], COLUMNS[3])
    result = calibration.calibrate(rig, [log], seconds=0.01)
    assert not result.optimum.stop.converged
    assert any("did not converge: limit of 0.01 s" in text for text in report.sentences(result))


def test_the_verb_writes_a_robot_and_says_what_it_is_good_for(verb):
    place, out, _ = verb
    number, sentence = out.splitlines()[:2]
    assert re.match(r"9\d\.\d\d % ● good: of steps.csv \(held out\) explained at ", number)
    assert sentence.startswith("9 of 9 values are determined; the error of the free run goes from")
    summary = json.loads((place / "out" / "summary.json").read_text())
    assert summary["usable"]
    for file in ("out/robot-calibrated.xml", "out/changes.diff", "out/ranges.toml"):
        assert file in [path.replace("\\", "/") for path in summary["files"]]
    assert summary["next"] in out
    assert summary["next"].endswith("python -m mujoco.viewer --mjcf=out/robot-calibrated.xml")
    mujoco.MjModel.from_xml_path(str(place / "out" / "robot-calibrated.xml"))


@pytest.mark.nightly
def test_the_next_command_runs(calibrated, folder, tmp_path, monkeypatch, capsys):
    """From one that is asked for to the next; logs to be recorded are there by then."""
    monkeypatch.chdir(tmp_path)
    for name, copy in (("robot.xml", "robot.xml"), ("chirp.csv", "chirp.csv"), ("steps.csv", "OTHER.csv")):
        shutil.copy(folder / name, copy)
    command = ["calibrate", "chirp.csv", "--model", "robot.xml", "--actuator", f"{HIP},{KNEE}", *COLUMNS]
    assert main([*command, "--out", "a"]) == 0
    following = json.loads((tmp_path / "a" / "summary.json").read_text())["next"]
    assert "OTHER.csv" in following
    words = shlex.split(following.rpartition(": ")[2])
    assert words[0] == "qpal"
    assert main([*words[1:], "--out", "b"]) == 0
    assert "mujoco.viewer" in capsys.readouterr().out
    result, _ = calibrated
    assert result.lacking is None

    def then(**changes):
        text = advice.next_step(
            replace(result, **changes), ["a.csv"], ["b/steps.csv"], ["--model", "m.xml"], 0, tmp_path
        )
        return shlex.split(text.rpartition(": ")[2])

    worse = tuple(replace(run, before=run.after, after=run.before) if run.held_out else run for run in result.runs)
    assert then(runs=worse) == ["qpal", "calibrate", "a.csv", "b/steps.csv", "--model", "m.xml"]
    unknown = tuple(replace(value, determined=False) for value in result.values)
    assert then(values=unknown)[2:4] == ["a.csv", "NEW.csv"]
    stuck = replace(result.optimum, stop=replace(result.optimum.stop, converged=False))
    assert then(optimum=stuck)[-2:] == ["--seed", "1"]


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"--actuator": "elbow"}, f"unknown actuator 'elbow'; choose one of {HIP}, {KNEE}"),
        ({"--actuator": ""}, f"give --actuator {HIP},{KNEE}"),
        ({"--actuator": f"{HIP},{HIP}"}, "named twice"),
        ({"--model": "none.xml"}, "is no file; give the MJCF of your robot"),
        ({"--model": "broken.xml"}, "MuJoCo does not load it"),
        ({"--model": "tendon.xml"}, f"actuator '{HIP}' drives a tendon"),
        ({"--input": None}, "which columns are the commands and positions"),
        ({"--input": "a,b"}, "'a'"),
        ({"--output": f"{HIP} angle [deg]"}, "1 output column(s) for 2 actuator(s)"),
        ({"--free": "mass"}, "unknown parameter 'mass'; choose one of armature, damping"),
        ({"--free": "gain"}, "is a position servo; free kp instead"),
        ({"--free": "damping,kv"}, "only their sum acts on a joint; free one of the two"),
        ({"--joint": "thigh"}, "--joint belongs to the leg"),
        ({"--model": None}, "--actuator belongs to a robot's MJCF"),
    ],
)
def test_what_cannot_be_calibrated_is_refused_in_a_sentence(change, said, folder, monkeypatch, capsys):
    monkeypatch.chdir(folder)
    (folder / "broken.xml").write_text("<mujoco><worldbody><body></mujoco>")
    cable = '<tendon><fixed name="cable"><joint joint="hip" coef="1"/></fixed></tendon><actuator>'
    text = PENDULUM.replace("<actuator>", cable).replace('"hip_servo" joint="hip"', '"hip_servo" tendon="cable"')
    (folder / "tendon.xml").write_text(text)
    options = {"--model": "robot.xml", "--actuator": f"{HIP},{KNEE}", "--input": COLUMNS[1], "--output": COLUMNS[3]}
    words = [word for pair in (options | change).items() if pair[1] is not None for word in pair]
    assert main(["calibrate", "chirp.csv", *words, "--out", "no"]) == 2
    err = capsys.readouterr().err
    assert said in err
    assert err.count("\n") == 1
    assert not (folder / "no").exists()


@pytest.mark.parametrize(
    ("scale", "heads", "said"),
    [
        ((1, -1), ("[rad]", "[deg]"), "set sign = -1"),
        (
            (1, np.pi / 180),
            ("[rad]", "[deg]"),
            'the position seems to be in rad: write the unit in its header, as in "po',
        ),
        ((1, 1), ("[rad]", ""), "the position seems to be in deg"),
        ((180 / np.pi, 1), ("[rad]", "[deg]"), "the command seems to be in deg"),
        ((1, 1), ("[deg]", "[deg]"), "the command seems to be in rad"),
    ],
)
def test_a_turned_sign_and_a_wrong_unit_are_refused_with_the_remedy(
    scale, heads, said, folder, tmp_path, monkeypatch, capfd
):
    """Nothing of MuJoCo or NumPy reaches the person, where the model cannot follow such commands either."""
    monkeypatch.chdir(tmp_path)
    table = np.loadtxt(folder / "chirp.csv", delimiter=",", skiprows=1) * np.array([1, scale[0], 1, scale[1], 1])
    head = f"time [s],a {heads[0]},b [rad],c {heads[1]},d [deg]"
    np.savetxt("log.csv", table, delimiter=",", comments="", header=head)
    (tmp_path / "robot.xml").write_text(PENDULUM)
    columns = ["--input", ",".join(head.split(",")[1:3]), "--output", ",".join(head.split(",")[3:])]
    command = ["calibrate", "log.csv", "--model", "robot.xml", "--actuator", f"{HIP},{KNEE}", "--out", "out"]
    assert main([*command, *columns]) == 2
    err = capfd.readouterr().err
    assert said in err
    assert err.count("\n") == 1
    assert sorted(path.name for path in tmp_path.iterdir()) == ["log.csv", "robot.xml"]
    if "sign" in said:  # the remedy works
        tables = "".join(
            f"[[{role}]]\ncolumn = {json.dumps(name)}\nsign = {sign}\n"
            for role, name, sign in zip(["input"] * 2 + ["output"] * 2, head.split(",")[1:], (1, 1, -1, 1), strict=True)
        )
        (tmp_path / "MAP.toml").write_text('[clock]\ncolumn = "time [s]"\n' + tables)
        assert main([*command, "--map", "MAP.toml"]) == 0


def test_a_wild_candidate_is_a_failed_run_and_says_nothing(folder, tmp_path, monkeypatch, capfd):
    monkeypatch.chdir(tmp_path)
    rig = simulation.Rig(rob := robot.read(folder / "robot.xml", (HIP, KNEE)), parameters(rob))
    assert all(np.isfinite(parameter.free.outer(1e4)) for parameter in rig.parameters)
    values = np.array([parameter.before for parameter in rig.parameters])
    y = simulation.free_run(rig, values, np.full((500, 2), 1e12), TS, np.zeros((3, 2)))
    assert not np.isfinite(y).any()
    assert capfd.readouterr().err == ""
    assert not list(tmp_path.iterdir())
