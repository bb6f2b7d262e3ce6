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
from sysid.bench.leaderboard import CLAIMED, STOPPED, explained
from sysid.bench.measures import GROWTH, PLACES, SAME_FIT, TABLE, WIDTH, Measure, fell
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
        return (head, *_some(self.broken), *bad, *good, *_some(self.mended), *self.notes)

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
    broken, mended, stopped = _statuses(pairs)
    both = pairs.filter((pl.col("status") == "ok") & (pl.col("status_base") == "ok"))
    broken += [*_diverged(both), *_unjudged(pairs, both), *_other_records(both)]
    findings = [*_findings(both, 1.0), *_findings(both, -1.0)]
    notes = (*stopped, *_missing(new, base), *_budgets(pairs))
    return Verdict(tuple(findings), tuple(broken), tuple(mended), notes, len(pairs))


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

    known = np.isfinite(change)
    up, down = change[known] > tolerance, change[known] < -tolerance
    votes = np.sign(np.bincount(tasks[known], up.astype(float) - down))
    plus, minus = int((votes > 0).sum()), int((votes < 0).sum())
    p = float(binom.sf(up.sum() - 1, known.sum(), FLIPPED)) if up.any() else 1.0
    return _Count(int(up.sum()), int(down.sum()), int(known.sum()), p, _sign_test(plus, minus))


def _findings(pairs: pl.DataFrame, direction: float) -> Iterator[Finding]:
    """What got worse (direction 1) or better (-1) by the measures of `TABLE`, one finding a measure."""
    if pairs.is_empty():
        return
    changes = {m.name: direction * m.change(pairs) for m in TABLE}
    counts = _counts(pairs, changes)
    passed = _holm(counts)
    for measure in TABLE:
        methods = sorted(method for name, method in passed if name == measure.name and method)
        if methods or (measure.name, "") in passed:
            p = min(counts[measure.name, method].p for method in (methods or ("",)))
            yield _finding(measure, pairs, changes[measure.name], methods, direction, p)


def _counts(pairs: pl.DataFrame, changes: dict[str, np.ndarray]) -> dict[tuple[str, str], _Count]:
    """Counts by measure and method; the method '' stands for all of them together."""
    methods = pairs["method"].to_numpy()
    tasks = pairs.select(pl.struct("scenario", "seed").rank("dense") - 1).to_series().to_numpy().astype(int)
    each = {"": np.ones(len(methods), dtype=bool)} | {str(m): methods == m for m in np.unique(methods)}
    return {
        (measure.name, method): _count(changes[measure.name][mine], measure.tolerance, tasks[mine])
        for measure in TABLE
        for method, mine in each.items()
    }


def _holm(counts: dict[tuple[str, str], _Count]) -> set[tuple[str, str]]:
    """The tests that reject together at `ALARM` and whose sign test rejects too."""
    ranked = sorted((c.p, key) for key, c in counts.items() if c.n)
    passed = set()
    for k, (p, key) in enumerate(ranked):
        if p > ALARM / (len(ranked) - k):
            break
        if counts[key].sign <= SIGN:
            passed.add(key)
    return passed


def _finding(
    measure: Measure, pairs: pl.DataFrame, change: np.ndarray, methods: list[str], direction: float, p: float
) -> Finding:
    named = pairs["method"].is_in(methods).to_numpy() if methods else np.ones(len(pairs), dtype=bool)
    mine = np.where(named, change, np.nan)
    up, known = mine > measure.tolerance, np.isfinite(mine)
    size = direction * float(np.median(mine[up]))
    worst = pairs.row(int(np.nanargmax(mine)), named=True)
    cell = (worst["scenario"], worst["method"], worst["seed"])
    w, b, n = int(up.sum()), int((mine < -measure.tolerance).sum()), int(known.sum())
    worse, more = direction > 0, ""
    if measure is WIDTH:
        worse, more = _too_wide_or_narrow(pairs.filter(known), direction)
    if measure is GROWTH:
        worse, more = _bought(pairs.filter(up), direction)
    who = _listed(methods) if methods else "all methods together"
    text = (measure.worse if direction > 0 else measure.better).format(
        who=who, size=measure.size(size), w=w, b=b, n=n
    ) + more
    where = f"Look first at {PLACES[measure.room]}; the" if worse else "The"
    text = f"{text[0].upper()}{text[1:]}. {where} largest change is {cell[0]}, {cell[1]}, seed {cell[2]}."
    return Finding(measure.name, measure.room, tuple(methods), worse, w, b, n, size, p, cell, text)


def _bought(pairs: pl.DataFrame, direction: float) -> tuple[bool, str]:
    """Whether larger structures (direction 1) bought no fit beyond chance, and the counts in words.

    Smaller ones are never worse by themselves: where they cost fit, another measure says so.
    """
    lost = fell(pairs)
    higher, lower = int((lost < -SAME_FIT).sum()), int((lost > SAME_FIT).sum())
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
    judged = pairs.filter(explained() & explained("_base")).with_columns(
        pl.col("scenario").str.split("/").list.first().alias("family")
    )
    worse, words = list[bool](), list[str]()
    for (family,), part in judged.partition_by("family", as_dict=True).items():
        now = wilson(int(part["held"].sum()), int(part["intervals"].sum()))
        before = wilson(int(part["held_base"].sum()), int(part["intervals_base"].sum()))
        if min(now.n, before.n) >= JUDGED:
            worse.append(before.high >= CLAIMED if direction > 0 else now.high < CLAIMED)
            words.append(
                f"{now.k} of {now.n} hold the truth on {family} ({100 * now.value:.0f} %), {before.k} of {before.n} "
                f"before ({100 * before.value:.0f} %)"
            )
    if not words:
        return (
            True,
            f"; fewer than {JUDGED} intervals are of a model that explains its record, so none of them is judged",
        )
    return any(worse), f". Where the model explains the record, {'; '.join(words)}; {100 * CLAIMED:.0f} % is claimed"


def _statuses(pairs: pl.DataFrame) -> tuple[list[str], list[str], list[str]]:
    """Rows that lost their result, rows that gained one, and changes that depend on time or on what is installed."""
    broken, mended, other = list[str](), list[str](), list[str]()
    for row in pairs.filter(pl.col("status") != pl.col("status_base")).iter_rows(named=True):
        cell = f"{row['scenario']}, {row['method']}, seed {row['seed']}"
        sentence = f"{cell}: {_full_stop(row['status'])} Before: {_full_stop(row['status_base'])}"
        both = (row["status"], row["status_base"])
        if any(status.startswith((STOPPED, *UNTRIED)) for status in both):
            other.append(f"Not judged: {sentence}")
        elif "ok" in both:
            (broken if row["status_base"] == "ok" else mended).append(sentence)
        else:
            other.append(f"Failed in another way: {sentence}")
    return broken, mended, list(_some(other))


def _diverged(both: pl.DataFrame) -> Iterator[str]:
    """Free runs that are not finite any more."""
    for row in both.filter((pl.col("fit") < DIVERGED / 2) & (pl.col("fit_base") > DIVERGED / 2)).iter_rows(named=True):
        yield f"{row['scenario']}, {row['method']}, seed {row['seed']}: the free run diverged. Before: it did not."


def _unjudged(pairs: pl.DataFrame, both: pl.DataFrame) -> Iterator[str]:
    """Methods of which less than half of the base's results have a counterpart: nothing can be said of these."""
    there = dict(pairs.filter(pl.col("status_base") == "ok").group_by("method").len().rows())
    judged = dict(both.group_by("method").len().rows())
    for method, count in sorted(there.items()):
        if 2 * judged.get(method, 0) < count:
            yield f"{method}: only {judged.get(method, 0)} of {count} results of the base can be judged."


def _other_records(both: pl.DataFrame) -> Iterator[str]:
    """Pairs whose noise-free output has another fit: the two tables were not run on the same data."""
    other = both.filter((pl.col("oracle") - pl.col("oracle_base")).abs() > SAME_ORACLE)
    if len(other):
        yield (
            f"{len(other)} pairs were run on other data, as their oracle says, first {other['scenario'][0]}, seed "
            f"{other['seed'][0]}: run the base again with this version's scenarios."
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
    changed = pairs.filter(pl.col("budget") != pl.col("budget_base"))
    if len(changed):
        yield f"{len(changed)} of {len(pairs)} pairs had another time budget than in the base; give both the same one."


def _some(sentences: list[str] | tuple[str, ...]) -> Iterator[str]:
    """The first `NAMED` sentences, and how many there are more."""
    yield from sentences[:NAMED]
    if len(sentences) > NAMED:
        yield f"And {len(sentences) - NAMED} more like these."


def _full_stop(text: str) -> str:
    return text if text.endswith(".") else f"{text}."


def _listed(names: list[str]) -> str:
    return names[0] if len(names) == 1 else f"{', '.join(names[:-1])} and {names[-1]}"


def _least(n: int) -> int:
    """Worse pairs of n, and none better, from which one of about 50 tests alarms."""
    from scipy.stats import binom

    w = np.arange(1, n + 1)
    alarms = (binom.sf(w - 1, n, FLIPPED) <= ALARM / 50) & (0.5**w <= SIGN)
    return int(w[alarms][0])
