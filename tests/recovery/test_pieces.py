"""A record taken in pieces: the same linearisation as from the whole Jacobian, in memory that does not grow."""

import tracemalloc
from dataclasses import replace

import numpy as np
import pytest

import sysid
from sysid.blocks import Delay, PiecewiseLinear, Polynomial, TransferFunction
from sysid.estimation import pieces, problem
from sysid.estimation.problem import ChainProblem
from sysid.model.chain import Chain
from sysid.solver.iterate import Linearisation, linearised

N, ROWS = 997, 128  # the last piece is shorter than the others


def linear(role, nb=2, nf=2, nk=1, **more):
    return TransferFunction(nb, nf, nk, role=role, **more)


def line(role):
    return PiecewiseLinear(4, role=role)


CHAINS = {
    "L": (linear("g", 3, 3, 0),),
    "L of many lags": (linear("g", 2, 1, 150),),
    "FIR": (linear("g", 4, 0, 2),),
    "LN": (linear("g"), line("f")),
    "NL": (line("f"), linear("g", initial_state=False)),
    "NLN": (line("in"), linear("g", 2, 3, 1), line("out")),
    "LNL": (linear("first"), Polynomial(3, role="f"), linear("second", 1, 2, 0)),
    "delayed": (Delay(role="late"), linear("g"), line("f")),
}


@pytest.fixture(autouse=True)
def short(monkeypatch):
    monkeypatch.setattr(problem, "LONG", 100)
    monkeypatch.setattr(pieces, "ROWS", ROWS)


def drawn(name, rng):
    """A chain, its parameters (P,), and a record that it does not explain."""
    chain = Chain(CHAINS[name])
    u = np.repeat(rng.uniform(-1, 1, N), 3)[:N]
    parts = []
    for b in chain.blocks:
        theta = b.start(np.linspace(-1, 1, 5))
        if isinstance(b, TransferFunction):
            poles = rng.uniform(0.3, 0.99, b.nf)
            theta[: b.nb] = rng.normal(size=b.nb)
            theta[b.nb : b.nb + b.nf] = np.atleast_1d(np.poly(poles))[1:]
            theta[b.nb + b.nf :] = rng.normal(size=len(theta) - b.nb - b.nf)
        elif isinstance(b, Delay):
            theta[:] = rng.uniform(0, 300)  # longer than two pieces
        else:
            theta = theta + 0.05 * rng.normal(size=len(theta))
        parts.append(theta)
    theta = np.concatenate(parts)
    return chain, theta, sysid.IOData(u, chain.simulate(theta, u) + rng.normal(size=N), Ts=0.1)


def same(found, e, J):
    """R'R and R'z against J'J and J'e, in columns of unit norm."""
    size = np.maximum(np.linalg.norm(J, axis=0), 1e-100)
    np.testing.assert_allclose(found.R.T @ found.R / np.outer(size, size), (J / size).T @ (J / size), atol=1e-11)
    np.testing.assert_allclose(found.R.T @ found.z / size, (J / size).T @ e, atol=1e-11 * np.linalg.norm(e))
    assert found.cost == pytest.approx(float(e @ e), rel=1e-12)
    assert found.N == len(e)


@pytest.mark.parametrize("name", CHAINS)
@pytest.mark.parametrize("seed", range(3))
def test_pieces_give_the_linearisation_of_the_whole_jacobian(name, seed):
    chain, theta, data = drawn(name, np.random.default_rng(seed))
    task = ChainProblem(chain, theta[None, :], (data,), chain.free)
    same(task.compact(task.start), *task.linearise(task.start))
    yhat = chain.simulate(theta, data.u[:, 0])
    np.testing.assert_allclose(task.residual(task.start), data.y[:, 0] - yhat, rtol=0, atol=1e-12 * np.ptp(yhat))
