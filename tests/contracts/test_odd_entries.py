"""Calls with what is no entry of theirs, or with nothing, are refused in a sentence."""

import numpy as np
import pytest

import sysid
import twin
from sysid import InputError
from sysid.uncertainty import intervals


def record(missing=False):
    rng = np.random.default_rng(0)
    u, y = np.repeat(rng.uniform(-1.0, 1.0, 60), 5), np.zeros(300)
    for t in range(1, 300):
        y[t] = 0.8 * y[t - 1] + 0.5 * u[t - 1]
    y += 0.01 * rng.standard_normal(300)
    return sysid.IOData(u, y, Ts=0.1, missing=(np.arange(300) == 40) if missing else None)


@pytest.mark.parametrize("missing", [False, True])
@pytest.mark.parametrize("span", [(3, 3), (5, 3)])
def test_a_selection_of_no_sample(missing, span):
    with pytest.raises(InputError, match=r"the record has 0 sample\(s\); at least 2 are needed"):
        record(missing).select(*span)


@pytest.mark.parametrize("figure", ["static_maps", "free_runs"])
def test_a_figure_of_nothing(figure):
    with pytest.raises(InputError, match="nothing is given to draw"):
        getattr(sysid.plots, figure)([])


def test_values_that_are_no_table():
    for made in (sysid.structures.output_error, sysid.structures.coupled_drives):
        with pytest.raises(InputError, match="fixed is '1e3'; give a dict"):
            made(fixed="1e3")
    with pytest.raises(InputError, match="fixed is '1e3'; give a dict"):
        sysid.structures.output_error(offset="free", fixed="1e3")
    kept = sysid.structures.output_error(offset="free", fixed={"linear.f1": -0.5}).fixed
    assert kept == {"linear.f1": -0.5}


def test_bytes_are_no_blocks():
    with pytest.raises(InputError, match="blocks has 49; give a Block for each"):
        sysid.Chain(bytearray(b"12"))


def test_a_draw_that_an_experiment_has_not():
    with pytest.raises(InputError, match=r"noise!.*excitation"):
        twin.Experiment(joint="thigh", duration=2.0).generator("noise!")


def test_a_fit_remembers_records_only_and_a_name_is_text(tmp_path):
    fit = sysid.fit(sysid.structures.output_error(1, 1, 1), record(), starts=1)
    with pytest.raises(InputError, match="data is a ndarray; give the record of the fit"):
        fit.remember(np.zeros(3))
    assert fit.record is not None
    with pytest.raises(InputError, match="is not UTF-8 text; give another name"):
        fit.save(f"{tmp_path}/\ud800.json")
    with pytest.raises(InputError, match=r"u is .*give the constant inputs as one row of numbers"):
        intervals.steady_state(sysid.information(fit, record()), u=np.zeros((5, 1)))
