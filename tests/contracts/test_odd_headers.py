"""Headers of logs that hold no header: the clock and the columns are read, and nothing else is believed."""

import json

import numpy as np
import pytest

import sysid
import twin

DEEP = "[" * 100_000 + "]" * 100_000
ODD = ["[1,2]", "null", "3", '"x"', "{", "", DEEP, '{"Ts": null}', '{"Ts": [1]}', '{"Ts": "x"}', '{"Ts": 1e999}']
ODD += ['{"Ts": NaN}', '{"Ts": true}', '{"Ts": -1}', '{"joint": [1]}', '{"joint": "knee"}', '{"parameters": 3}']


@pytest.fixture(scope="module")
def lines(tmp_path_factory):
    path = tmp_path_factory.mktemp("log") / "leg.csv"
    twin.Experiment("thigh", "aprbs", 10.0).run().save(path)
    return path.read_text().splitlines()


@pytest.mark.parametrize("header", ODD, ids=lambda text: text[:20] or "none")
def test_a_header_that_is_none_is_not_believed(header, lines, tmp_path):
    (tmp_path / "leg.csv").write_text("\n".join([f"# qpal: {header}", *lines[1:], ""]))
    data, log = sysid.read(tmp_path / "leg.csv"), twin.Log.load(tmp_path / "leg.csv")
    assert data.Ts == pytest.approx(0.1)
    assert log.Ts == pytest.approx(0.1)
    u, y = np.loadtxt(lines[2:], delimiter=",", usecols=(1, 2), unpack=True)
    np.testing.assert_allclose(data.u[:, 0], u)
    np.testing.assert_allclose(log.y if log.y.ndim == 1 else log.y[:, 0], y)


@pytest.mark.parametrize("entry", ["joint", "parameters", "mode", "options", "seed", "duration", "realisation"])
@pytest.mark.parametrize("value", [None, [1], {"x": None}])
def test_an_entry_of_another_kind_keeps_the_record(entry, value, lines, tmp_path):
    header = {**json.loads(lines[0].removeprefix("# qpal: ")), entry: value}
    (tmp_path / "leg.csv").write_text("\n".join([f"# qpal: {json.dumps(header)}", *lines[1:], ""]))
    log = twin.Log.load(tmp_path / "leg.csv")
    assert len(log.y) == len(lines) - 2
    assert log.joint in ("", "thigh", None)
