"""What blocks promise beyond their derivatives: other units, limits of motion, equations, starts to all sides."""

import re

import numpy as np
import pytest
from cases import BLOCKS, MOVING, VARIANTS
from exported import excitation, made

from sysid import InputError
from sysid.blocks import (
    CoastingPlay,
    Compliance,
    Custom,
    DeadZone,
    DeadZoneSaturation,
    LimitedIntegrator,
    PiecewiseLinear,
    ProfiledMotor,
    TransferFunction,
    UnitGain,
    Wrap,
)
from sysid.export import closed_form
from sysid.model.chain import Chain

CASES = BLOCKS | VARIANTS | MOVING


def run(block, theta, x):
    """Output (N, outputs) of x (N, inputs)."""
    n_in, n_out = block.channels
    ys, _ = block.propagate_all(theta, list(x.T), [np.empty((len(x), 0))] * max(n_in, n_out), 0)
    return np.column_stack(ys)


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize("name", sorted(CASES))
def test_a_block_in_other_units_is_the_same_block(name, sign):
    """x' = x / a and y' = y / b, of powers of two; its numbers here are M times those there."""
    block, theta = CASES[name]
    n_in, n_out = block.channels
    a, b = sign * 2.0 ** np.arange(1, n_in + 1), 0.25 * 2.0 ** np.arange(n_out)
    law = block.law(a, b)
    if law is None:
        return
    x = excitation(n_in, 100).reshape(100, n_in)
    there = np.linalg.solve(law.M, theta) if len(theta) else theta
    y = run(block, theta, x)
    np.testing.assert_allclose(b * run(law.block, there, x / a), y, rtol=0, atol=1e-12 * np.ptp(y))


def test_which_blocks_have_other_units():
    """So that the test above has something to do; a unit gain only where both are alike."""
    a, b = np.array([2.0]), np.array([4.0])
    with_law = {n for n, (block, _) in CASES.items() if block.channels == (1, 1) and block.law(a, b) is not None}
    assert {"sigmoid_network", "wavelet_network", "transfer_function", "polynomial"} <= with_law
    assert BLOCKS["transfer_matrix"][0].law(np.ones(2), np.ones(2)) is not None
    assert UnitGain().law(a, b) is None
    assert UnitGain().law(a, a) is not None


def test_a_limited_integrator_stops_at_its_limits_and_leaves_them_at_once():
    gain, lower, upper, position = 0.1, -0.4, 0.7, 0.2
    x, expected = excitation(N=300), []
    for value in x:
        expected.append(position)
        position = np.clip(position + gain * value, lower, upper)
    expected = np.array(expected)
    assert min(np.sum(expected == lower), np.sum(expected == upper)) > 10
    found = run(LimitedIntegrator(), np.array([gain, lower, upper, 0.2]), x[:, None])[:, 0]
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-14)


def test_a_link_that_comes_to_rest_stays_there():
    """Friction against a speed of 0.05 a sample ends it after 2.5 samples and 0.0625 on: v^2 / (2 drag)."""
    x = np.concatenate([0.05 * np.arange(20.0), np.full(20, 0.95)])
    y = run(CoastingPlay(), np.array([1.0, -0.5, 0.02, 0.0, 0.0]), x[:, None])[:, 0]
    np.testing.assert_allclose(y[-10:], 0.95 - 0.5 + 0.0625, rtol=0, atol=1e-12)


def test_the_equation_of_a_compliance_has_the_square_of_its_frequency():
    text = closed_form.text(made(Chain((Compliance(),)), [0.3, 0.2, 0.0, 0.0]))
    assert re.search(r"'' \+ 0\.12\*\w' = 0\.09\*\(", text)


def test_a_filter_has_the_zeros_of_its_numerator():
    block = TransferFunction(3, 2, 1, role="linear")
    theta = np.concatenate([2.0 * np.poly([0.3, -0.6]), np.poly([0.9, 0.5])[1:], np.zeros(block.n_parameters - 5)])
    np.testing.assert_allclose(np.sort(block.zeros(theta).real), [-0.6, 0.3])
    np.testing.assert_allclose(np.sort(block.poles(theta).real), [0.5, 0.9])


def test_a_state_space_with_derivatives_has_the_outputs_of_one_without():
    block, theta = BLOCKS["state_space"]
    assert block.scales()[3][0] not in (1.0, -1.0)
    x = excitation(N=30)
    J = np.zeros((30, 1 + block.n_parameters))
    (y,), _ = block.propagate_all(theta, [x], [J], 1)
    np.testing.assert_allclose(y, run(block, theta, x[:, None])[:, 0], rtol=1e-12)


def test_an_angle_is_shown_within_half_a_turn_of_zero():
    x = np.array([-4.0, -1.0, 0.0, 3.0, 4.0, 10.0])
    y = run(Wrap(), np.empty(0), x[:, None])[:, 0]
    np.testing.assert_allclose(y, np.angle(np.exp(1j * x)), atol=1e-14)


def test_a_custom_map_is_asked_from_minus_one_to_one():
    with pytest.raises(InputError, match=r"over \(-1\.0, 1\.0\)"):
        Custom(f=lambda x, theta: 1.0 / (x + 0.5))


def test_corners_in_one_place_are_not_admissible():
    theta = np.array([-1.0, -0.5, 0.5, 1.0, 1.0, 1.0])
    assert DeadZoneSaturation().admissible(theta)
    for equal in ([-0.5, -0.5, 0.5, 1.0], [-1.0, -0.5, 1.0, 1.0]):
        assert not DeadZoneSaturation().admissible(np.array([*equal, 1.0, 1.0]))


def test_a_quick_or_light_motor_is_not_at_a_bound():
    """In volts and samples, numbers of small motors lie orders of magnitude below 1."""
    lowest = {slot.name: slot.lower for slot in ProfiledMotor().slots()}
    assert all(0.0 < lowest[name] < 1e-6 for name in ("inertia", "drag_up", "drag_down"))


def test_starts_reach_to_both_sides_and_over_the_whole_range():
    rng = np.random.default_rng(0)
    theta = np.array([-0.1, 0.1])
    places = np.array([DeadZone().vary(theta, rng).mean() for _ in range(400)])
    for side in (places, -places):  # half of them stay near, the others go up to ten half widths away
        assert np.mean(side > 0.3) == pytest.approx(0.17, abs=0.06)
    block = PiecewiseLinear(knots=5)
    theta = np.concatenate([np.linspace(0.0, 4.0, 5), np.zeros(5)])
    knots = np.mean([block.vary(theta, rng)[:5] for _ in range(400)], axis=0)
    np.testing.assert_allclose(knots, np.linspace(0.0, 4.0, 5), atol=0.1)
