"""A record taken in pieces: the same linearisation as from the whole Jacobian, in memory that does not grow."""

import tracemalloc
from dataclasses import replace

import numpy as np
import pytest

import sysid
from sysid.blocks import Delay, PiecewiseLinear, Polynomial, TransferFunction
from sysid.estimation import problem
from sysid.estimation.prior import Prior
from sysid.estimation.problem import ChainProblem
from sysid.model.chain import Chain
from sysid.solver.iterate import linearise_free
from sysid.solver.linearisation import Linearisation

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
    monkeypatch.setattr(problem, "ROWS", ROWS)


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
    assert len(e) == found.N


@pytest.mark.parametrize("name", CHAINS)
@pytest.mark.parametrize("seed", range(3))
def test_pieces_give_the_linearisation_of_the_whole_jacobian(name, seed):
    chain, theta, data = drawn(name, np.random.default_rng(seed))
    task = ChainProblem(chain, theta[None, :], (data,), chain.free)
    same(task.compact(task.start), *task.linearise(task.start))
    yhat = chain.simulate(theta, data.u[:, 0])
    np.testing.assert_allclose(task.residual(task.start), data.y[:, 0] - yhat, rtol=0, atol=1e-12 * np.ptp(yhat))


def test_missing_samples_weights_thresholds_and_penalties_count_in_pieces():
    rng = np.random.default_rng(1)
    chain, theta, data = drawn("NLN", rng)
    data = replace(data, missing=rng.uniform(size=N) < 0.2)
    task = ChainProblem(
        chain,
        theta[None, :],
        (data,),
        chain.free,
        huber_threshold=0.8,
        prior=Prior(rng.normal(size=(4, len(theta))), rng.normal(size=4), rng.uniform(size=4)),
        curvature_weight=3.0,
        weights=np.array([0.7]),
    )
    e, J = task.linearise(task.start)
    same(task.compact(task.start), e, J)
    np.testing.assert_allclose(task.residual(task.start), e, rtol=0, atol=1e-12)
    bare_e, bare_J = task.bare.linearise(task.start)
    _, s, _ = np.linalg.svd(bare_J / np.linalg.norm(bare_J, axis=0))
    assert task.count(task.start) == min(np.sum(s > 1e-7 * s[0]), chain.count(theta))
    assert task.covariance(task.start).noise_variance == pytest.approx(
        bare_e @ bare_e / (len(bare_e) - task.count(task.start))
    )


@pytest.mark.parametrize("fixed", [{}, {"g.f1": -0.5}])
def test_experiments_with_states_of_their_own_count_in_pieces(fixed):
    rng = np.random.default_rng(2)
    _, theta, data = drawn("LN", rng)
    chain = Chain(CHAINS["LN"], fixed=fixed)
    records = (data.select(0, 300), data.select(300, 301 + ROWS), data.select(500, N))
    thetas = np.tile(theta, (3, 1))
    thetas[:, chain.initial] = rng.normal(size=(3, int(chain.initial.sum())))
    task = ChainProblem(chain, thetas, records, chain.free)
    p = task.start + 0.01 * rng.normal(size=len(task.start))
    p[: int(chain.free.sum())] = 0.0
    same(task.compact(p), *task.linearise(p))


def test_a_direction_at_its_bound_is_left_out():
    """A triangle of R's other columns is that of the other columns of J."""
    rng = np.random.default_rng(3)
    e, J = rng.normal(size=60), rng.normal(size=(60, 7))
    J[:, 5] = J[:, 2]
    some = np.array([True, False, True, True, False, True, True])
    same(Linearisation.of(e, J).along(some), e, J[:, some])
    same(Linearisation.of(e[:4], J[:4]).along(some), e[:4], J[:4, some])


def test_a_search_stays_at_its_bounds_in_pieces():
    rng = np.random.default_rng(4)
    _, theta, data = drawn("LN", rng)
    chain = Chain(CHAINS["LN"], bounds={"f.y1": (-np.inf, theta[-4])})
    task = ChainProblem(chain, theta[None, :], (data,), chain.free)
    e, J = task.linearise(task.start)
    e = e * 0 + J[:, -4]  # the descent goes up along y1, where the bound is
    blocked = task.blocked(task.start, J.T @ e)
    assert blocked.any()
    lin, moving = linearise_free(replace(task, records=(replace(data, y=data.y - 0.0),)), task.start)
    np.testing.assert_array_equal(moving, ~task.blocked(task.start, J.T @ task.linearise(task.start)[0]))
    same(lin, task.linearise(task.start)[0], J[:, moving])


def test_a_chain_with_a_block_that_needs_its_record_whole_has_no_pieces():
    chain = Chain((linear("g"), sysid.blocks.Play(role="play")))
    theta = np.concatenate([b.start(np.linspace(-1, 1, 5)) for b in chain.blocks])
    data = sysid.IOData(np.sin(np.arange(N)), np.cos(np.arange(N)))
    assert ChainProblem(chain, theta[None, :], (data,), chain.free).compact(np.zeros(int(chain.free.sum()))) is None


def test_memory_of_a_linearisation_does_not_grow_with_the_record():
    """Of 100 times as many samples only e and the record itself are kept, not J: 26 columns of 8 bytes a sample."""
    chain = Chain(CHAINS["NLN"])
    rng = np.random.default_rng(5)
    _, theta, _ = drawn("NLN", rng)
    peaks = []
    for n in (2_000, 200_000):
        u = rng.uniform(-1, 1, n)
        task = ChainProblem(chain, theta[None, :], (sysid.IOData(u, u),), chain.free)
        task.compact(task.start)
        tracemalloc.start()
        task.compact(task.start)
        peaks.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.reset_peak()
        task.residual(task.start)
        residual = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
    assert peaks[1] < 1.2 * peaks[0] + 1e5
    assert residual < 8 * 200_000 * 1.2 + 1e6  # e, and the marks of observed samples
