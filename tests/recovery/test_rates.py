"""One rule for the same sampling time, and resampling by any ratio."""

import numpy as np
import pytest

import sysid
from sysid.base.errors import InputError
from sysid.base.rates import drift_note, same_rate
from sysid.data.resampling import resample
from sysid.workflow.model_run import run_file
from sysid.workflow.saved import Reading

CLOCKS = {  # header, unit in seconds, Ts of the second record [s], ppm by which it is off
    "a few ppm": ("t_s", 1.0, 0.02000004, 2),
    "two crystals": ("time_ms", 1e-3, 0.019998, 100),
    "the largest": ("t_us", 1e-6, 0.020004, 200),
}


def first_order(N: int, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """A held input and the output of y[k] = 0.8 y[k-1] + 0.4 u[k-1]."""
    u = np.repeat(np.random.default_rng(seed).uniform(-1, 1, N // 20), 20)
    y = np.zeros(N)
    for k in range(1, N):
        y[k] = 0.8 * y[k - 1] + 0.4 * u[k - 1]
    return u, y


def write(path, header, unit, Ts, seed):
    u, y = first_order(400, seed)
    rows = [
        f"{header},u,y",
        *(f"{k * Ts / unit:.9g},{float(a)!r},{float(b)!r}" for k, (a, b) in enumerate(zip(u, y, strict=True))),
    ]
    path.write_text("\n".join(rows) + "\n")
    return str(path)


@pytest.fixture(scope="module")
def model(tmp_path_factory):
    u, y = first_order(400, 1)
    fit = sysid.fit(sysid.structures.output_error(nb=1, nf=1, nk=1), sysid.IOData(u, y, 0.02), starts=1)
    path = tmp_path_factory.mktemp("rates") / "model.json"
    sysid.save(fit, path)
    return fit, str(path)


@pytest.mark.parametrize("case", CLOCKS)
def test_a_model_runs_on_a_log_of_another_crystal(case, model, tmp_path):
    header, unit, Ts, ppm = CLOCKS[case]
    result = run_file(model[1], Reading(write(tmp_path / "b.csv", header, unit, Ts, 2)))
    assert result.percent > 99.9
    (note,) = (note for note in result.notes if "ppm" in note)
    assert f"{ppm} ppm {'slower' if Ts > 0.02 else 'faster'} than the model's" in note


def test_another_rate_is_refused_and_its_remedy_works(model, tmp_path):
    path = write(tmp_path / "b.csv", "t_s", 1.0, 0.0202, 2)
    with pytest.raises(InputError, match="add --resample"):
        run_file(model[1], Reading(path))
    assert "no ratio of whole numbers" not in "".join(run_file(model[1], Reading(path, resampled=True)).notes)


def test_all_rooms_take_the_same_rule(model):
    fit, _ = model
    u, y = first_order(400, 3)
    near, far = sysid.IOData(u, y, 0.020002), sysid.IOData(u, y, 0.0202)
    assert sysid.IOData.merge(sysid.IOData(u, y, 0.02), near).Ts == 0.02
    assert sysid.fit_from(fit, fit.model, near).criteria.d == fit.criteria.d
    np.testing.assert_allclose(fit.simulate(near), y[:, None] if fit.simulate(near).ndim == 2 else y, atol=1e-6)
    for refused in (lambda: sysid.IOData.merge(near, far), lambda: sysid.fit_from(fit, fit.model, far)):
        with pytest.raises(InputError):
            refused()


def test_the_note_tells_what_a_drift_does():
    assert drift_note(0.02, 0.02, 1000) == ""
    assert "2.5 samples off" in drift_note(0.0200025, 0.02, 20001)
    assert not same_rate(0.01, 0.0101)
    assert same_rate(0.01, 0.010002)


@pytest.mark.parametrize("Ts", [0.1 * np.pi, 0.1 * np.sqrt(2.0), 0.1 / np.e])
def test_any_ratio(Ts):
    """A slow sine comes out at its values; one above half of the new rate is gone."""
    t = np.arange(3000) * 0.1
    out = resample(sysid.IOData(np.repeat(np.arange(300.0), 10), np.sin(0.5 * t), 0.1), Ts, "held").data
    inside = slice(out.N // 10, -out.N // 10)
    np.testing.assert_allclose(out.y[inside, 0], np.sin(0.5 * out.t)[inside], atol=2e-3)
    assert np.sum(out.u) * Ts == pytest.approx(np.sum(np.repeat(np.arange(300.0), 10)) * 0.1, rel=2e-3)
    if Ts > 0.1:
        fast = np.sin(2 * np.pi * 0.8 / Ts * t)
        assert np.abs(resample(sysid.IOData(t, fast, 0.1), Ts).data.y[inside]).max() < 0.02
