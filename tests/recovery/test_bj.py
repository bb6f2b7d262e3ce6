"""Box-Jenkins models: the predictor against SciPy, drawn plants in drawn noise, and what a report says of them."""

import json

import numpy as np
import pytest
from often import FULL, often
from scipy.signal import lfilter

import sysid
from sysid import InputError, IOData
from sysid.base.poles import pairs
from sysid.structures import BoxJenkins, bj, output_error
from sysid.uncertainty import intervals
from sysid.uncertainty.information import information
from twin.cli import main


def roots(rng, n):
    """Coefficients (n,) with roots of time constants up to 20 samples, some complex, some negative."""
    z = []
    while len(z) < n:
        size = 1.0 - np.exp(rng.uniform(np.log(0.05), np.log(0.7)))
        if n - len(z) >= 2 and rng.uniform() < 0.5:
            pole = size * np.exp(1j * rng.uniform(0.1, 1.5))
            z += [pole, pole.conj()]
        else:
            z.append(size if rng.uniform() < 0.8 else -size)
    return np.real(np.poly(z))[1:] if n else np.zeros(0)


def drawn(seed):
    """A chain, its true theta and a record: 300 to 3000 samples, noise of -5 to -40 dB, a constant at the input."""
    rng = np.random.default_rng([39, seed])
    nb, nf, nk = rng.integers(1, 4), rng.integers(1, 4), rng.integers(0, 4)
    nc, nd = rng.integers(0, 3), rng.integers(0, 3)
    N, hold = int(np.exp(rng.uniform(np.log(300), np.log(3000)))), rng.integers(1, 8)
    u = np.repeat(rng.normal(size=N // hold + 1), hold)[:N]
    f, b, c, d = roots(rng, nf), rng.normal(size=nb), roots(rng, nc), roots(rng, nd)
    x = lfilter(np.r_[np.zeros(nk), b], np.r_[1.0, f], u)
    v = lfilter(np.r_[1.0, c], np.r_[1.0, d], rng.normal(size=N + 500))[500:]
    v *= np.std(x) / np.std(v) * 10.0 ** (-rng.uniform(5.0, 40.0) / 20.0)
    level, chain = rng.normal(), bj(*(int(k) for k in (nb, nf, nk, nc, nd)))
    theta = np.concatenate([[level], b, f, np.zeros(chain.blocks[-1].n_state), c, d])
    return chain, theta, IOData(u - level, x + v, 0.1)


@pytest.mark.parametrize(
    "orders", [(2, 2, 1, 1, 1), (1, 3, 0, 0, 2), (3, 1, 2, 2, 0), (2, 2, 1, 0, 0), (1, 0, 1, 2, 3)]
)
def test_prediction_and_tangent_are_those_of_scipy_and_of_differences(orders):
    model, rng = bj(*orders), np.random.default_rng(3)
    block, theta = model.blocks[-1], 0.3 * rng.normal(size=len(model.names))
    u, y = rng.normal(size=80), rng.normal(size=(80, 1))
    value = dict(zip(model.names, theta, strict=True))
    b, f, c, d = ([v for n, v in value.items() if n.startswith(f"linear.{letter}")] for letter in "bfcd")
    x0 = np.r_[[v for n, v in value.items() if "x0_" in n], np.zeros(80)][:80]
    x = lfilter(np.r_[np.zeros(orders[2]), b], np.r_[1.0, f], u + value["offset.y0"]) + lfilter(
        [1.0], np.r_[1.0, f], x0
    )
    e = lfilter(np.r_[1.0, d], np.r_[1.0, c], y[:, 0] - x)
    predicted, J = model.tangent(theta, u, y)
    np.testing.assert_allclose(y[:, 0] - predicted, e, rtol=1e-9, atol=1e-9 * np.abs(e).max())
    np.testing.assert_allclose(model.simulate(theta, u), x, rtol=1e-9, atol=1e-9)
    for i in range(len(theta)):
        h = 1e-6 * np.eye(len(theta))[i]
        difference = (model.outputs(theta + h, u, y) - model.outputs(theta - h, u, y))[:, 0] / 2e-6
        np.testing.assert_allclose(J[:, i], difference, atol=1e-6 * max(1.0, np.abs(J).max()), err_msg=model.names[i])
    # Further ahead: the noise goes on without errors.
    response = lfilter(np.r_[1.0, c], np.r_[1.0, d], np.eye(1, 80)[0])
    for horizon in (2, 5):
        known = np.array([[e[s] * response[t - s] if s <= t - horizon else 0.0 for s in range(80)] for t in range(80)])
        ahead = block.ahead(model.part(theta, block), u + value["offset.y0"], y[:, 0], horizon)
        np.testing.assert_allclose(ahead, x + known.sum(axis=1), rtol=1e-9, atol=1e-9 * np.abs(y).max())


def test_drawn_plants_are_found_and_their_intervals_hold():
    """The loss of a search that begins at the truth, and gain and poles within 95 % intervals.

    Of 640 such records 639 came to that loss within 0.1 %, 93 % of the gains and of the poles held.
    """
    gains, poles = [], []
    for seed in sorted({*often(60, 15), 23}):  # of 23, C and D that nearly cancel have an optimum of their own
        model, theta, data = drawn(seed)
        fit = sysid.fit(model, data)
        assert fit.criteria.loss < (1.0 + 1e-3) * sysid.fit(model, data, start=theta).criteria.loss, seed
        known, block = information(fit, data), model.blocks[-1]
        true = theta[model.index(block)]
        gain = intervals.gain(known)
        gains.append(gain.lower <= block.gain(true) <= gain.upper)
        found, right = intervals.poles(known), block.poles(true)
        for i, j in zip(*pairs(np.array([root.value for root in found]), right), strict=True):
            if right[j].imag >= 0.0 and not found[i].note:  # a note says that the interval is not one of 95 %
                poles.append(found[i].real.lower <= right[j].real <= found[i].real.upper)
    assert min(np.mean(gains), np.mean(poles)) >= (0.88 if FULL else 0.8)


def coloured(seed, N=1000):
    """A resonant plant in slow noise and, beside it, without noise."""
    rng = np.random.default_rng(seed)
    u = np.repeat(rng.normal(size=N // 5), 5)
    x = lfilter([0.0, 0.4, 0.2], [1.0, -1.5, 0.7], u)
    v = lfilter([1.0, 0.5], [1.0, -0.97], 0.1 * rng.normal(size=N))
    return IOData(u, x + v + 5.0, 0.1), IOData(u, x + 5.0, 0.1)


def test_slow_noise_costs_output_error_precision_and_box_jenkins_none():
    """Of 20 records of one plant, the spread of its poles."""
    spreads = []
    for model in (bj(2, 2, 1, 1, 1), output_error(2, 2, 1, offset="free")):
        f1 = [sysid.fit(model, coloured(seed)[0]).poles.real[0] for seed in range(20)]
        spreads.append(np.sqrt(np.mean((np.array(f1) - 0.75) ** 2)))
    assert spreads[0] < 0.5 * spreads[1]


def test_the_spread_of_errors_is_that_of_predictions():
    data, _ = coloured(1, 4000)
    fit = sysid.fit(bj(2, 2, 1, 1, 1), data)
    block = fit.model.blocks[-1]
    spread = 0.1 * block.error_spread(fit.model.part(fit.theta, block), 12)
    for horizon in (1, 4, 12):
        errors = (fit.predict(data, horizon=horizon) - data.y[:, 0])[200:]
        assert np.std(errors) == pytest.approx(spread[horizon - 1], rel=0.1)
    assert fit.residual_tests(data).white


def test_a_record_by_the_command_line(tmp_path, monkeypatch, capsys):
    """Judged by the free run; k samples ahead only where it is asked for, and called so."""
    monkeypatch.chdir(tmp_path)
    data, _ = coloured(2)
    np.savetxt("log.csv", np.column_stack([data.u, data.y]), delimiter=",", header="u,y", comments="")
    words = "identify log.csv --ts 0.1 --structure bj --orders 2,2,1,1,1 --out run --json"
    assert main(words.split()) == 0
    summary = json.loads(capsys.readouterr().out)
    assert summary["criteria_of"] == "one step ahead"
    assert summary["setting"]["orders"] == {"nb": 2, "nf": 2, "nk": 1, "nc": 1, "nd": 1}
    assert summary["poles"][0]["re"] == pytest.approx(0.75, abs=0.01)
    assert main(["run", "run/model.json", "log.csv", "--ts", "0.1", "--horizon", "3"]) == 0
    told = capsys.readouterr().out
    assert "Predicted 3 sample(s) ahead from measured outputs" in told
    assert main(["identify", "log.csv", "--ts", "0.1", "--structure", "bj", "--from", "run/model.json", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["setting"]["orders"] == summary["setting"]["orders"]
    assert BoxJenkins(2, 2, 1).as_subject() == "A Box-Jenkins (nb 2, nf 2, nk 1, nc 2, nd 2) model"


def test_orders_and_offsets_that_are_none_are_refused():
    with pytest.raises(InputError, match=r"nc.*-1"):
        bj(nc=-1)
    for structure in (bj, sysid.structures.arx, sysid.structures.armax):
        with pytest.raises(InputError, match="offset 'fre'"):
            structure(offset="fre")
