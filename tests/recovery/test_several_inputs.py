"""Two inputs of one output: with defaults every chain comes down to the noise, with the poles of each input."""

import numpy as np
import pytest
from scipy.signal import lfilter

import sysid
from sysid.structures import TABLE

POLES = (0.9, 0.6)
SIZES = np.array([0.01, 300.0])  # of the inputs, each in a unit of its own


@pytest.mark.parametrize("name", ["output_error", "hammerstein", "wiener", "hammerstein_wiener"])
def test_a_plant_of_two_inputs_is_recovered(name):
    rng = np.random.default_rng(7)
    u = np.repeat(rng.normal(size=(300, 2)), 4, axis=0)
    u[:, 1] += 0.5 * u[:, 0]
    bends = (lambda x: np.clip(x, -0.8, 1.0), lambda x: np.sign(x) * np.maximum(np.abs(x) - 0.4, 0.0))
    w = [bend(x) if "hammerstein" in name else x for bend, x in zip(bends, u.T, strict=True)]
    x = sum(lfilter([0.0, 1.0 - pole], [1.0, -pole], wi) for pole, wi in zip(POLES, w, strict=True))
    y = 50.0 * (np.minimum(x, 0.4) if "wiener" in name else x) + 700.0
    noise = 0.01 * np.std(y) * rng.normal(size=len(y))
    data = sysid.IOData(u * SIZES, y + noise)
    fit = sysid.fit(TABLE[name](1, 1, 1).model_of(data), data)
    assert fit.criteria.mse < 1.1 * np.mean(noise**2)
    values = dict(zip(fit.model.names, fit.theta, strict=True))
    assert [-values[f"linear.1,{i}.f1"] for i in (1, 2)] == pytest.approx(POLES, abs=0.01)
