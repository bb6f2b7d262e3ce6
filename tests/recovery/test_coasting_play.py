"""A link that coasts in its play: against small time steps, against a play without inertia, and against the twin."""

from itertools import pairwise

import mujoco
import numpy as np
import pytest
from often import often

import twin
from sysid.blocks import CoastingPlay, Play
from twin.plant.leg import bench
from twin.truth import link_inertia

STEPS = 500  # a sample of the drive, in the runs that the block is held against
FAST, SLOW, CREEP = 1.0, 0.31, 0.02  # speeds of the drives, in y a sample


def through(block: Play | CoastingPlay, theta: list[float], x: np.ndarray) -> np.ndarray:
    """x (N,) through a block with parameters theta."""
    return block.propagate(np.array(theta, dtype=float), np.ascontiguousarray(x), np.empty((len(x), 0)), 0)


def in_small_steps(theta: list[float], x: np.ndarray) -> tuple[np.ndarray, int]:
    """The link (N,) by STEPS steps a sample, and how often it met a side that its own motion would leave again.

    Newton's law with dry friction, held by the sides of the play wherever it would go through them.
    """
    width, rest, drag, pull0, pull1 = theta
    place, speed, loose = x[0] + rest * width, 0.0, 0
    shown = [place]
    for before, after in pairwise(x):
        for k in range(1, STEPS + 1):
            force = -(pull0 + pull1 * place)
            if speed != 0.0 or abs(force) > drag:
                sign = np.sign(speed) if speed != 0.0 else np.sign(force)
                new = speed + (force - drag * sign) / STEPS
                new = 0.0 if new * sign < 0.0 else new
                place, speed = place + 0.5 * (speed + new) / STEPS, new
            drive = before + (after - before) * k / STEPS
            if abs(place - drive) > 0.5 * width:
                side = np.sign(place - drive)
                place, speed = drive + 0.5 * side * width, after - before
                loose += side * free_acceleration(speed, force, drag) < 0.0
        shown.append(place)
    return np.array(shown), loose


def free_acceleration(speed: float, force: float, drag: float) -> float:
    """Acceleration of a link that nothing touches."""
    return force - drag * np.sign(speed) if speed != 0.0 else np.sign(force) * max(abs(force) - drag, 0.0)


def drive(seed: int, settled: int) -> np.ndarray:
    """A drive (N,) that goes, turns about, creeps and stops; after every stop it stands for `settled` samples."""
    rng = np.random.default_rng([seed, 5])
    speeds = [0.0]
    for _ in range(6):
        fast, back = rng.choice([FAST, SLOW]), rng.choice([-1.0, 1.0])
        # It never slows down without a stop: a link that catches up with a drive leaves its far side again.
        for speed, least in ((back * fast, 3), (-back * fast, 3), (0.0, settled), (back * CREEP, 20)):
            speeds += [speed] * int(rng.integers(least, least + 10))
    return np.cumsum(speeds)


def careless_drive(seed: int) -> np.ndarray:
    """A drive (N,) that goes on at any speed after any other."""
    rng = np.random.default_rng([seed, 6])
    speeds = np.array([0.0, FAST, -FAST, SLOW, -SLOW, CREEP, -CREEP])
    return np.cumsum(np.repeat(rng.choice(speeds, 25), rng.integers(5, 20, 25)))


# width, rest, drag, pull0, pull1
FREE = {
    "narrow": [0.5, 0.2, 0.0437, 0.0, 0.0],
    "one that stops it in a sample or two": [0.5, -0.4, 0.77, 0.0, 0.0],
    "wide": [7.0, 0.1, 0.0437, 0.0, 0.0],
    "held against its weight": [1.3, 0.5, 0.09, 0.06, 0.0],
}


@pytest.mark.parametrize("seed", often(3, 1))
@pytest.mark.parametrize("case", FREE)
def test_a_link_that_its_drag_brings_to_rest_is_where_small_steps_put_it(case: str, seed: int) -> None:
    theta = FREE[case]
    x = drive(seed, settled=60)
    expected, loose = in_small_steps(theta, x)
    assert loose == 0
    # A step in which the link comes to rest puts it off by rate / (8 STEPS^2) at most, until a side takes it along.
    rate = theta[2] + abs(theta[3])
    np.testing.assert_allclose(through(CoastingPlay(), theta, x), expected, rtol=0, atol=rate / STEPS**2 / 8 + 1e-11)


@pytest.mark.parametrize("seed", often(3, 1))
@pytest.mark.parametrize("pull", [0.3, -0.3])
def test_a_link_that_is_thrown_and_falls_back_is_where_small_steps_put_it(pull: float, seed: int) -> None:
    theta = [10.0, -0.5 * np.sign(pull), 0.05, pull, 0.0]  # so wide that it never reaches the other side
    x = drive(seed, settled=60)
    expected, loose = in_small_steps(theta, x)
    assert loose == 0
    # Small steps turn in the air one step late at most: one step's way at the greatest speed of the fall that follows.
    greatest = np.abs(np.diff(expected)).max() + abs(pull)
    shown = through(CoastingPlay(), theta, x)
    np.testing.assert_allclose(shown, expected, rtol=0, atol=greatest / STEPS)
    assert np.ptp(shown - x) > 0.5  # it is thrown


CARELESS = {
    "drag": [0.5, 0.2, 0.05, 0.0, 0.0],
    "drag and less weight": [0.5, 0.0, 0.05, 0.02, 0.0],
    "drag and more weight": [0.5, 0.0, 0.02, 0.05, 0.0],
    "a link that hangs": [0.5, 0.0, 0.05, 0.0, 0.01],
    "a link that stands on its head": [0.5, 0.0, 0.02, -0.3, -0.05],
}


@pytest.mark.parametrize("seed", often(3, 1))
@pytest.mark.parametrize("case", CARELESS)
def test_any_link_under_any_drive_is_off_by_one_samples_way_at_most(case: str, seed: int) -> None:
    """The block looks at the sides at its samples only, and takes the pull of a sample's start: both vanish with it."""
    width, rest, drag, pull0, pull1 = CARELESS[case]
    x = careless_drive(seed)
    expected, _ = in_small_steps(CARELESS[case], x)
    closing = np.abs(np.diff(x, 2)).max()  # greatest speed of the drive towards a link that it has let go
    for finer in (1, 4, 16, 64):
        times = np.arange(finer * (len(x) - 1) + 1) / finer
        theta = [width, rest, drag / finer**2, pull0 / finer**2, pull1 / finer**2]
        fine = np.interp(times, np.arange(len(x)), x)
        y = through(CoastingPlay(), theta, fine)
        assert np.abs(y[::finer] - expected).max() <= min(width, closing / finer) + 2 * closing / STEPS
        assert np.abs(y - fine).max() <= 0.5 * width * (1 + 1e-9)


@pytest.mark.parametrize("width", [0.0, 0.1, 2.0])
def test_much_drag_and_no_pull_make_a_play_without_inertia(width: float) -> None:
    x = careless_drive(4)
    coast = FAST**2 / (2 * 1e12)  # speed^2 / (2 drag): how far the link still gets
    plain = through(Play(), [width, 0.3], x)
    np.testing.assert_allclose(through(CoastingPlay(), [width, 0.3, 1e12, 0.0, 0.0], x), plain, rtol=0, atol=2 * coast)


def test_a_link_that_nothing_brakes_goes_on_until_the_other_side_meets_it() -> None:
    x = np.concatenate([np.arange(5.0), np.full(10, 4.0)])
    y = through(CoastingPlay(), [2.5, 0.5, 0.0, 0.0, 0.0], x)
    # It waits while the drive crosses the play, is pushed from behind, and coasts to the far side when the drive stops.
    np.testing.assert_allclose(y, [1.25, 1.25, 1.25, 1.75, 2.75, 3.75, 4.75, *[5.25] * 8])


def test_a_pull_that_drag_holds_moves_nothing_and_one_beyond_it_falls_as_a_parabola() -> None:
    x = np.zeros(12)
    held = through(CoastingPlay(), [100.0, 0.0, 0.2, 0.2, 0.0], x)
    np.testing.assert_array_equal(held, 0.0)
    falls = through(CoastingPlay(), [100.0, 0.0, 0.2, 0.7, 0.0], x)
    np.testing.assert_allclose(falls, -0.5 * (0.7 - 0.2) * np.arange(12) ** 2, atol=1e-12)


@pytest.fixture(scope="module", params=[1, 2, 3])
def sides(request: pytest.FixtureRequest) -> tuple[np.ndarray, np.ndarray]:
    """Drive side and link [rad] of the twin's shoulder under one drawn sweep."""
    logs = [
        twin.Experiment(
            "shoulder",
            duration=125.0,
            seed=request.param,
            without=("noise", "adc", "jitter", "dropouts", "nonlinearity"),
            options={"half_period": 2.5, "jitter": 0.5, "shrink": 0.6},
            pot_side=side,
        ).run()
        for side in ("drive", "link")
    ]
    assert np.array_equal(logs[0].u, logs[1].u)
    return logs[0].y, logs[1].y


def physical_drag(Ts: float) -> float:
    """Deceleration [rad/sample^2] of the shoulder's free link: its bearing's friction over its inertia."""
    model = bench("shoulder")
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    return twin.Parameters()["shoulder.bearing_coulomb"] / link_inertia("shoulder", model, data) * Ts**2


def test_the_twins_link_follows_from_its_drive_side_and_physics_alone(sides: tuple[np.ndarray, np.ndarray]) -> None:
    x, y = sides
    width = twin.truth("shoulder").backlash

    def off(run: np.ndarray) -> float:
        return float(np.rad2deg(np.sqrt(np.mean((run - y) ** 2))))

    # All but nothing and all that the bearing has: the drive leaves most links no time to come to rest.
    for drag in (0.0003, 0.003, physical_drag(0.1)):
        assert off(through(CoastingPlay(), [width, 0.0, drag, 0.0, 0.0], x)) < 0.08
    assert off(through(Play(), [width, 0.0], x)) > 0.3
