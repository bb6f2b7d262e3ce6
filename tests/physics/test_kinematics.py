"""Leg kinematics in closed form, against MuJoCo's and against what a ruler says."""

import mujoco
import numpy as np
import pytest

from sysid.base.errors import InputError
from twin.hardware.linkage import end_angles
from twin.parameters import JOINTS, Parameters
from twin.plant.leg import LEGS, robot
from twin.robot.kinematics import body

EXACT = 1e-9  # [m or rad]


@pytest.fixture(scope="module")
def model():
    return robot()


@pytest.fixture(scope="module")
def shape(model):
    return body(Parameters(), model)


def everywhere(shape, rng) -> np.ndarray:
    """Joint angles (n, 3) [rad] all over the travel: a grid that holds every end, and random ones."""
    ends = zip(shape.leg.lower, shape.leg.upper, strict=True)
    grid = np.stack(np.meshgrid(*(np.linspace(low, high, 9) for low, high in ends)), axis=-1).reshape(-1, 3)
    return np.concatenate([grid, rng.uniform(shape.leg.lower, shape.leg.upper, (1000, 3))])


def test_lengths_and_travel_are_those_of_the_model(shape):
    assert (shape.leg.hip, shape.leg.thigh, shape.leg.shank) == pytest.approx((0.06, 0.24, 0.24))
    for k, joint in enumerate(JOINTS):
        assert (shape.leg.lower[k], shape.leg.upper[k]) == end_angles(Parameters(), joint)


@pytest.mark.parametrize(
    ("degrees", "foot"),
    [
        ((0, 0, 0), (0.30, 0, -0.24)),  # thigh level, shank down
        ((30, 0, 0), (0.30 * np.cos(np.pi / 6), 0.15, -0.24)),
        ((0, 45, -45), (0.06 + 0.24 / np.sqrt(2), 0, -0.24 - 0.24 / np.sqrt(2))),  # shank straight down again
        ((0, 30, 0), (0.06 + 0.24 * np.sqrt(3) / 2 - 0.12, 0, -0.12 - 0.24 * np.sqrt(3) / 2)),
    ],
)
def test_foot_at_angles_that_can_be_drawn_with_a_ruler(shape, degrees, foot):
    assert shape.leg.foot(np.radians(degrees)) == pytest.approx(foot, abs=EXACT)


def test_angles_and_feet_are_inverse_all_over_the_travel(shape):
    angles = everywhere(shape, np.random.default_rng(0))
    assert np.abs(shape.leg.angles(shape.leg.foot(angles)) - angles).max() < EXACT


def test_feet_are_where_mujoco_has_them(model, shape):
    rng = np.random.default_rng(1)
    data = mujoco.MjData(model)
    hinges = [int(model.joint(model.actuator(k).name).qposadr[0]) for k in range(model.nu)]
    legs = everywhere(shape, rng)
    for _ in range(500):
        angles, torso = legs[rng.integers(len(legs), size=4)].ravel(), rng.uniform(-1, 1, 3)
        data.qpos[:3], data.qpos[hinges] = torso, angles
        mujoco.mj_kinematics(model, data)
        feet = np.array([data.site(f"foot{suffix}").xpos for suffix in LEGS.values()])
        assert np.abs(shape.feet(torso, angles) - feet).max() < EXACT
        assert np.abs(shape.angles(torso, feet) - angles).max() < EXACT


def test_rows_of_many_poses_are_those_of_each(shape):
    rng = np.random.default_rng(2)
    angles, torso = np.tile(everywhere(shape, rng)[:40], (1, 4)), rng.uniform(-1, 1, (40, 3))
    feet = shape.feet(torso, angles)
    assert feet.shape == (40, 4, 3)
    assert np.array_equal(feet[7], shape.feet(torso[7], angles[7]))
    assert shape.angles(torso, feet) == pytest.approx(angles, abs=EXACT)


@pytest.mark.parametrize(
    ("foot", "sentence"),
    [
        ((0.16, 0.0, -0.55), "out of the leg's reach; keep it between 0.000 and 0.480 m from the thigh's axis"),
        ((0.06, 0.0, -0.42), "needs the thigh at .* deg; its travel is -10.1 to 49.6 deg"),
        ((0.10, 0.20, -0.35), "needs the shoulder at 63.4 deg; its travel is -35.0 to 35.0 deg"),
        ((0.16, 0.0, -0.10), "needs the .* change the height of the body"),
    ],
)
def test_a_foot_out_of_reach_is_refused_in_a_sentence(shape, foot, sentence):
    with pytest.raises(InputError, match=sentence):
        shape.leg.angles(np.array([[0.16, 0.0, -0.39], foot]))
