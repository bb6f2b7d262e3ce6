"""An input that a controller computes from the output of its own sample is told from one that drives a plant."""

import numpy as np
import pytest
from often import by_day, often
from scipy.signal import lfilter

from sysid.data.record import IOData
from sysid.diagnosis.advice import advise
from sysid.diagnosis.relation import COMPUTED


def loop(seed, kp, ki=0.0, kd=0.0, digits=None):
    """A lag of 20 samples under noise in a loop whose goal does not change."""
    rng = np.random.default_rng(seed)
    y, u, total = np.zeros(500), np.zeros(500), 0.0
    for t in range(1, 500):
        y[t] = 0.95 * y[t - 1] + 0.1 * u[t - 1] + 0.02 * rng.standard_normal()
        y[t] = y[t] if digits is None else round(y[t], digits)
        total += 1.0 - y[t]
        u[t] = kp * (1.0 - y[t]) + ki * total - kd * (y[t] - y[t - 1])
        u[t] = u[t] if digits is None else round(u[t], digits)
    return IOData(u, y, 0.02)


def told(data):
    return any(COMPUTED in a.sentence and a.severity == "warning" for a in advise(data) if a.topic == "feedback")


@pytest.mark.parametrize("digits", [None, 5])
@pytest.mark.parametrize("gains", [(1.5,), (1.0, 0.05), (1.0, 0.0, 2.0)], ids=["P", "PI", "PD"])
def test_a_controller_at_a_constant_goal_is_seen(gains, digits):
    assert all(told(loop(seed, *gains, digits=digits)) for seed in often(3, 1))


def test_an_input_that_follows_from_its_own_past_is_not():
    t = np.arange(500)
    for seed in often(3, 1):
        rng = np.random.default_rng([seed, 10])
        u = np.sin(0.21 * t) + 0.5 * np.sin(0.05 * t + seed)
        assert not told(IOData(u, lfilter([0.0, 0.2], [1.0, -0.8], u) + 0.01 * rng.standard_normal(500), 0.1))


@pytest.mark.parametrize("digits", [None, 3])
@pytest.mark.parametrize("noise", by_day([0.0, 0.01, 0.05], 0.0, 0.01))
@pytest.mark.parametrize("nk", [0, 1])
def test_an_input_that_drives_a_plant_is_not(nk, noise, digits):
    """Only without noise and delay does each signal follow from the other, and no test can tell which is computed."""
    for seed in often(6, 2):  # one of each kind of input
        rng = np.random.default_rng([seed, 9])
        u = np.repeat(rng.uniform(-1.0, 1.0, 125), 4) if seed % 2 else rng.standard_normal(500)
        u = u if digits is None else np.round(u, digits)
        y = lfilter([*[0.0] * nk, 0.2], [1.0, -0.8], u) + noise * rng.standard_normal(500)
        y = y if digits is None else np.round(y, digits)
        assert told(IOData(u, y, 0.1)) == (nk == 0 and noise == 0.0)
