"""The initial state of a free run: found from the first outputs, whatever a map's parameters are called."""

import numpy as np
import pytest

import sysid
from sysid import IOData
from sysid.bench.drawing.plants import draw_filter
from sysid.bench.drawing.signals import excitation
from sysid.block.block import StaticBlock
from sysid.blocks import Custom, PiecewiseLinear, TransferFunction
from sysid.estimation import search
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


# --- with the noise of the fit


def drawn(seed: int, map: StaticBlock | None = None) -> tuple[Chain, np.ndarray, np.ndarray, np.random.Generator]:
    """A plant of order 1 to 6, its parameters, an input of 1500 samples, and the generator."""
    rng = np.random.default_rng([21, seed])
    block, theta, _ = draw_filter(rng, 1000, 1 + seed % 6, "linear")
    if map is not None:
        theta = np.concatenate([theta, map.start(np.linspace(-3.0, 3.0, 7))])
    return Chain((block,) if map is None else (block, map)), theta, excitation("aprbs", 1500, rng), rng


def run_errors(seed: int, cut: int, window: int, level: float = 20.0, map: StaticBlock | None = None) -> np.ndarray:
    """Errors (3,) after the window from rest, by least squares and with the noise known, in parts of the output."""
    chain, theta, u, rng = drawn(seed, map)
    clean = chain.simulate(theta, u)[cut:]
    noise, size = clean.std() * 10 ** (-level / 20), clean.std()
    data = IOData(u[cut:], clean + noise * rng.standard_normal(len(clean)))
    first = data.select(0, window)
    found = (
        np.where(chain.initial, 0.0, theta),
        estimate_initial(chain, theta, first),
        estimate_initial(chain, theta, first, data.u, noise**2),
    )
    after = slice(window, window + 200)
    return np.array([np.sqrt(np.mean((chain.simulate(t, data.u) - clean)[after] ** 2)) / size for t in found])


@pytest.mark.parametrize("window", [2, 10, 50])
@pytest.mark.parametrize("cut", [0, 1000])
def test_windows_of_any_length_are_no_worse_than_rest(window, cut):
    """Orders 1 to 6, noise 20 dB below the output. Least squares is hundreds of times worse at ten samples."""
    e = np.array([run_errors(seed, cut, window) for seed in range(24)])
    assert e[:, 2].mean() <= e[:, 0].mean() + 1e-12
    if cut and window < 50:
        assert e[:, 2].mean() < 0.7 * e[:, 0].mean()
    if window == 10:
        assert e[:, 1].mean() > 3 * e[:, 2].mean()


def test_a_long_window_gives_what_least_squares_gives():
    e = np.array([run_errors(seed, 1000, 400, level=40.0) for seed in range(12)])
    assert np.all(e[:, 2] <= 1.2 * e[:, 1] + 1e-4)


def test_behind_a_map_the_window_is_no_worse_than_rest_either():
    """The map bends at zero, so the outputs are not linear in the initial state."""
    bent = PiecewiseLinear(knots=5, role="output")
    for cut in (0, 1000):
        e = np.array([run_errors(seed, cut, 10, map=bent) for seed in range(12)])
        assert e[:, 2].mean() <= e[:, 0].mean() + 1e-12


def test_the_unit_of_the_output_changes_nothing():
    chain, theta, u, rng = drawn(3)
    y = chain.simulate(theta, u)[700:] + 0.1 * rng.standard_normal(800)
    scaled = theta * np.where(np.char.find(chain.names, ".f") >= 0, 1.0, 1000.0)
    runs = [
        chain.simulate(estimate_initial(chain, t, IOData(u[700:720], k * y[:20]), u[700:, None], (0.1 * k) ** 2), u)
        for t, k in ((theta, 1.0), (scaled, 1000.0))
    ]
    np.testing.assert_allclose(runs[1], 1000.0 * runs[0], rtol=1e-6, atol=1e-6)


def test_filters_of_different_lengths_have_a_common_initial_state():
    """A Wiener-Hammerstein chain whose filters remember 2 and 6 samples, at rest in a window of ten."""
    chain = sysid.structures.wiener_hammerstein(1, 2, 0, 2, 2, 4)
    rng = np.random.default_rng(3)
    u = rng.standard_normal(800)
    theta = np.array(
        [
            0.2,
            -1.2,
            0.4,
            0,
            0,
            *np.linspace(-3, 3, 10),
            *np.tanh(np.linspace(-3, 3, 10)),
            1.0,
            0.3,
            -0.5,
            0.1,
            *np.zeros(5),
        ]
    )
    y = chain.simulate(theta, u)
    data = sysid.IOData(u, y + 1e-3 * rng.standard_normal(800))
    fit = sysid.fit(chain, data, start=theta)
    assert fit.fit_percent(data, 10) > 99.5


def test_a_search_from_another_point_takes_its_initial_state_for_the_first_experiment_only():
    """Other poles come with an initial state of that record; a further experiment keeps its own."""
    chain, rng = sysid.structures.output_error(2, 2, 1), np.random.default_rng(0)
    data = IOData(*rng.standard_normal((2, 60)), lengths=(30, 30))
    context = search.SearchContext(chain, data, sysid.Objective(), "lm", sysid.Options(max_iterations=0), None)
    problem = context.problem(rng.uniform(-0.1, 0.1, (2, len(chain.names))))
    point = rng.uniform(-0.1, 0.1, len(chain.names))
    moved = search._problem_at(chain, problem, context.trial(problem), point, 0).theta0
    np.testing.assert_array_equal(moved, [point, np.where(chain.initial, problem.theta0[1], point)])
