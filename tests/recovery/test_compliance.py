"""A link on a spring, and angles that wrap at a turn, against independent solutions."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import sysid
from sysid import IOData
from sysid.base.errors import InputError
from sysid.blocks import Compliance, Wrap
from sysid.data.wraps import unwrapped


@pytest.mark.parametrize("omega", [0.05, 0.9, 6.0])
@pytest.mark.parametrize("damping", [0.0, 0.15, 1.0 - 1e-5, 1.0, 1.0 + 1e-5, 4.0])
def test_the_link_moves_as_an_adaptive_integration_says(omega, damping):
    rng = np.random.default_rng(1)
    x = np.cumsum(rng.normal(size=40))
    n = np.arange(len(x))

    def rate(t, s):
        return s[1], omega**2 * (np.interp(t, n, x) - s[0]) - 2.0 * damping * omega * s[1]

    state, expected = np.array([x[0] + 0.3, -0.2]), [x[0] + 0.3]
    for k in n[:-1]:  # sample by sample: the drive has a kink at each
        done = solve_ivp(rate, (k, k + 1), state, method="DOP853", rtol=1e-11, atol=1e-12)
        state = done.y[:, -1]
        expected.append(state[0])
    y = Compliance().output(np.array([omega, damping, 0.3, -0.2]), x)
    np.testing.assert_allclose(y, expected, rtol=0, atol=1e-8)


def test_a_stiff_link_is_its_drive():
    x = np.sin(np.arange(200) / 10.0)
    y = Compliance().output(np.array([30.0, 1.0, 0.0, 0.0]), x)
    np.testing.assert_allclose(y[5:], x[5:], atol=2.0 / 30.0 * 0.1 * 1.1)  # it follows 2 damping / omega samples late


def test_a_wrapped_sensor_shows_the_angle_within_its_turn():
    x = np.linspace(-700.0, 900.0, 401)
    y = Wrap(360.0, -180.0).output(np.empty(0), x)
    np.testing.assert_allclose(y, np.mod(x + 180.0, 360.0) - 180.0, atol=1e-9)
    assert -180.0 <= y.min() < y.max() < 180.0
    with pytest.raises(InputError, match="360"):
        Wrap(0.0)


def swings(seed, N=600):
    """An angle [turns] that goes over several turns both ways, by less than 0.3 turns a sample."""
    speeds = np.repeat(np.random.default_rng(seed).uniform(-0.25, 0.25, N // 20), 20)
    return np.cumsum(speeds)


@pytest.mark.parametrize("turn", [360.0, 2.0 * np.pi, 4096.0])
def test_wraps_are_found_without_being_asked_for_and_undone(turn):
    for seed in range(10):
        angle = turn * swings(seed)
        shown = np.mod(angle, turn)
        found = unwrapped(IOData(np.zeros(len(angle)), shown))
        np.testing.assert_allclose(found.data.y[:, 0] - found.data.y[0, 0], angle - angle[0], atol=1e-8 * turn)
        assert found.turn == turn
        assert found.count == np.sum(np.diff(np.floor(angle / turn)) != 0.0)
        assert f"{found.count} wraps of the output at" in found.sentence


def test_several_experiments_are_unwrapped_each_for_itself():
    angles = [360.0 * swings(seed, 200) for seed in (1, 2)]
    data = IOData.merge(*(IOData(np.zeros(200), np.mod(a, 360.0)) for a in angles))
    found = unwrapped(data)
    for e, angle in zip(found.data.experiments, angles, strict=True):
        np.testing.assert_allclose(np.diff(e.y[:, 0]), np.diff(angle), atol=1e-6)


def test_what_no_wrap_made_is_left_alone():
    rng = np.random.default_rng(0)
    square = np.where(np.arange(600) // 50 % 2, 1.0, 0.0)
    for y in (
        360.0 * swings(0),  # over many turns
        100.0 * np.sin(np.arange(600) / 30.0),
        rng.normal(size=600),
        rng.uniform(0.0, 360.0, 600),
        square,  # jumps as a turn does, and stands between
        340.0 * square + np.linspace(0.0, 10.0, 600),
        np.where(np.arange(600) % 7 == 0, 0.0, 170.0) + rng.normal(size=600),
    ):
        found = unwrapped(IOData(np.zeros(600), y))
        assert found.count == 0
        np.testing.assert_array_equal(found.data.y[:, 0], y)
    with pytest.raises(InputError, match="give its length"):
        unwrapped(IOData(np.zeros(3), np.zeros(3)), -1.0)


def test_frequency_and_damping_come_back_from_a_noisy_record():
    rng = np.random.default_rng(2)
    drive = np.repeat(rng.uniform(-1.0, 1.0, 60), 20)
    true = np.array([0.7, 0.12, 0.0, 0.0])
    chain = sysid.Chain((Compliance(role="link"),))
    data = IOData(drive, chain.simulate(true, drive) + 0.01 * rng.normal(size=len(drive)))
    fit = sysid.fit(chain, data, start=np.array([0.4, 0.5, 0.0, 0.0]))
    assert fit.theta[:2] == pytest.approx(true[:2], rel=0.02)
