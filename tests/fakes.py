"""Made-up tables of results, for tests of what is computed from them."""

import numpy as np
import polars as pl

from sysid.bench.table import COLUMNS


def rows(**columns) -> pl.DataFrame:
    """A table; each column is a list or one value for all rows, and the rest have plain values."""
    n = max(len(v) for v in columns.values() if isinstance(v, list | np.ndarray))
    plain = {"scenario": "f/a", "method": "m", "seed": list(range(n)), "status": "ok", "fit": 90.0, "budget": 30.0}
    given = plain | columns
    filled = {name: (list(v) if isinstance(v := given.get(name), list | np.ndarray) else [v] * n) for name in COLUMNS}
    return pl.DataFrame(filled, schema=COLUMNS)


def run_of_the_library(rng: np.random.Generator, methods: int = 8, tasks: int = 24) -> pl.DataFrame:
    """A small run: every method on every task, with losses, structures and four intervals a row that hold at 95 %."""
    n = methods * tasks
    return rows(
        scenario=[f"f/{k % 6}" for k in range(tasks)] * methods,
        method=[f"m{k}" for k in range(methods) for _ in range(tasks)],
        seed=[k // 6 for k in range(tasks)] * methods,
        fit=rng.uniform(60, 99, n),
        loss=(loss := rng.lognormal(-6, 1, n)),
        noise=loss,
        rmse=np.sqrt(loss),
        structure=[f"hammerstein_wiener, d {d}" for d in rng.integers(6, 20, n)],
        intervals=[4] * n,
        held=rng.binomial(4, 0.95, n),
        width=rng.lognormal(-4, 0.5, n),
        seconds=rng.lognormal(0, 1, n),
    )


def elsewhere(table: pl.DataFrame, share: float, rng: np.random.Generator) -> pl.DataFrame:
    """The table after a share of its rows ended in another optimum, better or worse by chance; seconds all differ."""
    n = len(table)
    moved = rng.random(n) < share
    step = rng.normal(0, 0.5, n)
    other = moved & (rng.random(n) < 0.5)  # in another structure too
    d = table["structure"].str.extract(r"(\d+)$").cast(pl.Int64).to_numpy() + rng.choice([-2, -1, 1, 2], n) * other
    return table.with_columns(
        pl.Series("loss", table["loss"].to_numpy() * np.exp(np.where(moved, step, 1e-9 * step))),
        pl.Series("rmse", table["rmse"].to_numpy() * np.exp(np.where(moved, rng.normal(0, 0.3, n), 0.0))),
        pl.Series("fit", table["fit"].to_numpy() - np.where(moved, rng.normal(0, 2, n), 0.0)),
        pl.Series("width", table["width"].to_numpy() * np.exp(np.where(moved, rng.normal(0, 0.4, n), 0.0))),
        pl.Series("held", np.where(moved, rng.binomial(4, 0.95, n), table["held"].to_numpy())),
        pl.Series("structure", [f"hammerstein_wiener, d {k}" for k in d]),
        pl.Series("seconds", table["seconds"].to_numpy() * rng.lognormal(1, 1, n)),
    )
