"""The band of a calibrated twin over a log that was not used, where what the twin lacks is drawn from the prior."""

import numpy as np
import pytest

from sysid.base.parallel import one_blas_thread
from twin.calibrate import discrepancy
from twin.calibrate.band import lack
from twin.calibrate.problem import Free, Record, Simulations

TS, N, NOISE = 0.05, 600, 0.02
FRAME = discrepancy.Frame(-1.0, 1.0, 1.0)


@pytest.fixture(scope="module", autouse=True)
def one_thread():
    with one_blas_thread():
        yield


def place(rng):
    """A joint that goes to and fro over most of its range, at changing speeds."""
    return 0.95 * np.sin(np.cumsum(rng.uniform(0.3, 1.0, N) * TS) + rng.uniform(0.0, 6.0))


def simulation(y):
    """The response y + a y + b with the measured values to be filled in."""
    columns = np.column_stack([y, np.ones(N)])
    free = [Free(name, 0.0, -10.0, 10.0, "1", 1.0) for name in "ab"]
    return free, columns, lambda values: y + values @ columns.T


def shares_inside(rng, size):
    """The share of an unused log within the band, and the mean half width, of one drawn leg."""
    weights, truth = size * rng.standard_normal(100), 0.01 * rng.standard_normal(2)
    logs = []
    for _ in range(2):
        y = place(rng)
        free, columns, respond = simulation(y)
        shape = discrepancy.bumps(y, -1.0, 1.0, 0.12)
        measured = y + columns @ truth + shape @ weights[: shape.shape[1]] + NOISE * rng.standard_normal(N)
        logs.append((y, free, columns, respond, measured))
    (y, free, columns, respond, measured), (_, _, _, fresh_respond, unseen) = logs
    task = Simulations(free, [Record("used", measured, TS, respond)], NOISE)
    e, J = task.linearise(task.start)
    p = task.start + np.linalg.lstsq(J, e, rcond=None)[0]
    e, J = task.linearise(p)
    groups = discrepancy.departures([y], [TS], 0.12, FRAME)
    sizes = discrepancy.Sizes(NOISE, (size, 0.0, 0.0, 0.0), 0.0, 0.12)
    lacking = lack(e, J, np.ones(2), np.zeros((N, 0)), groups, sizes, FRAME)
    run = fresh_respond(p[None])[0]
    half = lacking.half(Simulations(free, [Record("fresh", unseen, TS, fresh_respond)], NOISE), p, run, 0.95)
    return np.mean(np.abs(unseen - run) <= half), np.mean(half)


@pytest.mark.parametrize("size", [0.0, 0.02, 0.08])
def test_the_band_of_an_unused_log_holds(size):
    rng = np.random.default_rng(7)
    inside, half = np.array([shares_inside(rng, max(size, 1e-9)) for _ in range(40)]).T
    assert 0.93 < inside.mean() < 0.985
    if size == 0.0:  # nothing but noise is left
        assert half.mean() == pytest.approx(1.96 * NOISE, rel=0.02)


def test_a_parameter_that_kept_its_value_makes_the_band_as_wide_as_its_prior():
    """The log that was used does not move with it; the other one does, by 2 a scale."""
    rng = np.random.default_rng(8)
    y, y2 = place(rng), place(rng)
    e = NOISE * rng.standard_normal(N)
    groups = discrepancy.departures([y], [TS], 0.12, FRAME)
    sizes = discrepancy.Sizes(NOISE, (0.0, 0.0, 0.0, 0.0), 0.0, 0.12)
    lacking = lack(e, np.zeros((N, 1)), np.ones(1), np.zeros((N, 0)), groups, sizes, FRAME)
    free = [Free("a", 0.0, -10.0, 10.0, "1", 1.0)]
    record = Record("fresh", y2, TS, lambda values: y2 + 2.0 * values * np.ones(N))
    task = Simulations(free, [record], NOISE)
    half = lacking.half(task, task.start, y2, 0.95)
    np.testing.assert_allclose(half, 1.96 * np.hypot(2.0, NOISE), rtol=1e-3)
    lacking = lack(e, np.zeros((N, 1)), np.array([0.1]), np.zeros((N, 0)), groups, sizes, FRAME)
    np.testing.assert_allclose(lacking.half(task, task.start, y2, 0.95), 1.96 * np.hypot(0.2, NOISE), rtol=1e-3)
