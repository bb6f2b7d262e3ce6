"""ARX models are those of linear least squares, with the intervals of linear regression."""

import json

import numpy as np
import pytest

import sysid
from sysid import IOData
from sysid.structures import Arx, arx
from sysid.uncertainty import intervals
from sysid.uncertainty.information import information
from twin.cli import main


def record(seed, N=400, level=0.0, loop=0.0):
    """A plant with white noise in its equation, of poles 0.75 +- 0.37j or, under a controller, one at 1.05."""
    rng = np.random.default_rng(seed)
    r, u, y = np.repeat(rng.normal(size=N // 5), 5), np.zeros(N), np.zeros(N)
    a1, a2 = (-1.55, 0.525) if loop else (-1.5, 0.7)
    for t in range(N):
        if t >= 2:
            y[t] = -a1 * y[t - 1] - a2 * y[t - 2] + 0.5 * u[t - 1] + 0.3 * u[t - 2] + 0.1 * rng.normal()
        u[t] = loop * (r[t] - y[t]) if loop else r[t]
    return IOData(u + level, y, 0.1)


def regression(data, nb, nf, nk, constant):
    """b, f, standard deviations and the loss by numpy, over the samples that have all their past."""
    u, y, N = data.u[:, 0], data.y[:, 0], data.N
    n = max(nf, nk + nb - 1)
    columns = [u[n - nk - i : N - nk - i] for i in range(nb)] + [-y[n - j : N - j] for j in range(1, nf + 1)]
    X = np.column_stack([*columns, *([np.ones(N - n)] if constant else [])])
    values = np.linalg.lstsq(X, y[n:], rcond=None)[0]
    e = y[n:] - X @ values
    std = np.sqrt(float(e @ e) / (N - n - X.shape[1]) * np.diag(np.linalg.inv(X.T @ X)))
    return values[: nb + nf], std[: nb + nf], float(e @ e)


@pytest.mark.parametrize("offset", ["none", "free"])
@pytest.mark.parametrize("loop", [0.0, 0.5])
@pytest.mark.parametrize("orders", [(2, 2, 1), (1, 3, 0), (3, 1, 2)])
def test_values_deviations_and_loss_are_those_of_numpy(orders, loop, offset):
    data = record(1, level=4.0 if offset == "free" else 0.0, loop=loop)
    values, std, loss = regression(data, *orders, offset == "free")
    fit = sysid.fit(arx(*orders, offset=offset), data)
    own = [p for p in fit.parameters if p.name.startswith(("linear.b", "linear.f"))]
    # With an offset before B the model is not linear in its parameters, and values end on the grid of the search.
    near = 1e-9 * np.abs(values) if offset == "none" else 0.01 * std
    assert np.all(np.abs([p.value for p in own] - values) < near)
    assert fit.criteria.mse * data.N == pytest.approx(loss, rel=1e-6)
    known = intervals.parameters(information(fit, data, lags=None))
    np.testing.assert_allclose([known[p.name].std for p in own], std, rtol=1e-4)
    assert all(p.value == 0.0 and not p.free for p in fit.parameters if p.name.startswith("linear.c"))


def test_a_plant_in_a_loop_by_the_command_line(tmp_path, monkeypatch, capsys):
    """Judged by predictions, since a free run of a pole at 1.05 says nothing."""
    monkeypatch.chdir(tmp_path)
    data = record(2, N=1000, loop=0.5)
    rows = np.column_stack([data.u, data.y])
    np.savetxt("loop.csv", rows, delimiter=",", header="u,y", comments="")
    words = "identify loop.csv --ts 0.1 --structure arx --orders 2,2,1 --out run --json"
    assert main(words.split()) == 0
    summary = json.loads(capsys.readouterr().out)
    assert summary["criteria_of"] == "one step ahead"
    assert max(pole["re"] for pole in summary["poles"]) == pytest.approx(1.05, abs=0.03)
    assert main(["run", "run/model.json", "loop.csv", "--ts", "0.1", "--horizon", "3"]) == 0
    assert Arx(2, 2, 1).as_subject() == "An ARX (nb 2, nf 2, nk 1) model"
