"""The choice between structures on parts of a record that differ in kind."""

import numpy as np
import pytest
import scipy.stats

import sysid
from sysid.base.errors import InputError
from sysid.estimation.result import Fit
from sysid.selection import select as room
from sysid.selection.folds import folds_of_other_kinds
from sysid.selection.select import select
from sysid.selection.space import Space
from sysid.selection.table import BLOCKS, Row, choose_by_kind, confidence
from sysid.structures import Hammerstein, OutputError, Wiener

SMOOTH, MIXED = OutputError(1, 1, 1), Wiener(2, 2, 1, "saturation")


def row(candidate, kinds, d=5):
    return Row(candidate, 90.0, d, 3, np.ones(BLOCKS), True, kinds=np.array(kinds, dtype=float))


def test_parts_differ_in_level_rate_and_end():
    """Ten blocks of 200 samples, each with its own level, rate and mean, in no order."""
    rng = np.random.default_rng(0)
    level, hold, mean = (rng.permutation(x) for x in (np.linspace(0.2, 2.0, 10), np.arange(2, 12), np.arange(10.0)))
    blocks = [a * np.repeat(rng.choice([-1.0, 1.0], 200), k)[:200] for a, k in zip(level, hold, strict=True)]
    y = np.concatenate([m + 0.1 * rng.standard_normal(200) for m in mean])
    folds = folds_of_other_kinds(sysid.IOData(np.concatenate(blocks), y, 0.1))
    assert len(folds) == 6
    for fold in folds:
        assert fold.estimation.N + fold.unseen.N == 2000  # borders move to where the input stands still
        assert abs(fold.estimation.N - 1000) <= 100

    def largest(data, of):
        return max(of(e) for e in data.experiments), min(of(e) for e in data.experiments)

    slow, fast = folds[2].estimation, folds[2].unseen
    assert np.abs(folds[0].estimation.u).mean() < 0.5 * np.abs(folds[0].unseen.u).mean()
    turns = [np.mean(np.diff(e.u[:, 0]) != 0.0) for e in (slow, fast)]
    assert turns[0] < turns[1]
    assert largest(folds[4].estimation, lambda e: e.y.mean())[0] < largest(folds[4].unseen, lambda e: e.y.mean())[1]
    for low, high in (folds[:2], folds[2:4], folds[4:]):
        assert np.array_equal(low.estimation.u, high.unseen.u)


def test_a_record_of_one_sample_a_block_is_refused():
    with pytest.raises(InputError, match="give a longer one"):
        folds_of_other_kinds(sysid.IOData(np.array([1.0, 2.0, 3.0]), np.array([1.0, 2.0, 3.0]), 0.1))


def test_what_fails_on_other_kinds_is_not_chosen():
    """Better on both interleaved folds, and three times as far off on the others."""
    near = row(MIXED, [-4.0, -4.0] + 6 * [-1.0])
    steady = row(SMOOTH, 8 * [-3.2])
    assert choose_by_kind([near, steady]) is steady
    diverging = row(MIXED, [-9.0, -9.0, np.inf] + 5 * [-9.0])
    assert choose_by_kind([diverging, steady]) is steady
    assert confidence(steady, diverging) == 1.0
    assert confidence(diverging, steady) == 0.0


@pytest.mark.parametrize(
    ("gap", "spread", "small_wins"), [(0.005, 0.0, True), (0.05, 0.3, True), (0.05, 0.001, False), (0.2, 0.3, False)]
)
def test_a_smaller_model_replaces_the_best_where_the_record_does_not_tell_them_apart(gap, spread, small_wins):
    noise = spread * np.tile([1.0, -1.0], 4)
    best, small = row(MIXED, 8 * [-3.0], d=20), row(SMOOTH, -3.0 + gap + noise, d=4)
    assert (choose_by_kind([best, small]) is small) is small_wins


def test_confidence_is_that_of_the_corrected_t_test():
    rng = np.random.default_rng(3)
    for _ in range(20):
        a, b = rng.standard_normal(8), 0.5 + rng.standard_normal(8)
        paired = scipy.stats.ttest_rel(b, a, alternative="greater")
        t = paired.statistic * np.sqrt((1 / 8) / (1 / 8 + 1 / 1))  # n_test / n_train = 1
        assert confidence(row(MIXED, a), row(SMOOTH, b)) == pytest.approx(scipy.stats.t.cdf(t, 7), abs=1e-12)
        assert confidence(row(MIXED, a), row(SMOOTH, b)) + confidence(row(SMOOTH, b), row(MIXED, a)) == pytest.approx(1)


NEAR = Space(
    nb=(2,),
    nf=(2,),
    nk=(1,),
    input=("unit_gain", "saturation"),
    output=("unit_gain", "saturation"),
    starts=1,
    structures=("hammerstein", "hammerstein_wiener"),
    grows=False,
)


def hammerstein_record(N=1200):
    """Saturation at +-1 and two poles: what `NEAR` holds as hammerstein (2,2,1) saturation."""
    theta = np.array([-1.0, 1.0, 0.3, 0.15, -1.5, 0.7, 0.0, 0.0])
    rng = np.random.default_rng(0)
    u = np.repeat(rng.uniform(-2, 2, N // 5), 5)
    y = sysid.structures.hammerstein(2, 2, 1, "saturation").simulate(theta, u)
    return sysid.IOData(u, y + 0.02 * y.std() * rng.normal(size=N), 0.1)


def test_finalists_meet_and_a_journal_keeps_what_they_did(tmp_path):
    """Both structures hold the plant: they meet, the smaller is chosen, and the sentence says how sure that is."""
    data = hammerstein_record()
    first = select(data, NEAR, jobs=1, journal=tmp_path / "j.jsonl")
    finalists = [r for r in first.rows if r.kinds is not None]
    assert {r.candidate.name for r in finalists} == {"hammerstein", "hammerstein_wiener"}
    assert first.chosen.candidate == Hammerstein(2, 2, 1, "saturation")
    assert "parts of other levels, rates and ends" in first.sentence()
    again = select(data, NEAR, jobs=1, journal=tmp_path / "j.jsonl")
    kinds = {r.candidate: r.kinds for r in again.rows if r.kinds is not None}
    for r in finalists:
        np.testing.assert_array_equal(kinds[r.candidate], r.kinds)
    assert again.sentence() == first.sentence()


@pytest.mark.nightly
def test_a_model_that_diverges_on_the_record_is_passed_over(monkeypatch):
    """The fit of the chosen one is made to diverge: the next one is handed over; where all do, nothing is."""
    data, whole = hammerstein_record(), Fit.fit_percent

    def percent(fit, record):
        return -np.inf if fit.model.structure == "hammerstein" else whole(fit, record)

    monkeypatch.setattr(Fit, "fit_percent", percent)
    found = select(data, NEAR, jobs=1)
    assert found.chosen.candidate.name == "hammerstein_wiener"
    assert any("its free run over all the data diverges" in note for note in found.notes)
    monkeypatch.setattr(Fit, "fit_percent", lambda fit, record: -np.inf)
    with pytest.raises(InputError, match="none of the best candidates"):
        select(data, NEAR, jobs=1)


def test_a_budget_that_ends_before_the_finalists_meet_is_told(monkeypatch):
    monkeypatch.setattr(room, "_CHOICE", 0.0)
    found = select(hammerstein_record(), NEAR, jobs=1)
    assert all(r.kinds is None for r in found.rows)
    assert any("left no time to compare 2 of the best" in note for note in found.notes)
    assert "parts of other levels" not in found.sentence()
