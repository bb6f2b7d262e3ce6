"""The whole quadruped: statics against virtual work, the plan against its own rules, and what the robot then does."""

import io
import json

import numpy as np
import pytest

from sysid.base.errors import InputError
from twin.cli import main
from twin.parameters import JOINTS, Parameters
from twin.plant.leg import LEGS, robot
from twin.report import crawl as report
from twin.robot import crawl
from twin.robot.gait import Gait, plan
from twin.robot.kinematics import body
from twin.robot.statics import Statics, stability_margin
from twin.robot.walk import drive, feedforward_references
from twin.view import pictures
from twin.view.stills import NoRenderer

pytestmark = pytest.mark.pixels

CYCLE = Gait(cycles=1)


@pytest.fixture(scope="module")
def made():
    return plan(CYCLE)


@pytest.fixture(scope="module")
def result():
    return crawl.run(CYCLE, standing=10.0, draws=1, seed=3)


def test_margin_is_the_distance_to_the_nearest_edge():
    square = np.array([[1.0, 1.0], [-1.0, 1.0], [-1.0, -1.0], [1.0, -1.0]])
    assert stability_margin(np.zeros(2), square) == pytest.approx(1.0)
    assert stability_margin(np.array([0.7, 0.1]), square) == pytest.approx(0.3)
    assert stability_margin(np.array([0.2, -0.2]), square[[0, 1, 2]]) == pytest.approx(-np.sqrt(0.08))
    assert stability_margin(np.zeros(2), square[:2]) == -np.inf


def test_loads_are_those_of_virtual_work():
    """Feet that stand still take no work from vertical forces: what the actuators give lifts the robot's weight."""
    p, model = Parameters(), robot()
    shape, statics = body(p, model), Statics(model, p)
    torso = np.array([0.01, -0.02, 0.40])
    feet = shape.feet(np.array([0.0, 0.0, 0.40]), np.tile(np.radians([5.0, 40.0, -15.0]), 4))
    weight = model.body_mass.sum() * p["gravity"]

    def at(step):
        angles = shape.angles(torso + step, feet)
        data = statics.pose(torso + step, angles)
        return angles, statics.travel(angles), weight * data.subtree_com[1, 2]

    for direction in np.eye(3):
        step = 1e-5 * direction
        (_, up, high), (_, down, low) = at(step), at(-step)
        loads = statics.loads(torso, at(0 * step)[0], np.ones(4, dtype=bool))
        if direction[2]:
            assert loads @ (up - down) == pytest.approx(high - low, rel=1e-6)
        else:  # sideways, vertical forces alone hold the body up
            assert loads @ (up - down) == pytest.approx(high - low, abs=1e-6 * weight * 1e-5)


def test_a_leg_in_the_air_hangs_on_its_thigh_actuator():
    """Its rod balances the weight of all that the thigh carries, each part at its reach from the thigh's axis."""
    p, model = Parameters(), robot()
    statics, angles = Statics(model, p), np.tile(np.radians([0.0, 40.0, -20.0]), 4)
    torso = np.array([0.0, 0.0, 0.4])
    load = statics.loads(torso, angles, np.array([True, True, True, False]))[10]  # front right thigh
    data = statics.pose(torso, angles)
    names = ("thigh_lever", "thigh", "shank_lever", "shank")
    carried = [model.body(f"{name}{LEGS['front_right']}").id for name in names]
    axis = data.body(f"thigh_lever{LEGS['front_right']}").xpos
    moment = p["gravity"] * model.body_mass[carried] @ np.abs(data.xipos[carried, 1] - axis[1])
    base, rod = p["thigh.base_radius"], p["thigh.rod_radius"]  # at right angles when the thigh is level
    arm = base * rod * np.cos(angles[1]) / np.sqrt(base**2 + rod**2 + 2 * base * rod * np.sin(angles[1]))
    assert load == pytest.approx(-moment / arm, rel=1e-6)


def test_what_stands_stands_still_and_the_body_moves_on_four_feet(made):
    shape = body(Parameters(), robot())
    assert made.advance == pytest.approx(CYCLE.stride)
    assert ((~made.stance).sum(axis=1) <= 1).all()
    moving = np.diff(made.feet, axis=0)
    assert np.abs(moving[made.stance[1:] & made.stance[:-1]]).max() < 1e-12
    body_moves = np.linalg.norm(np.diff(made.torso, axis=0), axis=1) > 1e-12
    assert made.stance[1:][body_moves].all()
    assert np.abs(shape.feet(made.torso, made.angles) - made.feet).max() < 1e-9
    for k in range(4):
        assert made.feet[:, k, 2].max() - made.feet[0, k, 2] == pytest.approx(CYCLE.lift, rel=0.02)
        assert made.feet[-1, k, 0] - made.feet[0, k, 0] == pytest.approx(CYCLE.stride)


def test_legs_step_in_the_order_of_a_creeping_gait(made):
    names = [name.replace(" ", "_") for _, name in made.moves]
    assert [name for name in names if name in LEGS] == ["rear_left", "front_left", "rear_right", "front_right"]


def test_no_actuator_is_asked_for_more_speed_than_its_load_leaves(made):
    """Force times speed against the motor's straight line: v <= (effort F0 - need) / (F0 / v0 + viscous)."""
    p, statics = Parameters(), Statics(robot(), Parameters())
    speed = np.abs(np.diff([statics.travel(row) for row in made.angles], axis=0)).max(axis=0) / made.Ts
    for k, joint in enumerate(JOINTS):
        stall = p[f"{joint}.stall_torque" if joint == "shoulder" else f"{joint}.stall_force"]
        free = (CYCLE.effort * stall - (1 - p[f"{joint}.asymmetry"]) * p[f"{joint}.coulomb"]) / (
            stall / p[f"{joint}.no_load_speed"] + p[f"{joint}.viscous"]
        )
        assert (speed[k::3] < 1.02 * free).all()  # rounding of the path to samples
        assert (made.need[k::3] < CYCLE.effort * stall).all()


def test_shaped_references_leave_a_joint_at_rest_alone(made):
    lead = feedforward_references(made) - made.angles
    rest = round(CYCLE.pause / made.Ts) - 1
    assert not lead[:rest].any()
    assert not lead[-2:].any()
    assert 0 < np.abs(lead).max() < np.radians(10)


@pytest.mark.parametrize(
    ("gait", "changes", "sentence"),
    [
        (Gait(cycles=1), {"thigh.stall_force": 100.0}, "actuator thigh_.. needs .* N and has 85 at 85 %"),
        (Gait(cycles=1, height=0.30), {}, "actuator shank_.. needs"),
        (Gait(cycles=1, height=0.50), {}, "out of the leg's reach|change the height of the body"),
        (Gait(cycles=1, stride=0.0, sway=0.0), {}, "the centre of mass is planned .* mm inside its support"),
    ],
)
def test_a_crawl_that_cannot_be_says_why(gait, changes, sentence):
    with pytest.raises(InputError, match=sentence):
        plan(gait, Parameters(changes))


@pytest.mark.parametrize(
    ("call", "sentence"),
    [
        (lambda: Gait(stride=0.5), "stride of the crawl is 0.5; give a value from 0 to 0.3"),
        (lambda: Gait(cycles=-1), "give a whole number from 0 to 100"),
        (lambda: crawl.cycles(6), "6 steps are not a whole number of cycles; give a multiple of 4"),
        (lambda: crawl.run(CYCLE, standing=0.0), "standing takes 0.0 s; give 1 to 3600 s"),
        (lambda: crawl.run(CYCLE, draws=-1), "give 0 to 1000"),
    ],
)
def test_a_wrong_number_is_refused_in_a_sentence(call, sentence):
    with pytest.raises(InputError, match=sentence):
        call()


def test_it_stands_with_power_and_without(result):
    s = result.standing
    assert s.seconds == 10.0
    assert s.sink < 0.005
    assert s.sink_unpowered < 0.001  # the screws lock themselves
    assert np.degrees(max(s.tilt, s.tilt_unpowered)) < 0.5


def test_it_crawls(result):
    m = result.measures
    assert result.holds, result.fault
    assert m.forward > 0.10  # of 0.12 m planned
    assert m.speed > 0.004
    assert m.margin > 0.010  # the centre of mass stays inside the triangle of the standing feet
    assert np.degrees(m.tilt) < 2.0
    assert abs(m.sideways) < 0.01
    assert abs(np.degrees(m.turn)) < 2.0
    assert m.slip < 0.008
    assert m.clearance > 0.015
    assert np.degrees(max(m.tracking)) < 1.5
    assert m.peak_voltage <= Parameters()["supply_voltage"]


def test_power_is_what_the_motors_equation_says(result):
    """Sum of V i, i = (V - K w) / R, from datasheet numbers: K = V0 / w0 and R = V0^2 / (F0 v0) at the output."""
    p, walk = Parameters(), result.walk
    total = np.zeros(len(walk.t))
    for k, joint in enumerate(JOINTS):
        rated, free = p[f"{joint}.rated_voltage"], p[f"{joint}.no_load_speed"]
        stall = p[f"{joint}.stall_torque" if joint == "shoulder" else f"{joint}.stall_force"]
        volts, speed = walk.volts[:, k::3], walk.speeds[:, k::3]
        total += np.maximum(volts * (volts - rated / free * speed) * stall * free / rated**2, 0).sum(axis=1)
    assert walk.electrical_power.sum(axis=1) == pytest.approx(total)
    assert result.measures.power == pytest.approx(total.mean())


def test_another_robot_walks_too(result):
    (trial,) = result.trials
    assert not trial.fault, trial.fault
    nominal = Parameters()
    assert {"torso_mass", "thigh.coulomb", "shank.load_friction"} <= set(trial.changes)
    assert all(abs(value / nominal[name] - 1) <= crawl.SPREAD + 1e-12 for name, value in trial.changes.items())
    assert result.rate[1] == 1.0


def test_a_robot_alone_does_what_it_does_among_others(made):
    short = feedforward_references(made)[:40]
    heavy = Parameters({"torso_mass": 5.0})
    one = drive([heavy], short, made.Ts, made.torso[0], [7])
    two = drive([Parameters(), heavy], short, made.Ts, made.torso[0], [1, 7], threads=2)
    assert np.array_equal(one[0].qpos, two[1].qpos)
    assert not np.array_equal(two[0].qpos, two[1].qpos)


def test_a_robot_without_power_has_not_walked(made, result):
    (walk,) = drive([Parameters()], made.angles, made.Ts, made.torso[0], [1], power=False)
    found = crawl.measure(made, walk)
    assert "it walked" in crawl.fault(made, found)
    assert "did not leave the floor" in crawl.fault(made, found)
    assert found.power == pytest.approx(0.0, abs=1e-6)


def test_the_report_says_it_in_words(result):
    page = report.page(result, "no renderer here")
    assert "The robot walked" in page.verdict[0]
    assert "no renderer here" in page.html()
    assert {picture.name for picture in page.pictures()} == {"path", "stability", "joints"}
    assert all(picture.png.startswith(b"\x89PNG") for picture in page.pictures())


def test_the_verb_writes_a_report_and_the_summary(tmp_path, monkeypatch, capsys):
    def nothing(*arguments):
        raise NoRenderer("not in this test")

    monkeypatch.setattr(pictures, "draw_robot", nothing)
    folder = tmp_path / "walk"
    options = ["--steps", "4", "--duration", "1", "--robots", "0", "--seed", "2", "--out", str(folder), "--json"]
    assert main(["crawl", *options]) == 0
    summary = json.loads(capsys.readouterr().out)
    assert summary == json.loads((folder / "summary.json").read_text(encoding="utf-8"))
    assert summary["holds"] is True
    assert summary["crawl"]["forward"] > 0.1
    assert "not in this test" in (folder / "report.html").read_text(encoding="utf-8")


def test_the_shares_of_the_progress_are_the_seconds_that_are_simulated():
    walk, standing, robots = crawl.shares(2, 30.0, 12)
    assert walk == pytest.approx(plan(Gait(cycles=2)).t[-1], rel=0.1)
    assert (standing, robots) == (60.0, 12 * walk)


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--steps", "4000"], "the crawl has 1000 cycles; give a whole number from 0 to 100"),
        (["--duration", "1e9"], "standing takes 1000000000.0 s; give 1 to 3600 s"),
        (["--robots", "1001"], "the number of other robots is 1001; give 0 to 1000"),
    ],
)
def test_a_crawl_without_end_is_refused(words, said, tmp_path, capsys):
    assert main(["crawl", *words, "--out", str(tmp_path / "walk")]) == 2
    assert said in capsys.readouterr().err


def test_the_verb_refuses_half_a_cycle(tmp_path, capsys):
    assert main(["crawl", "--steps", "6", "--out", str(tmp_path / "walk")]) == 2
    assert "6 steps are not a whole number of cycles" in capsys.readouterr().err
    assert not list(tmp_path.iterdir())


def test_the_film_is_an_animation_and_the_strip_a_picture():
    from PIL import Image

    rng = np.random.default_rng(0)
    stills = [(f"picture {k}", float(k), rng.integers(0, 255, (36, 48, 3), dtype=np.uint8)) for k in range(4)]
    frames = [rng.integers(0, 255, (30, 40, 3), dtype=np.uint8) for _ in range(5)]
    seen = pictures.CrawlPictures(stills, frames, 4.0)
    with Image.open(io.BytesIO(report.film(seen))) as film:
        assert film.n_frames == 5
        assert film.size == (40, 30)
    assert report.style.png(report.strip(seen)).startswith(b"\x89PNG")
