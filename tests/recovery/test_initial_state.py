"""The initial state of a free run: found from the first outputs, whatever a map's parameters are called."""

import numpy as np
import pytest

from sysid import IOData
from sysid.blocks import Custom, PiecewiseLinear, TransferFunction
from sysid.estimation.initial_state import estimate_initial
from sysid.model.chain import Chain


def well(names: tuple[str, str]) -> Custom:
    """y = offset + g(x) with g flat for x < 1: from rest no slope shows the way, only the level that is tried."""
    return Custom(
        f=lambda x, theta: theta[1] + np.maximum(x - 1.0, 0.0) ** 2 + 0.0 * theta[0],
        names=names,
        initial=(1.0, 0.0),
        role="output",
    )


@pytest.mark.parametrize("name", ["scale", "x_scale"])
def test_a_parameter_of_a_map_whose_name_begins_with_x_is_no_place(name):
    """The filter stands at 2 and the record shows it at once; a place at 1e6 would have the levels thousands apart."""
    chain = Chain((TransferFunction(1, 1, 1, role="linear"), well((name, "offset"))))
    u = 0.8 * np.sin(0.3 * np.arange(60))
    true = np.array([0.2, -0.95, 0.95 * 2.0, 1e6, 0.5])
    found = estimate_initial(chain, np.where(chain.initial, 0.0, true), IOData(u, chain.simulate(true, u)))
    np.testing.assert_allclose(chain.simulate(found, u), chain.simulate(true, u), rtol=0, atol=1e-6)


def test_the_places_of_a_map_say_how_far_a_state_may_lie():
    """No input moves the filter; that it may stand at -40 is known from the map's own places alone."""
    chain = Chain((TransferFunction(1, 1, 1, role="linear"), PiecewiseLinear(knots=4, role="output")))
    true = np.array([0.2, -0.9, 0.9 * -40.0, -50.0, -30.0, 10.0, 20.0, 7.0, 2.0, 2.0, 2.0])
    u = 1e-3 * np.sin(np.arange(30.0))
    found = estimate_initial(chain, np.where(chain.initial, 0.0, true), IOData(u, chain.simulate(true, u)))
    np.testing.assert_allclose(found, true, rtol=1e-6)
    assert [slot.knot for slot in chain.slots] == [False] * 3 + [True] * 4 + [False] * 4
