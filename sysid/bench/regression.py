"""What a change of the code made better or worse: two tables of the same cells, pair by pair, never by seconds.

Unchanged code gives the same rows, but for rounding and for a few cells where another processor ends in another
optimum, in either direction. So a measure counts the pairs that changed by more than its tolerance, w for the worse and
b for the better, and it alarms if both hold:

1. w is more than chance explains if each of the n pairs gets worse with a probability of `FLIPPED` (binomial test).
   Over all measures and methods together (Holm 1979, Scand. J. Stat. 6, 65-70) the false-alarm rate is at most `ALARM`.
2. w outweighs b (sign test at `SIGN`), so a change that only shuffles optima is no regression.
"""

from collections.abc import Collection, Iterator
from dataclasses import dataclass

import numpy as np
import polars as pl

from sysid.base.errors import InputError
from sysid.bench.leaderboard import CLAIMED, STOPPED, explains_record
from sysid.bench.measures import GROWTH, PLACES, SAME_FIT, TABLE, WIDTH, Measure, lost_fit
from sysid.bench.statistics import wilson
from sysid.bench.table import DIVERGED, KEY, UNTRIED

ALARM = 0.01
FLIPPED = 0.02
SIGN = 0.02
JUDGED = 10  # intervals of a family
SAME_ORACLE = 1e-3  # points
NAMED = 10  # status changes that are written out one by one


@dataclass(frozen=True)
class Finding:
    """What changed: a measure, its room, the methods, w worse and b better pairs of n, and the median change.

    `p` is the probability under the first test, before Holm's correction. `worst` is the pair that changed most.
    """

    measure: str
    room: str
    methods: tuple[str, ...]
    worse: bool
    w: int
    b: int
    n: int
    size: float
    p: float
    worst: tuple[str, str, int]
    sentence: str


@dataclass(frozen=True)
class Verdict:
    """What a comparison found. `worse` is the exit status 1 of `qpal bench report TABLE --against BASE`.

    `broken` are rows that had a result and have none now, `mended` the other way round.
    """

    findings: tuple[Finding, ...]
    broken: tuple[str, ...]
    mended: tuple[str, ...]
    notes: tuple[str, ...]
    pairs: int

    @property
    def worse(self) -> bool:
        """Whether anything got worse beyond noise."""
        return bool(self.broken) or any(f.worse for f in self.findings)

    @property
    def sentences(self) -> tuple[str, ...]:
        """The verdict in words: what got worse, what got better, what could not be judged."""
        bad = [f.sentence for f in self.findings if f.worse]
        good = [f.sentence for f in self.findings if not f.worse]
        count = len(bad) + len(self.broken)
        head = f"Worse: {count} finding{'s' * (count != 1)} over {self.pairs} pairs." if count else self._quiet()
        return (head, *_shorten(self.broken), *bad, *good, *_shorten(self.mended), *self.notes)

    def _quiet(self) -> str:
        return (
            f"Nothing got worse beyond noise over {self.pairs} pairs of rows. Smaller changes may be there: an alarm "
            f"needs about {_least(24)} worse pairs of 24 of one method, or {_least(100)} of 100."
        )


def compare(new: pl.DataFrame, base: pl.DataFrame, ours: Collection[str] | None = None) -> Verdict:
    """Compare two results tables on the cells that both have; `ours` are the methods that are judged, None for all.

    Raises InputError if the tables share no cell.
    """
    if ours is not None:
        new, base = (table.filter(pl.col("method").is_in(list(ours))) for table in (new, base))
    pairs = new.join(base, on=list(KEY), suffix="_base").sort(KEY)
    if pairs.is_empty():
        raise InputError(
            "the tables share no scenario, method and seed; run the base again with the seeds of this version: "
            "qpal bench run --tag quick"
        )
    broken_rows, mended_rows, status_notes = _statuses(pairs)
    results = pairs.filter((pl.col("status") == "ok") & (pl.col("status_base") == "ok"))
    broken_rows += [*_divergences(results), *_sparse_methods(pairs, results), *_other_records(results)]
    findings = [*_findings(results, 1.0), *_findings(results, -1.0)]
    notes = (*status_notes, *_missing(new, base), *_budgets(pairs))
    return Verdict(tuple(findings), tuple(broken_rows), tuple(mended_rows), notes, len(pairs))


@dataclass(frozen=True)
class _Count:
    """Worse, better and all pairs of some rows, and the probabilities of the two tests."""

    w: int
    b: int
    n: int
    p: float
    sign: float


def _count(change: np.ndarray, tolerance: float, tasks: np.ndarray) -> _Count:
    """Counts of the pairs; the sign test gives each task (scenario and seed) one vote, since methods share its data."""
    from scipy.stats import binom

    finite = np.isfinite(change)
    losses, improvements = change[finite] > tolerance, change[finite] < -tolerance
    votes = np.sign(np.bincount(tasks[finite], losses.astype(float) - improvements))
    plus, minus = int((votes > 0).sum()), int((votes < 0).sum())
    p = float(binom.sf(losses.sum() - 1, finite.sum(), FLIPPED)) if losses.any() else 1.0
    return _Count(int(losses.sum()), int(improvements.sum()), int(finite.sum()), p, _sign_test(plus, minus))


def _findings(pairs: pl.DataFrame, direction: float) -> Iterator[Finding]:
    """What got worse (direction 1) or better (-1) by the measures of `TABLE`, one finding a measure."""
    if pairs.is_empty():
        return
    changes = {m.name: direction * m.change(pairs) for m in TABLE}
    counts = _counts(pairs, changes)
    alarms = _holm(counts)
    for measure in TABLE:
        methods = sorted(method for name, method in alarms if name == measure.name and method)
        if methods or (measure.name, "") in alarms:
            p = min(counts[measure.name, method].p for method in (methods or ("",)))
            yield _finding(measure, pairs, changes[measure.name], methods, direction, p)


def _counts(pairs: pl.DataFrame, changes: dict[str, np.ndarray]) -> dict[tuple[str, str], _Count]:
    """Counts by measure and method; the method '' stands for all of them together."""
    methods = pairs["method"].to_numpy()
    tasks = pairs.select(pl.struct("scenario", "seed").rank("dense") - 1).to_series().to_numpy().astype(int)
    masks = {"": np.ones(len(methods), dtype=bool)} | {str(m): methods == m for m in np.unique(methods)}
    return {
        (measure.name, method): _count(changes[measure.name][mask], measure.tolerance, tasks[mask])
        for measure in TABLE
        for method, mask in masks.items()
    }


def _holm(counts: dict[tuple[str, str], _Count]) -> set[tuple[str, str]]:
    """The tests that reject together at `ALARM` and whose sign test rejects too."""
    by_probability = sorted((c.p, key) for key, c in counts.items() if c.n)
    alarms = set()
    for k, (p, key) in enumerate(by_probability):
        if p > ALARM / (len(by_probability) - k):
            break
        if counts[key].sign <= SIGN:
            alarms.add(key)
    return alarms


def _finding(
    measure: Measure, pairs: pl.DataFrame, change: np.ndarray, methods: list[str], direction: float, p: float
) -> Finding:
    """What one measure found in some methods (all if none are named), with its sentence."""
    rows_of_methods = pairs["method"].is_in(methods).to_numpy() if methods else np.ones(len(pairs), dtype=bool)
    change_of_methods = np.where(rows_of_methods, change, np.nan)
    beyond_tolerance, finite = change_of_methods > measure.tolerance, np.isfinite(change_of_methods)
    size = direction * float(np.median(change_of_methods[beyond_tolerance]))
    worst = pairs.row(int(np.nanargmax(change_of_methods)), named=True)
    cell = (worst["scenario"], worst["method"], worst["seed"])
    w, b, n = int(beyond_tolerance.sum()), int((change_of_methods < -measure.tolerance).sum()), int(finite.sum())
    is_worse, addition = direction > 0, ""
    if measure is WIDTH:
        is_worse, addition = _too_wide_or_narrow(pairs.filter(finite), direction)
    if measure is GROWTH:
        is_worse, addition = _growth_verdict(pairs.filter(beyond_tolerance), direction)
    subject = _enumerate(methods) if methods else "all methods together"
    text = (measure.worse if direction > 0 else measure.better).format(
        who=subject, size=measure.size(size), w=w, b=b, n=n
    ) + addition
    place = f"Look first at {PLACES[measure.room]}; the" if is_worse else "The"
    text = f"{text[0].upper()}{text[1:]}. {place} largest change is {cell[0]}, {cell[1]}, seed {cell[2]}."
    return Finding(measure.name, measure.room, tuple(methods), is_worse, w, b, n, size, p, cell, text)


def _growth_verdict(pairs: pl.DataFrame, direction: float) -> tuple[bool, str]:
    """Whether larger structures (direction 1) bought no fit beyond chance, and the counts in words.

    Smaller ones are never worse by themselves: where they cost fit, another measure says so.
    """
    fit_loss = lost_fit(pairs)
    higher, lower = int((fit_loss < -SAME_FIT).sum()), int((fit_loss > SAME_FIT).sum())
    words = f"; on these the fit on unseen data is higher on {higher} and lower on {lower}"
    return direction > 0 and _sign_test(higher, lower) > SIGN, words


def _sign_test(plus: int, minus: int) -> float:
    """The probability of at least `plus` of plus + minus signs by chance (one-sided)."""
    from scipy.stats import binom

    return float(binom.sf(plus - 1, plus + minus, 0.5)) if plus else 1.0


def _too_wide_or_narrow(pairs: pl.DataFrame, direction: float) -> tuple[bool, str]:
    """Whether wider (direction 1) or narrower intervals are worse, and the coverage in words.

    Only models that explain their record are judged: no interval of another model can hold. Wider ones are better only
    if too few held before in every family, so that noise for which intervals are too narrow hides no scaling elsewhere.
    Narrower ones are worse if too few hold now in any family. Without a family of `JUDGED` intervals both are worse.
    """
    adequate = pairs.filter(explains_record() & explains_record("_base")).with_columns(
        pl.col("scenario").str.split("/").list.first().alias("family")
    )
    verdicts, words = list[bool](), list[str]()
    for (family,), part in adequate.partition_by("family", as_dict=True).items():
        new_rate = wilson(int(part["held"].sum()), int(part["intervals"].sum()))
        base_rate = wilson(int(part["held_base"].sum()), int(part["intervals_base"].sum()))
        if min(new_rate.n, base_rate.n) >= JUDGED:
            verdicts.append(base_rate.high >= CLAIMED if direction > 0 else new_rate.high < CLAIMED)
            words.append(
                f"{new_rate.k} of {new_rate.n} hold the truth on {family} ({100 * new_rate.value:.0f} %), "
                f"{base_rate.k} of {base_rate.n} "
                f"before ({100 * base_rate.value:.0f} %)"
            )
    if not words:
        return (
            True,
            f"; fewer than {JUDGED} intervals are of a model that explains its record, so none of them is judged",
        )
    return any(verdicts), f". Where the model explains the record, {'; '.join(words)}; {100 * CLAIMED:.0f} % is claimed"


def _statuses(pairs: pl.DataFrame) -> tuple[list[str], list[str], list[str]]:
    """Rows that lost their result, rows that gained one, and changes that depend on time or on what is installed."""
    broken_rows, mended_rows, notes = list[str](), list[str](), list[str]()
    for row in pairs.filter(pl.col("status") != pl.col("status_base")).iter_rows(named=True):
        cell = f"{row['scenario']}, {row['method']}, seed {row['seed']}"
        sentence = f"{cell}: {_full_stop(row['status'])} Before: {_full_stop(row['status_base'])}"
        statuses = (row["status"], row["status_base"])
        if any(status.startswith((STOPPED, *UNTRIED)) for status in statuses):
            notes.append(f"Not judged: {sentence}")
        elif "ok" in statuses:
            (broken_rows if row["status_base"] == "ok" else mended_rows).append(sentence)
        else:
            notes.append(f"Failed in another way: {sentence}")
    return broken_rows, mended_rows, list(_shorten(notes))


def _divergences(results: pl.DataFrame) -> Iterator[str]:
    """Free runs that are not finite any more."""
    for row in results.filter((pl.col("fit") < DIVERGED / 2) & (pl.col("fit_base") > DIVERGED / 2)).iter_rows(
        named=True
    ):
        yield f"{row['scenario']}, {row['method']}, seed {row['seed']}: the free run diverged. Before: it did not."


def _sparse_methods(pairs: pl.DataFrame, results: pl.DataFrame) -> Iterator[str]:
    """Methods of which less than half of the base's results have a counterpart: nothing can be said of these."""
    base_counts = dict(pairs.filter(pl.col("status_base") == "ok").group_by("method").len().rows())
    judged_counts = dict(results.group_by("method").len().rows())
    for method, count in sorted(base_counts.items()):
        if 2 * judged_counts.get(method, 0) < count:
            yield f"{method}: only {judged_counts.get(method, 0)} of {count} results of the base can be judged."


def _other_records(results: pl.DataFrame) -> Iterator[str]:
    """Pairs whose noise-free output has another fit: the two tables were not run on the same data."""
    different = results.filter((pl.col("oracle") - pl.col("oracle_base")).abs() > SAME_ORACLE)
    if len(different):
        yield (
            f"{len(different)} pairs were run on other data, as their oracle says, first "
            f"{different['scenario'][0]}, seed "
            f"{different['seed'][0]}: run the base again with this version's scenarios."
        )


def _missing(new: pl.DataFrame, base: pl.DataFrame) -> Iterator[str]:
    """Rows of the base that the new table lacks, which could hide a regression."""
    lacking = base.join(new, on=list(KEY), how="anti")
    if len(lacking):
        methods = ", ".join(sorted(lacking["method"].unique()))
        yield (
            f"{len(lacking)} of {len(base)} rows of the base have no row in the table ({methods}); they are not "
            "judged. Run them: qpal bench run --tag quick"
        )


def _budgets(pairs: pl.DataFrame) -> Iterator[str]:
    unequal = pairs.filter(pl.col("budget") != pl.col("budget_base"))
    if len(unequal):
        yield f"{len(unequal)} of {len(pairs)} pairs had another time budget than in the base; give both the same one."


def _shorten(sentences: list[str] | tuple[str, ...]) -> Iterator[str]:
    """The first `NAMED` sentences, and how many there are more."""
    yield from sentences[:NAMED]
    if len(sentences) > NAMED:
        yield f"And {len(sentences) - NAMED} more like these."


def _full_stop(text: str) -> str:
    return text if text.endswith(".") else f"{text}."


def _enumerate(names: list[str]) -> str:
    return names[0] if len(names) == 1 else f"{', '.join(names[:-1])} and {names[-1]}"


def _least(n: int) -> int:
    """Worse pairs of n, and none better, from which one of about 50 tests alarms."""
    from scipy.stats import binom

    w = np.arange(1, n + 1)
    alarms = (binom.sf(w - 1, n, FLIPPED) <= ALARM / 50) & (0.5**w <= SIGN)
    return int(w[alarms][0])
