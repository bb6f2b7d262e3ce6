"""The leaderboard as a pure function of the results table: a frame per question, by family and method.

The bar of a task (scenario and seed) is the fit of the search that began at the truth (`BAR`). Without one it is the
fit of the plant's noise-free output (the leg), or, without any truth (a real record), the best fit of any method. The
gap of a row is the bar less its fit, in points. A method that crashed, refused or diverged has an infinite gap. Rows
whose method or record is not there do not count.
"""

from collections.abc import Collection, Sequence

import numpy as np
import polars as pl

from sysid.base.errors import InputError
from sysid.bench.statistics import LEVEL, SHIFT, Duel, duel, performance_profile, wilson
from sysid.bench.table import BAR, DIVERGED, UNTRIED

OWN = "own structure"  # all methods together that are told the structure of a drawn plant
AT_TRUTH, AT_ORACLE, AT_BEST = "the fit from the truth", "the noise-free output", "the best fit of any method"
STOPPED = "stopped after"
NEAR = (0.1, 1.0)  # points of fit from the bar
CAP = 100.0  # points: a failure counts as much as a model that explains nothing
CLAIMED = 0.95  # of the intervals
EXPLAINED = 1.1  # times the variance of the noise: a model with a larger loss does not contain the plant
ENOUGH = 0.9  # of a family's tasks must be tried by a method that is ranked
TASK = ("scenario", "seed")
GROUP = ("family", "method")


def score_rows(table: pl.DataFrame) -> pl.DataFrame:
    """The rows of methods that had a chance, with `family`, `bar`, `bar_is`, `gap` and `ok`.

    A method that bears the name of its scenario, as hammerstein on drawn/hammerstein, is told the structure; all of
    these count as one method, `OWN`. Raises InputError for a table without rows.
    """
    if table.is_empty():
        raise InputError("the table has no rows; run methods first: qpal bench run --tag quick")
    no_chain = (pl.col("method") == BAR) & pl.col("status").str.starts_with("refused")
    had_chance = ~pl.any_horizontal(no_chain, *(pl.col("status").str.starts_with(word) for word in UNTRIED))
    ok = (pl.col("status") == "ok") & (pl.col("fit") > DIVERGED / 2)
    if not table.select(had_chance.any()).item():
        raise InputError(
            f"no method of the table had a chance ({table['status'][0]}); install it or give its records, and run again"
        )
    rows = table.filter(had_chance).with_columns(
        _family().alias("family"),
        pl.when(_structure() == pl.col("method")).then(pl.lit(OWN)).otherwise("method").alias("method"),
        ok.fill_null(False).alias("ok"),
    )
    fit = pl.when("ok").then("fit")
    at_truth = fit.filter(pl.col("method") == BAR).max().over(TASK)
    best = fit.filter(pl.col("method") != BAR).max().over(TASK)
    oracle = pl.col("oracle").max().over(TASK)
    kind = pl.when(at_truth.is_not_null()).then(pl.lit(AT_TRUTH)).when(oracle.is_not_null()).then(pl.lit(AT_ORACLE))
    rows = rows.with_columns(
        pl.coalesce(at_truth, oracle, best).alias("bar"), kind.otherwise(pl.lit(AT_BEST)).alias("bar_is")
    )
    gap = pl.when("ok").then(pl.col("bar") - pl.col("fit")).otherwise(float("inf"))
    return rows.with_columns(gap.alias("gap"))


def method_of(scenario: str, method: str) -> str:
    """The name in the table of a method on the leaderboard."""
    return scenario.partition("/")[2].partition("-")[0] if method == OWN else method


def _family() -> pl.Expr:
    """The family of a scenario; drawn records of another length are a family of their own."""
    length = pl.col("scenario").str.extract(r"(-short|-long)$").fill_null("")
    return pl.col("scenario").str.split("/").list.first() + length


def _structure() -> pl.Expr:
    """What a scenario is called after its family and before a dash: the structure of a drawn plant."""
    return pl.col("scenario").str.extract(r"^[^/]*/([^-]*)")


def missing_methods(table: pl.DataFrame) -> pl.DataFrame:
    """Which methods had no chance, how often, and why: method, status, n."""
    no_chance = pl.any_horizontal(*(pl.col("status").str.starts_with(word) for word in UNTRIED))
    return table.filter(no_chance).group_by("method", "status").agg(pl.len().alias("n")).sort("method", "status")


def leaderboard(rows: pl.DataFrame) -> pl.DataFrame:
    """A row for each family and method, the best first: see docs/benchmark.md for the columns. `rows` are `scored`.

    The order is by `lost`, the mean gap with a gap of `CAP` at most: a failure costs as much as no model.
    """
    gap, status = pl.col("gap"), pl.col("status")
    is_stopped = status.str.starts_with(STOPPED)
    is_refused = status.str.starts_with("refused")
    frame = rows.group_by(GROUP).agg(
        pl.len().alias("n"),
        gap.clip(-CAP, CAP).mean().alias("lost"),
        *((gap <= margin + 1e-12).sum().alias(f"near_{margin:g}") for margin in NEAR),
        gap.quantile(0.5, "higher").alias("gap_median"),
        gap.quantile(LEVEL, "higher").alias("gap_p95"),
        gap.max().alias("gap_worst"),
        pl.col("fit").filter("ok").median().alias("fit_median"),
        (~pl.col("ok") & ~is_stopped & ~is_refused).sum().alias("crashed"),
        is_stopped.sum().alias("stopped"),
        is_refused.sum().alias("refused"),
        _shifted_mean("seconds").alias("seconds"),
        pl.col("memory").median().alias("memory"),
        (pl.col("bar_is") != AT_BEST).mean().alias("bar_at_truth"),
    )
    tasks = rows.group_by("family").agg(pl.struct(TASK).n_unique().alias("tasks"))
    frame = frame.join(tasks, "family")
    for margin in NEAR:
        frame = with_rate(frame, f"near_{margin:g}", "n")
    return frame.sort("family", ~_competes(), "lost", "method")


def competitors(board: pl.DataFrame) -> pl.DataFrame:
    """The methods that compete: all but the bar, and but those that tried less than `ENOUGH` of a family's tasks."""
    return board.filter(_competes())


def _competes() -> pl.Expr:
    return (pl.col("method") != BAR) & (pl.col("n") >= ENOUGH * pl.col("tasks"))


def with_rate(frame: pl.DataFrame, k: str, n: str) -> pl.DataFrame:
    """The frame with k / n as `k_rate`, and the ends of its Wilson interval as `k_low` and `k_high`."""
    rates = [wilson(*pair) for pair in frame.select(k, n).iter_rows()]
    return frame.with_columns(
        pl.Series(f"{k}_rate", [r.value for r in rates], pl.Float64),
        pl.Series(f"{k}_low", [r.low for r in rates], pl.Float64),
        pl.Series(f"{k}_high", [r.high for r in rates], pl.Float64),
    )


def explains_record(suffix: str = "") -> pl.Expr:
    """Whether a row's model explains its record: its loss is not far above the variance of the noise."""
    return (pl.col(f"loss{suffix}") <= EXPLAINED * pl.col(f"noise{suffix}")).fill_null(False)


def calibration(rows: pl.DataFrame, by: Sequence[str] = GROUP) -> pl.DataFrame:
    """How many of the claimed intervals hold the truth, with Wilson's interval, and their median relative width.

    Only models that explain their record count: an interval says nothing of a plant that its model cannot be. `others`
    and `others_held` are the intervals of the other models.
    """
    claims = rows.filter(pl.col("intervals") > 0).with_columns(explains_record().alias("whole"))
    adequate, rest = pl.col("whole"), ~pl.col("whole")
    frame = claims.group_by(by).agg(
        adequate.sum().alias("n"),
        pl.col("intervals").filter(adequate).sum(),
        pl.col("held").filter(adequate).sum(),
        pl.col("width").filter(adequate).median(),
        pl.col("intervals").filter(rest).sum().alias("others"),
        pl.col("held").filter(rest).sum().alias("others_held"),
    )
    return with_rate(frame, "held", "intervals").sort(by)


def errors(rows: pl.DataFrame) -> pl.DataFrame:
    """Median and 95th percentile of the errors of poles and steady state by family and method, where they are known."""
    columns = ("pole_error", "map_error")
    frame = rows.group_by(GROUP).agg(
        *(pl.col(name).count().alias(f"{name}_n") for name in columns),
        *(pl.col(name).median().alias(f"{name}_median") for name in columns),
        *(pl.col(name).drop_nulls().quantile(LEVEL, "higher").alias(f"{name}_p95") for name in columns),
    )
    return frame.filter(pl.any_horizontal(pl.col(f"{name}_n") > 0 for name in columns)).sort(GROUP)


def scenarios(rows: pl.DataFrame) -> pl.DataFrame:
    """A row for each scenario and method: n, lost points, median and worst gap, and the seed of the worst gap."""
    return (
        rows.group_by("scenario", "method")
        .agg(
            pl.len().alias("n"),
            pl.col("gap").clip(-CAP, CAP).mean().alias("lost"),
            pl.col("gap").quantile(0.5, "higher").alias("gap_median"),
            pl.col("gap").max().alias("gap_worst"),
            pl.col("seed").sort_by("gap", "seed", descending=[True, False]).first().alias("worst_seed"),
            pl.col("fit").filter("ok").median().alias("fit_median"),
            pl.col("oracle").median().alias("oracle_median"),
            _shifted_mean("seconds").alias("seconds"),
        )
        .sort("scenario", pl.col("method") == BAR, "lost", "method")
    )


def worst(rows: pl.DataFrame, count: int, by: Sequence[str] = ("scenario", "method")) -> pl.DataFrame:
    """The `count` rows with the largest gaps of each group, but the bar's own."""
    competing = rows.filter((pl.col("method") != BAR) & pl.col("bar").is_not_null())
    ordered_rows = competing.sort("gap", "scenario", "method", "seed", descending=[True, False, False, False])
    return ordered_rows.group_by(by, maintain_order=True).head(count)


def compare_methods(rows: pl.DataFrame, first: str, rival: str, family: str, margin: float = NEAR[0]) -> Duel:
    """`first` against `other` on the tasks of the family that both tried; a failure loses.

    They tie on a task if their fits lie within `margin` points.
    """
    duel_rows = rows.filter((pl.col("family") == family) & pl.col("method").is_in([first, rival]))
    fit = duel_rows.with_columns(pl.when("ok").then("fit").otherwise(float("-inf")).alias("fit"))
    wide = fit.pivot("method", index=TASK, values="fit", aggregate_function="first")
    pairs = wide.select(first, rival).drop_nulls().to_numpy()
    return duel(pairs[:, 0], pairs[:, 1], margin)


def profile(rows: pl.DataFrame, taus: np.ndarray, within: float | None = None) -> pl.DataFrame:
    """Performance profiles of the methods (the bar left out): columns tau and one share for each method.

    The cost of a task is 1 - fit / 100, the normalised error; with `within`, it is the seconds of a fit whose gap is at
    most `within` points, and any other fit is a failure. A share is one of the tasks that the method ran.
    """
    competing = rows.filter(pl.col("method") != BAR)
    if within is None:
        cost = pl.when("ok").then((1.0 - pl.col("fit") / 100.0).clip(1e-6))
    else:
        cost = pl.when(pl.col("ok") & (pl.col("gap") <= within)).then(pl.col("seconds").clip(1e-3))
    wide = competing.with_columns(cost.alias("cost")).pivot(
        "method", index=TASK, values="cost", aggregate_function="first"
    )
    names = sorted(set(wide.columns) - set(TASK))
    shares = performance_profile(wide.select(names).fill_null(float("inf")).to_numpy(), taus)
    tasks = dict(competing.group_by("method").agg(pl.struct(TASK).n_unique()).iter_rows())
    return pl.DataFrame({"tau": taus} | {name: shares[:, k] * len(wide) / tasks[name] for k, name in enumerate(names)})


def winners(board: pl.DataFrame, ours: Collection[str]) -> pl.DataFrame:
    """Of each family the best of our methods and the best of the others: family, ours, peer, and their numbers.

    A side without a method has nulls.
    """
    is_ours = pl.col("method").is_in(list(ours))
    competing = competitors(board)
    sides = []
    for side, side_filter in (("ours", is_ours), ("peer", ~is_ours)):
        best = competing.filter(side_filter).group_by("family", maintain_order=True).first()
        columns = ("method", "n", "lost", "near_0.1", "near_0.1_rate", "seconds", "fit_median")
        sides.append(best.select("family", *(pl.col(name).alias(_column(side, name)) for name in columns)))
    families = board.select(pl.col("family").unique().sort())
    return families.join(sides[0], "family", "left").join(sides[1], "family", "left").sort("family")


def _column(side: str, name: str) -> str:
    return side if name == "method" else f"{side}_{name}"


def _shifted_mean(name: str) -> pl.Expr:
    """The shifted geometric mean; `sysid.bench.statistics` has the formula and its source."""
    return (pl.col(name) + SHIFT).log().mean().exp() - SHIFT


def worst_to_draw(rows: pl.DataFrame, methods: list[str], count: int) -> list[tuple[str, str, int]]:
    """The cells with the largest finite gaps of some methods, one a scenario: (scenario, method, seed).

    A gap within the smallest margin is not worth a picture.
    """
    candidates = rows.filter(pl.col("method").is_in(methods) & (pl.col("gap") > NEAR[0]) & pl.col("ok"))
    by_gap = candidates.with_columns(pl.col("gap").clip(-CAP, CAP)).sort(
        "gap", "scenario", "method", "seed", descending=[True, False, False, False]
    )
    first = by_gap.unique("scenario", keep="first", maintain_order=True).head(count)
    cells = first.select("scenario", "method", "seed").rows()
    return [(scenario, method_of(scenario, method), int(seed)) for scenario, method, seed in cells]
