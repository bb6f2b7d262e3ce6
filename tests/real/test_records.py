"""Real records of others, by their own splits (free run; see the folder's README for protocol and source)."""

import numpy as np
import pytest

import sysid
from sysid.data.preprocess import detrend, quick_start


def rmse(fit, data, n_init, drop=None):
    """Free-run RMSE without the first `drop` samples, by default the `n_init` ones that give the initial state."""
    drop = n_init if drop is None else drop
    return float(np.sqrt(np.mean((data.y[drop:, 0] - fit.simulate(data, n_init)[drop:]) ** 2)))


def test_hair_dryer_reaches_85_percent_on_the_second_half(records):
    table = np.loadtxt(records / "daisy" / "hair_dryer.dat")
    estimation, validation = quick_start(sysid.IOData(table[:, 0], table[:, 1], 0.08))
    fit = sysid.fit(sysid.structures.output_error(2, 3, 1), estimation)
    assert len(fit.poles) == 3
    assert fit.fit_percent(validation) > 85.0


def test_silverbox_linear_row(records):
    """OE of two poles: 6.96 mV on the multisine and 14.4 mV on the arrow are the published linear values."""
    v = np.genfromtxt(records / "silverbox" / "SNLS80mV.csv", delimiter=",", skip_header=1)[:, :2] * 1e3
    whole = detrend(sysid.IOData(v[:, 0], v[:, 1], 1 / 610.35))
    fit = sysid.fit(sysid.structures.output_error(3, 2, 0), whole.select(40650, 105712), starts=1)
    assert rmse(fit, whole.select(105712, 127400), 50) == pytest.approx(6.96, abs=0.05)
    assert rmse(fit, whole.select(100, 40575), 50) == pytest.approx(14.4, abs=0.1)


def test_cascaded_tanks_linear_row(records):
    """OE of two poles scores 0.600 V on the test record, the linear row of the literature 0.588 V."""
    t = np.genfromtxt(records / "cascaded_tanks" / "dataBenchmark.csv", delimiter=",", skip_header=1)
    u0, y0 = t[:, 0].mean(), t[:, 2].mean()
    fit = sysid.fit(sysid.structures.output_error(2, 2, 1), sysid.IOData(t[:, 0] - u0, t[:, 2] - y0, 4.0))
    assert rmse(fit, sysid.IOData(t[:, 1] - u0, t[:, 3] - y0, 4.0), 50) == pytest.approx(0.600, abs=0.03)


def test_coupled_drives_are_learned_by_a_general_state_space(records):
    """Below 0.10 ticks/s on both tests, where the best listed are 0.115 and 0.074: the sensor is blind to the sign.

    The free run begins with the record, 400 samples before the test.
    """
    t = np.genfromtxt(records / "ced" / "DATAUNIF.csv", delimiter=",", names=True)
    pairs = [sysid.IOData(t[u], t[z], 0.02) for u, z in (("u11", "z11"), ("u12", "z12"))]
    training = sysid.IOData.merge(*(pair.select(0, 400) for pair in pairs))
    fit = sysid.fit(sysid.structures.state_space(4, 6), training)
    assert all(rmse(fit, pair, 50, 410) < 0.10 for pair in pairs)
    # The protocol's own start: ten outputs of the test give the four states. Least squares has 0.13 and 0.24.
    assert all(rmse(fit, pair.select(400, 500), 10) < 0.10 for pair in pairs)


def test_cascaded_tanks_are_learned_by_a_state_space_with_its_defaults(records):
    """0.23 to 0.41 V over eight seeds, where a linear model has 0.60, a polynomial NARX 0.41 and a grey box 0.19 V."""
    t = np.genfromtxt(records / "cascaded_tanks" / "dataBenchmark.csv", delimiter=",", skip_header=1)
    fit = sysid.fit(sysid.structures.state_space(), sysid.IOData(t[:, 0], t[:, 2], 4.0))
    assert rmse(fit, sysid.IOData(t[:, 1], t[:, 3], 4.0), 50) < 0.45
