"""Several logs with a zero of their own each, as on other days: `offset="each"`."""

import json

import numpy as np
import pytest
from scipy.signal import lfilter

import sysid
from sysid import IOData
from sysid.base.criteria import fit_percent
from twin.cli import main

S = sysid.structures
ZEROS = (4.0, -3.0, 11.0, 0.5)
NOISE = 0.05
MODELS = {
    "process": S.process,
    "output_error": lambda offset: S.output_error(1, 1, 1, offset=offset),
    "hammerstein": lambda offset: S.hammerstein(1, 1, 1, offset=offset),
    "armax": lambda offset: S.armax(1, 1, 1, offset=offset),
}


def log(k: int, at_input: bool = False, N: int = 360) -> IOData:
    """y = 0.5 q^-1 / (1 - 0.9 q^-1) u, with the zero of day k at its output, or as a load at its input."""
    rng = np.random.default_rng(k)
    u = np.repeat(rng.uniform(-1.0, 1.0, N // 12), 12)
    y = lfilter([0.0, 0.5], [1.0, -0.9], u + at_input * ZEROS[k])
    return IOData(u, y + (not at_input) * ZEROS[k] + NOISE * rng.standard_normal(N), 1.0)


@pytest.mark.parametrize("name", MODELS)
def test_a_plant_is_found_from_logs_of_other_zeros_and_follows_a_day_of_its_own(name):
    at_input = name == "armax"
    *days, other = (log(k, at_input) for k in range(4))
    fit = sysid.fit(MODELS[name](offset="each"), IOData.merge(*days), starts=2)
    assert np.abs(fit.poles) == pytest.approx([0.9], abs=0.003)
    n = fit.n_init
    ceiling = fit_percent(other.y[n:], other.y[n:] + NOISE * np.random.default_rng(9).standard_normal((other.N - n, 1)))
    assert fit.fit_percent(other) > ceiling - 1.5
    one_zero = sysid.fit(MODELS[name](offset="free"), IOData.merge(*days), starts=2)
    assert one_zero.criteria.bic > fit.criteria.bic + 500.0


def test_the_zero_of_the_first_log_is_the_level_of_a_run_from_rest_and_of_what_is_exported():
    fit = sysid.fit(S.process(offset="each"), IOData.merge(*(log(k) for k in range(3))))
    run = fit.simulate(np.zeros(5))
    assert run == pytest.approx(np.full(5, ZEROS[0]), abs=0.1)
    module: dict = {}
    exec(sysid.export.python.source(fit), module)
    np.testing.assert_allclose(module["simulate"]([0.0, 1.0, 1.0, -0.5]), fit.simulate([0.0, 1.0, 1.0, -0.5]))


def test_the_command_proposes_it_and_its_promise_holds(tmp_path, capsys):
    for k in range(2):
        data = log(k, N=600)
        rows = (f"{t:g},{u:.6f},{y:.6f}\n" for t, u, y in zip(range(600), data.u[:, 0], data.y[:, 0], strict=True))
        (tmp_path / f"day{k}.csv").write_text("time [s],u,y\n" + "".join(rows))
    logs = [str(tmp_path / f"day{k}.csv") for k in range(2)]
    options = ["--structure", "output_error", "--orders", "1,1,1", "--starts", "1"]
    main(["identify", *logs, *options, "--trials", "20", "--out", str(tmp_path / "one")])
    (line,) = [line for line in capsys.readouterr().out.splitlines() if line.startswith("Next, ")]
    promise, command = line.split(": ", 1)
    assert "--offset each" in command
    main(["identify", *logs, *options, "--offset", "each", "--trials", "0", "--out", str(tmp_path / "each")])
    reached = json.loads((tmp_path / "each" / "summary.json").read_text())["fit_percent"]["validation"]
    assert promise.startswith(f"Next, {reached:.2f} % instead of ")


def test_the_zero_of_a_record_is_found_beside_a_state_that_is_slow():
    """A lag of 150 samples: over 50 of them its state and a zero are hardly told apart."""
    rng, pole, off = np.random.default_rng(0), np.exp(-1.0 / 150.0), []

    def slow(zero: float) -> IOData:
        u = np.repeat(rng.uniform(0.0, 1.0, 8), 150)
        y = lfilter([0.0, 1.0 - pole], [1.0, -pole], u)
        return IOData(u[400:], (zero + y + 0.005 * rng.standard_normal(len(u)))[400:], 1.0)

    fit = sysid.fit(S.process("P1", offset="each"), IOData.merge(slow(2.0), slow(-1.0)))
    for zero in np.linspace(-4.0, 4.0, 24):
        record = slow(zero)
        errors = (record.y[:, 0] - fit.simulate(record, n) for n in (None, 50))
        off.append([np.mean(e[fit.n_init :]) for e in errors])
    found, by_50 = np.std(off, axis=0)
    assert found < 0.6 * by_50
