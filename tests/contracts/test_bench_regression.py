"""Comparison of two results tables: made-up changes are named with their numbers, and noise is not called a change."""

from pathlib import Path

import numpy as np
import polars as pl
import pytest
from fakes import elsewhere, rows, run_of_the_library
from scipy.stats import binom

from sysid.base.errors import InputError
from sysid.bench.regression import ALARM, compare
from sysid.data.record import IOData


@pytest.fixture
def base() -> pl.DataFrame:
    return run_of_the_library(np.random.default_rng(3))


def of(method: str) -> pl.Expr:
    return pl.col("method") == method


def changed(table: pl.DataFrame, method: str, **new: pl.Expr) -> pl.DataFrame:
    """The table with new values of some columns in the rows of one method."""
    return table.with_columns(pl.when(of(method)).then(e).otherwise(name).alias(name) for name, e in new.items())


def only(verdict):
    """The finding of a verdict that has one."""
    (finding,) = verdict.findings
    return finding


def test_the_same_table_is_not_worse_and_says_so(base):
    verdict = compare(base, base)
    assert not verdict.worse
    assert verdict.findings == ()
    assert "Nothing got worse" in verdict.sentences[0]
    assert "192 pairs" in verdict.sentences[0]


def test_seconds_and_memory_never_count(base):
    slow = base.with_columns(pl.col("seconds") * 50, pl.lit(9e9).alias("memory"), pl.lit("other").alias("machine"))
    assert compare(slow, base).sentences == compare(base, base).sentences


@pytest.mark.parametrize(("share", "most"), [(0.02, ALARM), (0.04, ALARM), (0.3, 0.07)])
def test_noise_alarms_no_more_often_than_stated(share, most):
    """A share of the rows ends in another optimum by chance. The count of alarms is within a binomial of the rate."""
    n, alarms = 40, 0
    for k in range(n):
        rng = np.random.default_rng([k, 11])
        before = run_of_the_library(rng)
        alarms += compare(elsewhere(before, share, rng), before).worse
    assert alarms <= binom.ppf(0.999, n, most)


def test_larger_losses_are_the_searchs_with_their_ratio(base):
    worse = changed(base, "m3", loss=pl.col("loss") * 1.5, fit=pl.col("fit") - 3.0)
    verdict = compare(worse, base)
    finding = only(verdict)
    assert verdict.worse
    assert (finding.room, finding.methods, finding.w, finding.b, finding.n) == ("search", ("m3",), 24, 0, 24)
    assert finding.size == pytest.approx(np.log(1.5))
    assert "m3 on the same structure is 1.5 times as large on 24 of 24 pairs" in finding.sentence
    assert "sysid/solver" in finding.sentence


def test_the_same_change_the_other_way_is_an_improvement(base):
    worse = changed(base, "m3", loss=pl.col("loss") * 1.5, fit=pl.col("fit") - 3.0)
    verdict = compare(base, worse)
    assert not verdict.worse
    assert "0.667 times as large on 24 of 24" in only(verdict).sentence


def test_overfitted_choices_are_the_selections(base):
    larger = pl.lit("hammerstein_wiener, d 25")
    worse = changed(base, "m2", structure=larger, loss=pl.col("loss") * 0.99, fit=pl.col("fit") - 0.4)
    verdict = compare(worse, base)
    assert {f.room for f in verdict.findings} == {"selection"}
    by_name = {f.measure: f for f in verdict.findings}
    assert by_name["choice"].size == pytest.approx(0.4)
    assert by_name["parameters"].w == 24
    assert all(f.worse and f.methods == ("m2",) for f in verdict.findings)


def test_a_loss_that_fell_alone_is_an_overfitted_choice(base):
    other = pl.lit("wiener, d 4")
    worse = changed(base, "m2", structure=other, loss=pl.col("loss") * 0.5, rmse=pl.col("rmse") * 1.0)
    finding = next(f for f in compare(worse, base).findings if f.measure == "overfit")
    assert (finding.worse, finding.room, finding.w, finding.b) == (True, "selection", 24, 0)
    assert "is 2 times as large (median) on 24 of 24 pairs" in finding.sentence
    better = changed(base, "m2", structure=other, loss=pl.col("loss") * 0.5, rmse=pl.col("rmse") * np.sqrt(0.5))
    assert not [f for f in compare(better, base).findings if f.measure == "overfit"]


def test_more_parameters_that_buy_fit_are_no_finding(base):
    larger = pl.lit("hammerstein_wiener, d 25")
    better = changed(base, "m2", structure=larger, loss=pl.col("loss") * 0.9, fit=pl.col("fit") + 0.4)
    better = changed(better, "m2", rmse=pl.col("rmse") * np.sqrt(0.9))
    verdict = compare(better, base)
    assert not verdict.worse
    by_name = {f.measure: f.sentence for f in verdict.findings}
    assert set(by_name) == {"poorer choice", "parameters"}
    assert "smaller loss and a fit that is 0.40 points higher on 24 of 24" in by_name["poorer choice"]
    assert "higher on 24 and lower on 0" in by_name["parameters"]


def test_fewer_parameters_are_no_fault_and_the_fit_that_they_cost_is(base):
    smaller = changed(base, "m2", structure=pl.lit("wiener, d 3"))
    assert not compare(smaller, base).worse
    costly = compare(changed(smaller, "m2", fit=pl.col("fit") - 0.2), base)
    assert {f.measure for f in costly.findings if f.worse} == {"choice"}


def test_more_parameters_that_help_as_often_as_they_harm_are_worse(base):
    half = pl.when(pl.col("seed") % 2 == 0).then(0.3).otherwise(-0.3)
    larger = changed(base, "m2", structure=pl.lit("wiener, d 25"), fit=pl.col("fit") + half)
    (finding,) = (f for f in compare(larger, base).findings if f.measure == "parameters")
    assert finding.worse
    assert "higher on 12 and lower on 12" in finding.sentence


def test_a_choice_with_a_larger_loss_is_blamed_on_the_search(base):
    other = pl.lit("wiener, d 5")
    worse = changed(base, "m2", structure=other, loss=pl.col("loss") * 1.4, fit=pl.col("fit") - 0.4)
    worse = changed(worse, "m2", rmse=pl.col("rmse") * np.sqrt(1.4))
    assert [f.room for f in compare(worse, base).findings if f.worse] == ["search"]


def test_a_lower_fit_at_the_same_loss_is_the_free_runs(base):
    finding = only(compare(changed(base, "m1", fit=pl.col("fit") - 2.0), base))
    assert (finding.room, finding.size) == ("free run", pytest.approx(2.0))


def test_intervals_twice_as_wide_are_worse_where_enough_held(base):
    verdict = compare(changed(base, "m4", width=pl.col("width") * 2, held=pl.col("intervals")), base)
    finding = next(f for f in verdict.findings if f.measure == "width")
    assert (finding.worse, finding.room, finding.methods) == (True, "intervals", ("m4",))
    assert "m4 are 2 times as wide on 24 of 24 pairs" in finding.sentence
    assert "96 of 96 hold the truth on f (100 %)" in finding.sentence


def test_wider_intervals_are_better_where_too_few_held(base):
    narrow = changed(base, "m4", held=pl.lit(2))
    verdict = compare(changed(narrow, "m4", width=pl.col("width") * 2, held=pl.lit(4)), narrow)
    assert not verdict.worse
    assert {f.measure for f in verdict.findings} == {"width", "coverage"}


def test_noise_for_which_intervals_are_too_narrow_hides_no_scaling_elsewhere(base):
    narrow = changed(base, "m4", held=pl.lit(2)).with_columns(pl.col("scenario").str.replace("f/", "coloured/"))
    both = pl.concat([narrow, base])
    verdict = compare(changed(both, "m4", width=pl.col("width") * 2, held=pl.lit(4)), both)
    finding = next(f for f in verdict.findings if f.measure == "width")
    assert finding.worse
    assert "96 of 96 hold the truth on coloured (100 %), 48 of 96 before (50 %)" in finding.sentence


def test_intervals_of_models_that_cannot_be_right_justify_nothing(base):
    off = changed(base, "m4", noise=pl.col("noise") / 10, held=pl.lit(2))
    assert compare(changed(off, "m4", width=pl.col("width") * 2, held=pl.lit(4)), off).worse


def test_narrower_intervals_are_worse_only_if_too_few_hold(base):
    sharper = compare(changed(base, "m4", width=pl.col("width") / 2, held=pl.lit(4)), base)
    assert not sharper.worse
    wrong = compare(changed(base, "m4", width=pl.col("width") / 2, held=pl.lit(2)), base)
    assert {f.measure for f in wrong.findings if f.worse} == {"width", "coverage"}


def test_a_change_of_every_method_that_one_method_alone_does_not_show(base):
    """Two or three of 24 pairs of each of eight methods: no method alarms, all of them do."""
    factor = pl.when(pl.int_range(pl.len()) % 9 == 4).then(1.2).otherwise(1.0)
    finding = only(compare(base.with_columns(pl.col("loss") * factor), base))
    assert finding.methods == ()
    assert "all methods together" in finding.sentence


def test_a_new_crash_is_named_and_a_stop_is_not_judged(base):
    cell = of("m5") & (pl.col("scenario") == "f/2") & (pl.col("seed") == 1)
    crashed = base.with_columns(status=pl.when(cell).then(pl.lit("crashed: LinAlgError")).otherwise("status"))
    verdict = compare(crashed, base)
    assert verdict.worse
    assert verdict.broken == ("f/2, m5, seed 1: crashed: LinAlgError. Before: ok.",)
    assert compare(base, crashed).mended
    assert not compare(base, crashed).worse
    stopped = base.with_columns(status=pl.when(cell).then(pl.lit("stopped after 90 s")).otherwise("status"))
    assert not compare(stopped, base).worse
    assert any("f/2, m5, seed 1: stopped after 90 s" in s for s in compare(stopped, base).sentences)


def test_others_methods_are_left_out(base):
    worse = changed(base, "m3", loss=pl.col("loss") * 1.5)
    assert not compare(worse, base, ours=["m1", "m2"]).worse
    assert compare(worse, base, ours=["m3"]).worse


def test_rows_that_went_missing_are_told(base):
    verdict = compare(base.filter(~of("m3")), base)
    assert any("24 of 192 rows" in s and "m3" in s for s in verdict.sentences)


def test_tables_without_a_common_cell_are_refused():
    with pytest.raises(InputError, match="share no scenario"):
        compare(rows(seed=[1, 2]), rows(seed=[3, 4]))


def test_diverged_fits_count_as_no_model_and_not_as_a_billion_points(base):
    finding = only(compare(changed(base, "m1", fit=pl.lit(-1e9)), base))
    assert 160.0 < finding.size < 200.0


def test_what_cannot_be_judged_or_diverged_is_worse():
    base = run_of_the_library(np.random.default_rng(3), methods=3, tasks=24)
    stopped = base.with_columns(status=pl.lit("stopped after 180 s"))
    assert compare(stopped, base).worse
    first = base["method"][0]
    run = pl.when((pl.col("method") == first) & (pl.col("seed") == base["seed"][0]))
    verdict = compare(base.with_columns(fit=run.then(-1e9).otherwise("fit")), base)
    assert verdict.worse
    assert "the free run diverged" in " ".join(verdict.broken)
    verdict = compare(base.with_columns(oracle=pl.lit(77.0)), base.with_columns(oracle=pl.lit(78.0)))
    assert "run on other data" in " ".join(verdict.broken)
    assert not compare(base, base).worse


def test_what_is_damaged_on_purpose_is_there_to_be_damaged(monkeypatch):
    """`scripts/damaged.py` replaces functions by name; the search among fits judges each on the part that it fitted."""
    monkeypatch.syspath_prepend(Path(__file__).parents[2] / "scripts")
    import damaged

    data = IOData(np.random.default_rng(0).normal(size=400), np.zeros(400), 1.0)
    for damage in damaged.DAMAGES.values():
        with damage.put():
            is_damaged = all(fold.unseen is fold.estimation for fold in damaged.selecting.folds(data))
            assert is_damaged == damage.chooses
