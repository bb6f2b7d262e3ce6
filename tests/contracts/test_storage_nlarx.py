"""A saved nonlinear ARX model is the same model bit for bit; a file that is none is named in a sentence."""

import json

import numpy as np
import pytest

import sysid
from sysid import InputError, IOData


@pytest.fixture(scope="module")
def fitted(tmp_path_factory):
    rng = np.random.default_rng(2)
    u, y = rng.uniform(-1.0, 1.0, 500), np.zeros(500)
    for k in range(1, 500):
        y[k] = 0.7 * y[k - 1] + 0.4 * np.tanh(2.0 * u[k - 1])
    data = IOData(u, y + 0.01 * rng.standard_normal(500), 0.1)
    fit = sysid.fit(sysid.structures.nlarx(na=1, nb=1, nk=1, units=3), data)
    return fit, data, fit.save(tmp_path_factory.mktemp("nlarx") / "model.json")


def test_a_saved_network_runs_bit_for_bit_alike(fitted):
    fit, data, path = fitted
    again = sysid.load(path)
    assert fit.network.units == 3
    np.testing.assert_array_equal(again.simulate(data), fit.simulate(data))
    np.testing.assert_array_equal(again.predict(data), fit.predict(data))
    np.testing.assert_array_equal(again.covariance.cov, fit.covariance.cov)
    assert again.fit_percent(data) == fit.fit_percent(data) > 90.0
    assert again.summary() == fit.summary()
    assert again.save(path.with_name("again.json")).read_text() == path.read_text()


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        (lambda d: d["theta"].pop("y0"), "theta does not name the network's"),
        (lambda d: d["theta"].update(y0="nan"), "not all finite"),
        (lambda d: d["network"]["mu"].append(1.0), "the network does not belong to a model of 2 regressors"),
        (lambda d: d["network"].update(wavelets=-1), "theta does not name the network's"),
        (lambda d: d.update(Ts=-1.0), "Ts is -1.0"),
        (lambda d: d.update(version=99), "saved by a newer version"),
        (lambda d: d.update(format="sysid nets"), "not 'sysid fit' or 'sysid nlarx fit'"),
        (lambda d: d.pop("network"), "network"),
    ],
)
def test_a_damaged_file_is_a_sentence(fitted, tmp_path, change, sentence):
    document = json.loads(fitted[2].read_text())
    change(document)
    path = tmp_path / "damaged.json"
    path.write_text(json.dumps(document))
    with pytest.raises(InputError, match=sentence):
        sysid.load(path)


@pytest.mark.parametrize("options", [{"units": "auto"}, {"units": 2, "nonlinear": ()}, {"units": 0}], ids=str)
def test_every_kind_of_network_comes_back(fitted, options, tmp_path):
    """One whose size the fit chose, and linear ones."""
    fit = sysid.fit(sysid.structures.nlarx(na=1, nb=1, nk=1, **options), fitted[1], starts=1)
    again = sysid.load(sysid.save(fit, tmp_path / "model.json"))
    np.testing.assert_array_equal(again.simulate(fitted[1]), fit.simulate(fitted[1]))
    assert again.network.T.shape == fit.network.T.shape
    assert again.model == fit.model
