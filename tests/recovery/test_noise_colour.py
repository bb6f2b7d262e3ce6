"""The covariance of least squares under coloured noise, against the noise's own covariance matrix."""

import numpy as np
import pytest
from often import by_day
from scipy.linalg import toeplitz
from scipy.signal import lfilter

import sysid
from sysid.estimation.noise_model import (
    NoiseModel,
    _gram,
    _RestrictedLikelihood,
    long_run_covariance_root,
    noise_model,
)
from sysid.systems import system
from sysid.uncertainty import intervals
from sysid.uncertainty.information import information_at


def colour(memory, N):
    """Covariance (N, N) of AR(1) noise of variance 1."""
    return toeplitz(memory ** np.arange(N))


def noises(memory, N, count, seed=5):
    white = np.random.default_rng(seed).standard_normal((count, N + 300))
    return lfilter([np.sqrt(1 - memory**2)], [1.0, -memory], white, axis=1)[:, 300:]


def slow_columns(N, r):
    """Orthonormal columns (N, r) that follow slow noise: cosines of up to r / 2 periods."""
    t = (np.arange(N) + 0.5) / N
    return np.linalg.qr(np.cos(np.pi * np.outer(t, np.arange(r))))[0]


@pytest.mark.parametrize("memory", [0.0, 0.5, 0.9, -0.6])
def test_known_noise_gives_the_covariance_of_its_matrix(memory):
    V, lengths = np.random.default_rng(1).standard_normal((150, 3)), (90, 60)
    root = NoiseModel(np.array([1.0, -memory]), 1 - memory**2).root(V, lengths)
    expected = sum(v.T @ colour(memory, len(v)) @ v for v in (V[:90], V[90:]))
    np.testing.assert_allclose(root @ root.T, expected, rtol=1e-5, atol=1e-5)


def test_noise_of_second_order_gives_the_covariance_of_its_matrix():
    """Autocovariances by the Yule-Walker equations, solved by numpy."""
    A = np.array([1.0, -1.2, 0.5])
    system = np.array([[1.0, A[1], A[2]], [A[1], 1.0 + A[2], 0.0], [A[2], A[1], 1.0]])
    r = list(np.linalg.solve(system, [1.0, 0.0, 0.0]))
    for _ in range(80):
        r.append(-A[1] * r[-1] - A[2] * r[-2])
    V = np.random.default_rng(2).standard_normal((60, 2))
    root = NoiseModel(A, 1.0).root(V, (60,))
    np.testing.assert_allclose(root @ root.T, V.T @ toeplitz(r[:60]) @ V, rtol=1e-5)


def test_the_bound_under_known_noise_is_that_of_its_matrix():
    """(J'J)^-1 J'SJ (J'J)^-1 for the pole of a first-order filter, whose Jacobian numpy makes."""
    plant = system("textbook")
    data = plant.record(400, 0.0, np.random.default_rng(3))
    info = information_at(plant.chain, plant.theta, data, noise=NoiseModel(np.array([1.0, -0.8]), 0.36))
    J = plant.chain.tangent(plant.theta, data.u[:, 0])[1]
    back = np.linalg.pinv(J, rcond=1e-9)
    cov = back @ colour(0.8, 400) @ back.T
    f = plant.chain.names.index("linear.f1")
    assert intervals.parameters(info)["linear.f1"].std == pytest.approx(np.sqrt(cov[f, f]), rel=1e-4)


@pytest.mark.parametrize("memory", [0.0, 0.5, 0.8])
def test_the_memory_of_the_noise_is_found_behind_a_fit_that_follows_it(memory):
    """Ten slow columns take the slow tenth out of 200 samples. The mean estimate of 60 records is true within 0.035;
    that of the residuals' own lag-one correlation is 0.07 too low at a memory of 0.8."""
    V = slow_columns(200, 10)
    found, own = [], []
    for x in noises(memory, 200, 60):
        e = x - V @ (V.T @ x)
        model = noise_model(e, V, (200,))
        # The lag-one correlation of the model, whatever its order.
        h = lfilter([1.0], model.A, np.eye(1, 2000)[0])
        found.append(h[1:] @ h[:-1] / (h @ h))
        own.append(e[1:] @ e[:-1] / (e @ e))
    assert np.mean(found) == pytest.approx(memory, abs=0.035)
    if memory == 0.8:
        assert np.mean(own) < 0.75


def test_the_gradient_of_the_restricted_likelihood_is_that_of_its_value():
    rng = np.random.default_rng(4)
    likelihood = _RestrictedLikelihood(_gram(rng.standard_normal((90, 6)), (40, 30, 20), 4), 90, 3)
    for p in (1, 2, 4):
        r = rng.uniform(-0.9, 0.9, p)
        slope = [(likelihood(r + h)[0] - likelihood(r - h)[0]) / 2e-6 for h in 1e-6 * np.eye(p)]
        np.testing.assert_allclose(likelihood(r)[1], slope, rtol=1e-6, atol=1e-8)


@pytest.mark.parametrize("memory", by_day([0.0, 0.6, -0.6], 0.6))
def test_the_level_of_noise_behind_a_fit_of_many_parameters(memory):
    """White noise of this variance would move a slow and a fast column as far as the noise's own matrix says.

    Four experiments of 50 samples, 30 parameters; columns that say the same thing again change nothing.
    """
    lengths, rng = (50,) * 4, np.random.default_rng(2)
    J = np.concatenate([slow_columns(50, 20)] * 4)
    J = np.column_stack([J, rng.standard_normal((200, 10))])
    twice, V = np.column_stack([J, J @ rng.standard_normal((30, 30))]), np.linalg.qr(J)[0]
    for column in (J[:, [1]], np.resize([1.0, -1.0], 200)[:, None]):
        pieces = np.split(column, 4)
        expected = sum(float((v.T @ colour(memory, 50) @ v)[0, 0]) for v in pieces) / float(np.sum(column**2))
        levels = [
            noise_model(x - V @ (V.T @ x), twice, lengths).level(column, lengths)
            for x in noises(memory, 50, 800).reshape(200, 200)
        ]
        assert np.mean(levels) == pytest.approx(expected, rel=0.08)  # the mean of 200 is uncertain by 2.4 %


@pytest.mark.parametrize("memory", [0.0, 0.5, 0.8, 0.9])
def test_long_run_covariance_covers_as_the_noise_itself_would(memory):
    """Coefficients of eight slow columns from 1000 samples: 1.96 deviations hold within 3 % as many of 480 values as
    with the noise's own matrix, and are as long within 8 % (median), with the factor N / (N - r) that `information_at`
    puts before the covariance."""
    N, V = 1000, slow_columns(1000, 8)
    true = np.sqrt(np.diag(V.T @ colour(memory, N) @ V))
    held, known, plain, ratio = [], [], [], []
    for x in noises(memory, N, 60, seed=6):
        off = V.T @ x
        e = x - V @ off
        root, _ = long_run_covariance_root(e, V, (N,), "auto")
        std = np.sqrt(N / (N - 8)) * np.linalg.norm(root, axis=1)
        ratio.append(std / true)
        held.append(np.abs(off) <= 1.96 * std)
        known.append(np.abs(off) <= 1.96 * true)
        plain.append(np.abs(off) <= 1.96 * np.sqrt(e @ e / (N - 8)))
    assert np.mean(held) == pytest.approx(np.mean(known), abs=0.03)
    assert np.median(ratio) == pytest.approx(1.0, abs=0.08)
    if memory >= 0.8:
        assert np.mean(plain) < 0.65


def test_noise_that_grows_with_a_column_widens_its_own_direction():
    """Errors of deviation |v|: the variance of v'e is sum v^4, three times what white noise of the same mean square
    gives for Gaussian v."""
    rng = np.random.default_rng(9)
    V = np.linalg.qr(rng.standard_normal((20_000, 2)))[0]
    e = np.abs(V[:, 0]) * np.sqrt(20_000) * rng.standard_normal(20_000)
    root, _ = long_run_covariance_root(e, V, (20_000,), "auto")
    assert (root @ root.T)[0, 0] / np.mean(e**2) == pytest.approx(3.0, rel=0.12)
    assert (root @ root.T)[1, 1] / np.mean(e**2) == pytest.approx(1.0, rel=0.12)


@pytest.mark.parametrize("memory", [0.0, 0.8])
def test_intervals_follow_the_residuals_test_by_default(memory):
    """Coloured noise widens the gain's deviation by about sqrt((1 + a) / (1 - a)) = 3, white noise leaves the plain."""
    plant = system("textbook")
    clean = plant.record(2000, 0.0, np.random.default_rng(4))
    noise = 0.01 * clean.y.std() * noises(memory, 2000, 1, seed=8)[0]
    data = sysid.IOData(clean.u, clean.y[:, 0] + noise, plant.Ts)
    fit = sysid.fit(plant.chain, data, search="lm", start=plant.theta)
    told, plain = (
        intervals.gain(i, 0.2).std for i in (sysid.information(fit, data), sysid.information(fit, data, None))
    )
    true = information_at(
        plant.chain,
        plant.theta,
        data,
        noise=NoiseModel(np.array([1.0, -memory]), (0.01 * clean.y.std()) ** 2 * (1 - memory**2)),
    )
    assert told == pytest.approx(intervals.gain(true, 0.2).std, rel=0.2)
    assert (told == plain) == (memory == 0.0)
