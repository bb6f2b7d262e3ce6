"""A replayed leg stands where the record says, its ghost too, and the pictures show it."""

import sys
from contextlib import nullcontext
from types import SimpleNamespace

import mujoco
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sysid.base.errors import InputError
from twin import JOINTS, Log, Parameters
from twin.hardware.linkage import end_angles, linkage, middle, stroke
from twin.plant.leg import BENCH_LEG, LEGS
from twin.view.pictures import standing_robot
from twin.view.replay import GHOST_LEG, Movement, Replay, moment, movement
from twin.view.stills import NoRenderer, cylinders, draw, draw_robot, mid_stroke
from twin.view.viewer import Clock, simulate, window

T = np.arange(40) * 0.1
OTHER = Parameters({"thigh.base_radius": 0.11, "thigh.stroke": 0.05})  # a leg with other pins


def between_ends(joint: str, seed: int, parameters: Parameters | None = None) -> np.ndarray:
    return np.random.default_rng(seed).uniform(*end_angles(parameters or Parameters(), joint), len(T))


def posed(replay: Replay, time: float) -> mujoco.MjData:
    data = mujoco.MjData(replay.model)
    data.qpos[:] = replay.pose(time)
    mujoco.mj_fwdPosition(replay.model, data)
    return data


@pytest.mark.parametrize("joint", ["thigh", "shank"])
@pytest.mark.parametrize("parameters", [Parameters(), OTHER], ids=["nominal", "other pins"])
def test_pin_to_pin_length_is_the_closed_form_at_every_sample(joint, parameters):
    leg, ghost = between_ends(joint, 1, parameters), between_ends(joint, 2, parameters)
    replay = Replay(Movement(T, {joint: leg}), Movement(T, {joint: ghost}), parameters)
    closed = linkage(parameters, joint)
    for k, time in enumerate(T):
        data = posed(replay, time)
        assert data.tendon(joint + BENCH_LEG).length[0] == pytest.approx(closed.length(leg[k]), abs=1e-12)
        assert data.tendon(joint + GHOST_LEG).length[0] == pytest.approx(closed.length(ghost[k]), abs=1e-12)


def test_the_shoulder_turns_the_whole_leg_about_its_axis():
    angle = between_ends("shoulder", 3)
    replay = Replay(Movement(T, {"shoulder": angle}))
    feet = np.array([posed(replay, time).site("foot" + BENCH_LEG).xpos - np.array([0.18, 0.105, 0]) for time in T])
    turned = np.arctan2(feet[:, 1], feet[:, 0]) - np.pi / 2  # the leg points to the left at angle 0
    np.testing.assert_allclose(turned, angle, atol=1e-12)


def test_three_joints_move_at_once_and_others_stand_at_mid_stroke():
    angles = {joint: between_ends(joint, k) for k, joint in enumerate(JOINTS)}
    log = Log(np.zeros((len(T), 3)), np.column_stack([angles[joint] for joint in JOINTS]), 0.1)
    whole, one = Replay(movement(log)), Replay(movement(log, "thigh"))
    for k in (0, 17, 39):
        pose, alone = whole.pose(T[k]), one.pose(T[k])
        for joint in JOINTS:
            at = whole.model.joint(joint + BENCH_LEG).qposadr[0]
            assert pose[at] == pytest.approx(angles[joint][k], abs=1e-12)
            rest = angles[joint][k] if joint == "thigh" else middle(Parameters(), joint)
            assert alone[at] == pytest.approx(rest, abs=1e-12)


def test_ghost_and_leg_coincide_for_one_log_and_part_for_two():
    same, other = Movement(T, {"thigh": between_ends("thigh", 5)}), Movement(T, {"thigh": between_ends("thigh", 6)})
    for ghost, together in ((same, True), (other, False)):
        replay = Replay(same, ghost)
        for time in (0.0, 1.23, 3.9):
            data = posed(replay, time)
            names = [replay.model.body(k).name for k in range(replay.model.nbody)]
            pairs = [(name, name.replace(BENCH_LEG, GHOST_LEG)) for name in names if name.endswith(BENCH_LEG)]
            assert len(pairs) >= 6
            gap = max(float(np.abs(data.body(a).xpos - data.body(b).xpos).max()) for a, b in pairs)
            assert (gap < 1e-12) == together


def test_between_samples_straight_over_gaps_and_held_at_the_ends():
    leg = Movement(np.array([0.0, 1.0, 2.0, 3.0]), {"thigh": np.array([0.0, 0.2, np.nan, 0.6])})
    for time, angle in ((0.5, 0.1), (1.0, 0.2), (2.0, 0.4), (2.5, 0.5), (-1.0, 0.0), (9.0, 0.6)):
        assert leg.angles_at(time)["thigh"] == pytest.approx(angle, abs=1e-12)


def test_a_part_starts_and_ends_where_it_is_told():
    leg = Movement(T, {"thigh": T / 10})
    part = Replay(leg, start=1.0, stop=3.0)
    at = part.model.joint("thigh" + BENCH_LEG).qposadr[0]
    assert part.length == pytest.approx(2.0)
    assert part.pose(0.0)[at] == pytest.approx(0.1)
    assert part.pose(part.length)[at] == pytest.approx(0.3)
    assert Replay(leg).length == pytest.approx(3.9)
    assert Replay(leg, Movement(2 * T, {"thigh": T})).length == pytest.approx(7.8)  # the longer one


@pytest.mark.parametrize(
    ("wall", "length", "speed", "shown"),
    [
        (0.0, 10.0, 1.0, 0.0),
        (4.0, 10.0, 1.0, 4.0),
        (4.0, 10.0, 2.0, 8.0),
        (4.0, 10.0, 0.5, 2.0),
        (5.5, 10.0, 2.0, 10.0),  # rests at the end for a second of the wall clock
        (6.25, 10.0, 2.0, 0.5),  # and again
        (-1.0, 10.0, 1.0, 0.0),
    ],
)
def test_wall_time_to_log_time(wall, length, speed, shown):
    assert moment(wall, length, speed, rest=1.0) == pytest.approx(shown, abs=1e-12)


@given(st.floats(0, 1e4), st.floats(0.1, 1e3), st.floats(0.01, 100))
def test_a_replay_stays_inside_the_record_and_repeats(wall, length, speed):
    shown = moment(wall, length, speed)
    assert 0 <= shown <= length
    again = moment(wall + length / speed + 1.0, length, speed)
    gap = abs(again - shown)
    assert min(gap, length - gap) <= 1e-6 * (length + speed * (wall + 1))  # the same, or the other side of the restart


def test_the_clock_stands_still_in_a_pause():
    clock = Clock()
    passed = [clock.tick(100.0), clock.tick(100.5)]
    clock.key(ord("x"))
    clock.key(ord(" "))
    passed.append(clock.tick(107.0))
    clock.key(ord(" "))
    passed.append(clock.tick(107.25))
    assert passed == [0.0, 0.5, 0.0, 0.25]
    assert clock.wall == 0.75


@pytest.mark.parametrize("end", [0, 1])
@pytest.mark.parametrize("joint", ["thigh", "shank"])
def test_cylinders_lie_on_the_line_of_the_pins_and_leave_rod_to_see(joint, end):
    angle = end_angles(Parameters(), joint)[end]
    replay = Replay(Movement(T, {joint: np.full(len(T), angle)}))
    data = posed(replay, 0.0)
    base, rod = data.site(f"{joint}_base{BENCH_LEG}").xpos, data.site(f"{joint}_rod{BENCH_LEG}").xpos
    mine = [part for part in cylinders(replay.model, data) if np.allclose(part.start, base, atol=1e-9)]
    assert len(mine) == 2
    for part in mine:
        reach = np.linalg.norm(part.stop - base)
        np.testing.assert_allclose(np.cross(part.stop - base, rod - base), 0, atol=1e-12)
        assert reach < stroke(Parameters(), joint)[0]


@pytest.mark.parametrize(
    ("ghost", "legs"), [(None, 1), (Movement(T, {"thigh": T / 10}), 2)], ids=["one leg", "two legs"]
)
def test_only_the_legs_that_are_shown_have_cylinders(ghost, legs):
    replay = Replay(Movement(T, {"thigh": T / 10}), ghost)
    assert len(list(cylinders(replay.model, posed(replay, 1.0)))) == 4 * legs
    colours = {tuple(part.colour) for part in cylinders(replay.model, posed(replay, 1.0))}
    assert len(colours) == legs


@pytest.mark.parametrize(
    ("make", "said"),
    [
        (lambda: movement(Log(T, T, 0.1)), "does not name the joint"),
        (lambda: movement(Log(T, T, 0.1, joint="thigh"), "shank"), "leave --joint out"),
        (lambda: movement(Log(T, T, 0.1), "knee"), "shoulder, thigh, shank"),
        (lambda: Movement(T, {}), "no joint"),
        (lambda: Movement(T, {"thigh": T[1:]}), "one angle for each time"),
        (lambda: Movement(T, {"thigh": T * np.nan}), "no finite angle"),
        (lambda: Replay(Movement(T, {"thigh": T}), start=2.0, stop=1.0), "start before the stop"),
        (lambda: Replay(Movement(T, {"thigh": T}), stop=5.0), "goes from 0 to 3.9 s"),
        (lambda: draw_robot(np.zeros((2, 3))), "shape"),
        (lambda: draw_robot(np.full(31, np.nan)), "finite"),
        (lambda: draw_robot(mid_stroke(Replay(Movement(T, {"thigh": T})).model, Parameters()), {"zoom": 2}), "lookat"),
        (lambda: draw_robot(Replay(Movement(T, {"thigh": T})).pose(0.0), size=(5000, 100)), "5000 x 100"),
    ],
)
def test_what_cannot_be_shown_is_said_in_a_sentence(make, said):
    with pytest.raises(InputError, match=said):
        make()


def test_pictures_show_the_ghost_only_where_it_parts_from_the_leg():
    leg = Movement(T, {"thigh": between_ends("thigh", 7)})
    away = Movement(T, {"thigh": leg.angles["thigh"] + 0.3})
    pictures = []
    try:
        for ghost in (None, leg, away):
            replay = Replay(leg, ghost)
            pictures += draw(replay.model, replay.pose(0.0)[None], [replay.camera()], stand=True, size=(320, 240))
    except NoRenderer as reason:
        pytest.skip(str(reason))
    alone, hidden, apart = (picture.astype(int) for picture in pictures)
    assert alone.shape == (240, 320, 3)
    changed = [np.mean(np.abs(picture - alone).max(axis=2) > 40) for picture in (hidden, apart)]
    assert changed[0] < 0.002 < 0.01 < changed[1]


def test_a_camera_that_follows_sees_a_walking_robot_in_one_place():
    model = Replay(Movement(T, {"thigh": T})).model  # the other legs are hidden: no matter here
    here = mid_stroke(model, Parameters())
    away = here.copy()
    away[0] += 0.4  # two tiles of the floor, whose pattern repeats
    try:
        fixed = draw_robot(np.array([here, away]), model=model, size=(320, 240))
        follow = draw_robot(np.array([here, away]), {"follow": True}, model, (320, 240))
    except NoRenderer as reason:
        pytest.skip(str(reason))
    moved = [np.mean(np.abs(a.astype(int) - b).max(axis=2) > 40) for a, b in (fixed, follow)]
    assert moved[1] < 0.5 * moved[0]


def test_mid_stroke_is_half_of_every_actuators_travel():
    replay = Replay(Movement(T, {"thigh": T}))
    data = mujoco.MjData(replay.model)
    data.qpos[:] = mid_stroke(replay.model, Parameters())
    mujoco.mj_fwdPosition(replay.model, data)
    for suffix in LEGS.values():
        for joint in ("thigh", "shank"):
            assert data.tendon(joint + suffix).length[0] == pytest.approx(np.mean(stroke(Parameters(), joint)))


def test_the_robot_of_the_viewer_stands_unpowered_and_moves_at_rated_voltage():
    model, pose = standing_robot()
    data = mujoco.MjData(model)
    data.qpos[:] = pose
    for _ in range(20):
        simulate(model, data, 0.1)
    assert data.time == pytest.approx(2.0)
    height, upright = data.body("torso").xpos[2], data.body("torso").xmat[8]
    assert height == pytest.approx(pose[2], abs=0.03)
    assert upright > np.cos(np.deg2rad(3))
    before = data.joint("shank" + BENCH_LEG).qpos[0]
    data.actuator("shank" + BENCH_LEG).ctrl[0] = model.actuator("shank" + BENCH_LEG).ctrlrange[1]
    for _ in range(10):
        simulate(model, data, 0.1)
    assert data.joint("shank" + BENCH_LEG).qpos[0] - before > np.deg2rad(2)


class FakeWindow:
    """Takes what MuJoCo's window takes, for five frames."""

    def __init__(self, model, data, **options):
        self.data, self.cam, self.user_scn = data, mujoco.MjvCamera(), mujoco.MjvScene(model, 100)
        self.seen: list[tuple[float, int]] = []

    def __enter__(self):
        return self

    def __exit__(self, *error):
        return None

    def is_running(self):
        return len(self.seen) < 5

    def lock(self):
        return nullcontext()

    def sync(self):
        self.seen.append((self.data.time, self.user_scn.ngeom))


@pytest.mark.parametrize(
    ("replay", "cylinders_and_column"),
    [(None, 16), (Replay(Movement(T, {"thigh": T / 10}), start=1.0), 4 + 2)],
    ids=["robot", "log"],
)
def test_the_window_gets_moving_poses_and_every_cylinder(replay, cylinders_and_column, monkeypatch):
    opened = []

    def launch_passive(*arguments, **options):
        opened.append(FakeWindow(*arguments, **options))
        return opened[0]

    monkeypatch.setitem(sys.modules, "mujoco.viewer", SimpleNamespace(launch_passive=launch_passive))
    monkeypatch.setattr(mujoco, "viewer", sys.modules["mujoco.viewer"], raising=False)
    window(replay, speed=2.0)
    times, parts = zip(*opened[0].seen, strict=True)
    assert set(parts) == {cylinders_and_column}
    assert list(times) == sorted(times)
    assert times[0] == (0.0 if replay is None else 1.0)
    assert times[-1] > times[0]
