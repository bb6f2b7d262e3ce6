"""Records in units that no plant has: refused in a sentence before anything is computed with them, or done in full."""

import numpy as np
import pytest

from sysid.base.errors import InputError
from sysid.data.record import IOData
from sysid.diagnosis.advice import advise
from sysid.diagnosis.residuals import higher_order_tests
from sysid.workflow.identification import identify_file
from sysid.workflow.setting import Setting
from twin.cli import main, recipes

pytestmark = pytest.mark.pixels


def record(u_unit=1.0, y_unit=1.0):
    """Input and output (300,) of a filter with one pole."""
    rng = np.random.default_rng(0)
    u, y = rng.normal(size=300), np.zeros(300)
    for t in range(1, 300):
        y[t] = 0.7 * y[t - 1] + 0.3 * u[t - 1]
    return u_unit * u, y_unit * (y + 0.01 * rng.normal(size=300))


def log(folder, *units):
    path = folder / "log.csv"
    table = np.column_stack([0.1 * np.arange(300), *record(*units)])
    np.savetxt(path, table, delimiter=",", header="time,u,y", comments="")
    return str(path)


@pytest.mark.parametrize("units", [(1e160, 1.0), (1.0, 1e160), (1e-165, 1.0), (1.0, 1e-165)])
def test_identify_refuses_numbers_that_no_plant_has(tmp_path, capsys, units):
    path = log(tmp_path, *units)
    assert main(["identify", path, "--structure", "output_error", "--out", str(tmp_path / "run")]) == 2
    told = capsys.readouterr().err.strip().splitlines()[-1]
    assert told.startswith(f"qpal: {path}")
    assert "unit" in told
    assert not (tmp_path / "run").exists()


@pytest.mark.parametrize("units", [(1e-165, 1.0), (1.0, 1e-165)])
def test_diagnosis_refuses_what_no_fit_takes(tmp_path, capsys, units):
    with pytest.raises(InputError, match="rescale the signal to another unit"):
        advise(IOData(*record(*units), 0.1))
    assert main(["info", log(tmp_path, *units), "--out", str(tmp_path / "run")]) == 0
    assert "rescale the signal to another unit" in capsys.readouterr().out


FAR = [(1e-59, 1.0), (1.0, 1e58), (1e-59, 1e58)]
FARTHER = [(1.0, 1e-59), (1e58, 1.0), (1e-29, 1.0), (1.0, 1e-29)]


@pytest.mark.parametrize("units", [*FAR, *(pytest.param(each, marks=pytest.mark.nightly) for each in FARTHER)])
def test_numbers_that_a_fit_takes_pass_every_diagnosis(tmp_path, units):
    """What is found has other units and is the same otherwise; a warning would fail the test."""
    setting = Setting(recipes.recipe("output_error", {}), "auto", 1, 0)
    plain = identify_file(log(tmp_path), setting, "u", "y", time="time").evaluation
    odd = identify_file(log(tmp_path, *units), setting, "u", "y", time="time").evaluation
    gain = units[1] / units[0]
    assert odd.validation_fit == pytest.approx(plain.validation_fit, rel=1e-3)
    for one, other in zip(odd.roots, plain.roots, strict=True):
        assert abs(one.value - other.value) < 1e-3
        assert one.note == other.note or not 1e-30 < gain < 1e30, "rows of J further apart count as empty"
    shown = min(len(odd.step.y), len(plain.step.y))  # the time that is shown follows the slowest pole
    assert shown > 100
    np.testing.assert_allclose(odd.step.y[:shown] / gain, plain.step.y[:shown], atol=1e-3)


@pytest.mark.parametrize("factor", [2.0**300, 2.0**-300])
def test_correlations_of_residuals_have_no_unit(factor):
    rng = np.random.default_rng(1)
    e, u = rng.normal(size=(2, 400))
    for scaled in (higher_order_tests(factor * e, u), higher_order_tests(e, factor * u)):
        for one, other in zip(scaled.tests, higher_order_tests(e, u).tests, strict=True):
            np.testing.assert_array_equal(one.correlation, other.correlation)
            assert one.bound == other.bound
