"""Parameters and inputs of the wrong shape, and maps without a width: a sentence, never what lies beyond an array."""

import numpy as np
import pytest
from cases import BLOCKS, MOVING, VARIANTS
from often import FULL

from sysid import InputError
from sysid.blocks import CubicSpline, PiecewiseLinear
from sysid.model.chain import Chain
from sysid.structures import hammerstein, output_error

CHAIN = output_error(2, 2, 1)
THETA = np.array([0.2, 0.1, -1.2, 0.5, 0.0, 0.0])
U = np.linspace(-1.0, 1.0, 50)
RUNS = ("simulate", "tangent", "outputs", "sensitivities", "signals", "remarks")
OF_THETA = ("admissible", "count", "gauge", "kinks", "repair", "at_limit")
SHAPES = {
    "too short": THETA[:3],
    "too long": np.append(THETA, 1.0),
    "empty": np.empty(0),
    "a column": THETA[:, None],
    "a row": THETA[None],
    "a number": 1.0,
    "complex": THETA * 1j,
    "texts": ["a"] * 6,
    "None": None,
    "a list with nan": [np.nan] * 6,
}


@pytest.mark.parametrize("theta", SHAPES.values(), ids=SHAPES)
def test_parameters_are_one_number_for_each(theta):
    for name in RUNS:
        with pytest.raises(InputError, match=r"^theta is .*; give"):
            getattr(CHAIN, name)(theta, U)
    for name in OF_THETA:
        with pytest.raises(InputError, match=r"^theta is .*; give"):
            getattr(CHAIN, name)(theta)


@pytest.mark.parametrize("theta", [THETA.tolist(), THETA.astype(object), tuple(THETA), THETA.astype(np.longdouble)])
def test_parameters_that_stand_for_an_array_are_taken(theta):
    if np.asarray(theta).dtype == object:
        with pytest.raises(InputError, match="array of real numbers"):
            CHAIN.simulate(theta, U)
        return
    np.testing.assert_array_equal(CHAIN.tangent(theta, U.tolist())[1], CHAIN.tangent(THETA, U)[1])
    assert CHAIN.admissible(theta)
    assert CHAIN.gauge(theta).shape == CHAIN.gauge(THETA).shape


@pytest.mark.parametrize("u", [np.column_stack([U, U]), np.ones((3, 1, 1)), 1.0, "u", [[1.0], [2.0, 3.0]]])
def test_an_input_has_the_channels_of_the_chain(u):
    for name in RUNS:
        with pytest.raises(InputError, match=r"^u is .*; give"):
            getattr(CHAIN, name)(THETA, u)


@pytest.mark.parametrize("name", sorted({**BLOCKS, **VARIANTS, **MOVING}))
def test_an_empty_input_gives_an_empty_output(name):
    block, theta = {**BLOCKS, **VARIANTS, **MOVING}[name]
    empty = np.empty((0, block.channels[0]))
    y, J = Chain((block,)).sensitivities(theta, empty)
    assert y.shape == (0, block.channels[1])
    assert J.shape == (0, len(theta))


FLAT = {
    "first knots": (PiecewiseLinear(3, role="map"), [0.0, 0.0, 1.0, 1.0, 2.0, 3.0], "x1 = 0, x2 = 0"),
    "last knots": (PiecewiseLinear(3, role="map"), [-1.0, 0.5, 0.5, 1.0, 2.0, 3.0], "x3 = 0.5"),
    "spline": (CubicSpline(3, role="map"), [1.0, 1.0, 0.0, 1.0, 2.0], "lo = 1, hi = 1"),
    "monotone": (CubicSpline(3, monotone=True, role="map"), [1.0, 1.0, 0.0, 1.0, 2.0, 1.0, 1.0], "lo = 1, hi = 1"),
}


@pytest.mark.parametrize(("block", "theta", "words"), FLAT.values(), ids=FLAT)
def test_a_map_without_a_width_is_told_with_its_knots(block, theta, words):
    chain = Chain((block,))
    for call in (chain.simulate, chain.tangent):
        with pytest.raises(InputError, match=f"^map divides by zero with .*{words}.*rising order"):
            call(np.array(theta), U)


def test_two_equal_inner_knots_are_a_jump():
    chain = Chain((PiecewiseLinear(4, role="map"),))
    y = chain.simulate(np.array([-1.0, 0.0, 0.0, 1.0, -1.0, 0.0, 5.0, 6.0]), np.array([-0.5, 0.0, 0.5]))
    np.testing.assert_array_equal(y, [-0.5, 0.0, 5.5])


def test_a_chain_of_two_inputs_takes_two():
    pair = hammerstein(1, 0, 0, "saturation", nu=2, ny=1)
    theta = np.array([-1.0, 1.0, -2.0, 2.0, 3.0, 5.0])
    with pytest.raises(InputError, match=r"the chain has 2 input\(s\); give an array of shape \(N, 2\)"):
        pair.outputs(theta, U)


@pytest.mark.parametrize("name", sorted({**BLOCKS, **VARIANTS, **MOVING}))
def test_no_values_of_a_block_end_in_another_error(name):
    """Every parameter at zero, without limit or as its neighbour, over inputs that reach everywhere: numbers or a
    sentence; what is not finite gives what is not finite."""
    block, theta = {**BLOCKS, **VARIANTS, **MOVING}[name]
    u = np.linspace(-2.0, 2.0, 20)
    runs = [u, 5e307 * u, np.where(u > 1.0, np.nan, u), np.where(u > 1.0, np.inf, u)]
    tried = [np.full(len(theta), v) for v in (0.0, -1.0, 1e308, 1e-308, np.nan, np.inf)]
    for k in range(len(theta)):
        tried += [np.where(np.arange(len(theta)) == k, v, theta) for v in (0.0, -1.0, 1e308, np.nan, theta[k - 1])]
    for values in tried if FULL or len(theta) < 12 else tried[::7]:  # 7 and the 5 odd values share no factor
        for x in runs:
            said = ""
            try:
                y, _ = Chain((block,)).sensitivities(values, np.column_stack([x] * block.channels[0]))
            except InputError as e:
                said = str(e)
            assert "divides by zero" in said or y.shape == (20, block.channels[1])


def test_equal_knots_have_no_gauge_and_no_kinks():
    chain = Chain((PiecewiseLinear(3, role="map"),))
    theta = np.array([0.0, 0.0, 1.0, 1.0, 2.0, 3.0])
    for call in (chain.gauge, chain.count, chain.kinks):
        with pytest.raises(InputError, match=r"^map divides by zero with x1 = 0, x2 = 0"):
            call(theta)
    with pytest.raises(InputError, match=r"knots is 10+; give a whole number up to 10,000"):
        PiecewiseLinear.evenly_spaced(U, knots=10**9)
    with pytest.raises(InputError, match="x has no samples"):
        PiecewiseLinear.evenly_spaced([])
