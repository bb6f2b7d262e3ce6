"""Comparison, cross-validation and higher-order residual tests."""

import re
from dataclasses import replace

import numpy as np
import pytest
import shown
from scipy.signal import lfilter

import sysid
from sysid.base.criteria import TABLE, Criterion
from sysid.diagnosis.residuals import higher_order_tests
from sysid.excitations import Aprbs
from sysid.notebook.page import criteria_in_words
from sysid.systems import system

INPUTS = {
    "white": lambda rng, N: rng.standard_normal(N),
    "held levels": lambda rng, N: Aprbs(1.0, 1.0, 20.0).generate(N, 1.0, rng),
}


@pytest.mark.parametrize("kind", sorted(INPUTS))
def test_higher_order_bounds_keep_their_level_on_white_residuals(kind):
    """1500 white records: a lag leaves its 99 % bound in 1 % of cases, within 0.3 points; a verdict fails in 1 %,
    within four binomial standard errors (0.26 points each) and twice that where e^2 is far from Gaussian."""
    rng, records = np.random.default_rng(11), 1500
    outside, failed = np.zeros(3), np.zeros(3)
    for _ in range(records):
        found = higher_order_tests(rng.standard_normal(800), INPUTS[kind](rng, 800))
        outside += [t.outside for t in found.tests]
        failed += [not t.passed for t in found.tests]
    np.testing.assert_allclose(outside / records / 26, 0.01, atol=0.003)
    assert np.all(failed / records < 0.01 + 2 * 4 * 0.0026)


def even(seed, N=2000):
    """A linear model of a plant whose input map has a square in it, and the record: u is symmetric about 0."""
    rng = np.random.default_rng(seed)
    u = rng.uniform(-1.0, 1.0, N)
    y = lfilter([0, 0.5, 0.2], [1, -1.2, 0.5], u + 0.1 * (u**2 - 1 / 3)) + 0.2 * rng.standard_normal(N)
    data = sysid.data.preprocess.detrend(sysid.IOData(u, y, 1.0))
    return data, sysid.fit(sysid.structures.output_error(2, 2, 1), data, search="lm", starts=1)


def test_a_missed_even_nonlinearity_is_found_by_u_squared_and_not_by_u():
    linear = higher = 0
    for seed in range(20):
        data, fit = even(seed)
        e = fit.residuals(data)
        plain = fit.residual_tests(data)
        found = higher_order_tests(e, data.u[-len(e) :, 0])
        linear += not (plain.white and plain.independent)
        higher += not found.tests[0].passed
        assert found.passed or any("even nonlinearity" in sentence for sentence in found.advice)
    assert linear <= 3  # chance only
    assert higher == 20


def test_noise_that_grows_with_the_input_and_noise_that_multiplies_it_are_told_apart():
    rng = np.random.default_rng(3)
    u, e = rng.uniform(-1, 1, 4000), rng.standard_normal(4000)
    grows = higher_order_tests(e * (0.5 + u**2), u)
    assert [t.passed for t in grows.tests] == [True, False, True]
    product = e.copy()
    product[1:] += 0.5 * e[:-1] * u[:-1]  # today's error holds yesterday's times the input
    assert [t.passed for t in higher_order_tests(product, u).tests] == [True, True, False]


def test_degenerate_residuals_and_inputs():
    rng = np.random.default_rng(0)
    assert higher_order_tests(np.zeros(200), rng.normal(size=200)).passed
    assert higher_order_tests(rng.normal(size=200), np.sign(rng.normal(size=200))).tests[0].name == "e with u^2"
    with pytest.raises(sysid.InputError, match="same length"):
        higher_order_tests(np.zeros(100), np.zeros(99))
    with pytest.raises(sysid.InputError, match="more than 50"):
        higher_order_tests(np.zeros(50), np.zeros(50))


def plant_fits():
    plant, rng = system("textbook"), np.random.default_rng(1)
    estimation, validation = plant.record(1500, 0.02, rng), plant.record(800, 0.02, rng)
    linear = sysid.structures.output_error(2, 2, 1)
    return plant, estimation, validation, [
        sysid.fit(m, estimation, search="lm", starts=1) for m in (linear, plant.chain)
    ]  # fmt: skip


def test_comparison_ranks_free_runs_and_scores_all_on_the_same_samples():
    _, _, validation, fits = plant_fits()
    table = sysid.compare(validation, *fits, labels=("line", "maps"))
    assert [r.label for r in table.rows] == ["maps", "line"]
    assert [r.rank for r in table.rows] == [1, 2]
    n = max(f.n_init for f in fits)
    assert (table.n_init, table.scored) == (n, 800 - n)
    for row, fit in zip(table.rows, fits[::-1], strict=True):
        y, yhat = validation.y[n:, 0], fit.simulate(validation, n)[n:]
        assert row.fit == pytest.approx(100 * (1 - np.linalg.norm(y - yhat) / np.linalg.norm(y - y.mean())))
        assert row.rmse == pytest.approx(np.sqrt(np.mean((y - yhat) ** 2)))
        assert row.criteria == fit.criteria
        assert row.one_step is None
    assert "free run %" in str(table)
    shown = str(replace(table, y_unit="rad")).splitlines()
    assert "RMSE [deg]" in shown[0]
    assert f"{np.degrees(table.rows[0].rmse):.4g}" in shown[1].split()
    assert table.as_dict()["rows"][0]["criteria"]["d"] == fits[1].criteria.d


def test_a_criterion_that_is_marked_stands_beside_every_model_and_no_other_does(monkeypatch):
    """At a prompt and in a notebook; 6 digits of a likelihood, 4 of what has the unit of y squared."""
    table = sysid.compare(shown.data(), shown.fit(), shown.linear())
    monkeypatch.setitem(TABLE, "new", Criterion(lambda c: 123.4567 * c.d, "NEW", "one more", beside=True))
    d = table.rows[0].criteria.d
    value = f"{123.4567 * d:.6g}"
    head, first, *_ = str(table).splitlines()
    labels = head.split()
    assert {"FPE", "AICc", "NEW"} <= set(labels)
    assert not {"AIC", "nAIC"} & set(labels)
    assert value in first.split()
    assert f"NEW {123.4567 * shown.fit().criteria.d:.6g}, d " in criteria_in_words(shown.fit())
    assert "<th>NEW</th>" in re.sub(r"<th[^>]*>", "<th>", table._repr_html_())
    assert value in table._repr_html_()


def test_comparison_names_what_is_wrong():
    _, _, validation, fits = plant_fits()
    assert [r.label for r in sysid.compare(validation, fits[0], fits[0]).rows] == [
        "output_error (1)",
        "output_error (2)",
    ]
    both = sysid.compare(validation, fits[0], fits[0])
    for text in (str(both), both._repr_html_()):
        assert "is the place of the model in the call" in text
    assert "in the call" not in str(sysid.compare(validation, *fits))
    with pytest.raises(sysid.InputError, match="a different name"):
        sysid.compare(validation, *fits, labels=("a", "a"))
    with pytest.raises(sysid.InputError, match="at least one fit"):
        sysid.compare(validation)
    with pytest.raises(sysid.InputError, match="longer"):
        sysid.compare(validation.select(0, 30), *fits)


def test_cross_validation_predicts_the_fit_on_fresh_data_and_punishes_the_wrong_structure():
    plant, estimation, validation, fits = plant_fits()
    folds = sysid.cross_validate(plant.chain, estimation, folds=4, search="lm", starts=1)
    assert folds.blocks == ((0, 375), (375, 750), (750, 1125), (1125, 1500))
    assert folds.mean == pytest.approx(fits[1].fit_percent(validation), abs=0.3)
    assert all(folds.converged)
    line = sysid.cross_validate(fits[0].model, estimation, folds=4, search="lm", starts=1)
    assert line.mean < folds.mean - 10
    assert folds.rmse < 0.5 * line.rmse
    with pytest.raises(sysid.InputError, match="2 folds or more"):
        sysid.cross_validate(plant.chain, estimation, folds=1)
