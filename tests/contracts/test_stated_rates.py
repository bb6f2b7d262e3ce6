"""The sampling time that a file states beside its arrays, under the names that writers use."""

import json

import numpy as np
import pytest
from scipy.io import savemat

from sysid.workflow.record import read_record

U = np.repeat(np.random.default_rng(0).uniform(-1.0, 1.0, 40), 5)
SIGNALS = {"u": U, "y": np.cumsum(U)}
STATED = {
    "Ts": ({"Ts": 0.02, **SIGNALS}, 0.02),
    "dt": ({"dt": 0.02, **SIGNALS}, 0.02),
    "fs": ({"fs": 50, **SIGNALS}, 0.02),
    "fs that is rounded": ({"fs": 30.0, **SIGNALS}, 1.0 / 30.0),
    "in a part": ({"meta": {"rig": "a", "fs": 50.0}, "data": SIGNALS}, 0.02),
    "dt and fs": ({"dt": 0.0333333333333, "fs": 30.0, **SIGNALS}, 1.0 / 30.0),
    "Ts before the dt of a simulation": ({"dt": 0.001, "Ts": 0.02, **SIGNALS}, 0.02),
    "a clock before the dt of a simulation": ({"dt": 0.001, "t": 0.02 * np.arange(len(U)), **SIGNALS}, 0.02),
}


@pytest.mark.parametrize("kind", STATED)
@pytest.mark.parametrize("form", ["json", "mat"])
def test_a_stated_sampling_time_is_read_under_its_usual_names(kind, form, tmp_path):
    content, Ts = STATED[kind]
    path = tmp_path / f"log.{form}"
    if form == "mat":
        savemat(path, content)
    else:
        path.write_text(json.dumps(content, default=lambda each: each.tolist()), encoding="utf-8")
    data = read_record(path).data
    assert (data.N, data.Ts) == (len(U), pytest.approx(Ts, rel=1e-9))
    np.testing.assert_array_equal(data.u[:, 0], U)


def test_experiments_under_one_dt_have_it(tmp_path):
    path = tmp_path / "log.json"
    experiments = [{name: values[:n].tolist() for name, values in SIGNALS.items()} for n in (100, 150, 200)]
    path.write_text(json.dumps({"dt": 0.02, "experiments": experiments}), encoding="utf-8")
    data = read_record(path).data
    assert (tuple(data.lengths), data.Ts) == ((100, 150, 200), 0.02)
