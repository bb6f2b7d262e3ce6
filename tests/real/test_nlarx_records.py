"""Nonlinear ARX on records of others, by their own splits, in free run from the first samples of each test record."""

import numpy as np

import sysid
from sysid.solver.iterate import Options
from sysid.structures import nlarx


def rmse(fit, data, drop):
    return float(np.sqrt(np.mean((data.y[drop:, 0] - fit.simulate(data, drop)[drop:]) ** 2)))


def test_silverbox_three_units_beat_the_published_polynomial_narx(records):
    """Published polynomial NARX: 0.64 mV multisine, 2.25 mV arrow, 0.57 mV without extrapolation; linear 6.96 mV."""
    v = np.genfromtxt(records / "silverbox" / "SNLS80mV.csv", delimiter=",", skip_header=1)[:, :2] * 1e3
    whole = sysid.IOData(v[:, 0], v[:, 1], 1 / 610.35)
    model = nlarx(2, 3, 0, units=3, focus="simulation")
    fit = sysid.fit_nlarx(model, whole.select(40650, 105712), starts=1, options=Options(max_iterations=40))
    assert rmse(fit, whole.select(105712, 127400), 50) < 0.5
    assert rmse(fit, whole.select(100, 40575), 50) < 2.25
    assert rmse(fit, whole.select(100, 32100), 50) < 0.5


def test_coupled_drives_two_experiments_in_one_fit(records):
    """A plain output-error fit of both records reaches 0.30 ticks/s on either test part."""
    t = np.genfromtxt(records / "ced" / "DATAUNIF.csv", delimiter=",", skip_header=1)
    both = [sysid.IOData(t[:, i], t[:, i + 2], 0.02) for i in (0, 1)]
    fit = sysid.fit_nlarx(nlarx(3, 3, 1, focus="simulation"), sysid.IOData.merge(*(d.select(0, 400) for d in both)))
    for d in both:
        assert rmse(fit, d.select(400, 500), 10) < 0.2
