"""The initial state of a state space from the first outputs: no worse than rest, exact at rest, exact in the long."""

import numpy as np
import pytest
from often import by_day

from sysid import IOData
from sysid.bench.drawing.signals import excitation
from sysid.blocks import Rectifier, StateSpace
from sysid.estimation.initial_state import estimate_initial
from sysid.model.chain import Chain

WINDOWS = (2, 5, 10, 20, 50, 200)


def drawn(seed: int, kind: str) -> tuple[Chain, np.ndarray, np.ndarray, np.random.Generator]:
    """A plant of 1 to 4 states, its parameters, an input of 1500 samples, and the generator.

    "hidden" has a rectifier behind a network: the output does not show the sign.
    """
    rng = np.random.default_rng([31, seed])
    block = StateSpace(1 + seed % 4, 0 if kind == "linear" else 4, readout=kind == "network", role="state")
    m = block.split(rng.standard_normal(block.n_parameters))
    A = m.A * rng.uniform(0.7, 0.97) / np.abs(np.linalg.eigvals(m.A)).max()
    theta = block.joined(m._replace(A=A, B=0.3 * m.B, E=0.1 * m.E, F=0.3 * m.F, D=0 * m.D, d=0 * m.d, x0=0 * m.x0))
    u = excitation("aprbs", 1500, rng)
    if kind != "hidden":
        return Chain((block,)), theta, u, rng
    return Chain((block, Rectifier(role="output"))), np.concatenate([theta, [0.0]]), u, rng


def run_errors(seed: int, kind: str, cut: int, window: int, level: float = 20.0, plain: bool = False) -> np.ndarray:
    """Errors (2,) after the window in parts of the output: from rest, or by least squares if `plain`, and as found."""
    chain, theta, u, rng = drawn(seed, kind)
    clean = chain.simulate(theta, u)[cut:]
    noise, size = clean.std() * 10 ** (-level / 20), clean.std()
    data = IOData(u[cut:], clean + noise * rng.standard_normal(len(clean)))
    first = data.select(0, window)
    found = (
        estimate_initial(chain, theta, first) if plain else theta,
        estimate_initial(chain, theta, first, data.u, noise**2),
    )
    after = slice(window, window + 200)
    return np.array([np.sqrt(np.mean((chain.simulate(t, data.u) - clean)[after] ** 2)) / size for t in found])


@pytest.mark.parametrize("kind", ["linear", "network", "hidden"])
@pytest.mark.parametrize("window", by_day(WINDOWS, 2, 10, 200))
def test_in_motion_windows_of_any_length_are_no_worse_than_rest(kind, window):
    """1 to 4 states, noise 20 dB below the output, 1000 samples after rest."""
    e = np.array([run_errors(seed, kind, 1000, window) for seed in range(8)])
    assert e[:, 1].mean() <= e[:, 0].mean()
    if window in (5, 10, 20):
        assert e[:, 1].mean() < 0.5 * e[:, 0].mean()


@pytest.mark.parametrize("kind", ["linear", "network", "hidden"])
def test_at_rest_the_run_is_exactly_that_from_rest(kind):
    """A record that begins at rest; least squares follows the noise instead."""
    for window in WINDOWS:
        for seed in range(4):
            e = run_errors(seed, kind, 0, window)
            assert e[0] == e[1] == 0.0


@pytest.mark.parametrize("kind", ["linear", "network"])
def test_a_long_window_gives_what_least_squares_gives(kind):
    e = np.array([run_errors(seed, kind, 1000, 200, 40.0, plain=True) for seed in range(8)])
    assert np.all(e[:, 1] <= 1.2 * e[:, 0] + 1e-4)


def test_a_record_that_begins_at_an_input_held_for_long_begins_in_its_steady_state():
    """Two samples with noise do not show three states; the steady state of the first input, a number known, does."""
    chain, theta, u, rng = drawn(2, "network")
    block = chain.blocks[0]
    u[:1000] = u[1000]
    clean = chain.simulate(theta, u)[1000:]
    noise = 0.05 * clean.std()
    data = IOData(u[1000:], clean + noise * rng.standard_normal(500))
    found = chain.part(estimate_initial(chain, theta, data.select(0, 2), data.u, noise**2), block)[-3:]
    steady = block.rest(theta, u[1000:1001])
    assert np.linalg.norm(found - steady) < 0.2 * np.linalg.norm(steady)
