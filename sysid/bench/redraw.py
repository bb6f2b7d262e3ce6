"""One cell of the table once more, with its signals, so that a bad row can be looked at."""

from dataclasses import dataclass

import numpy as np
import polars as pl

from sysid.base.errors import InputError
from sysid.bench.leaderboard import CAP, NEAR, method_of
from sysid.bench.method import Method
from sysid.bench.task import Family


@dataclass(frozen=True)
class Redrawn:
    """The first test of a task with a method's free run: u, y, run and the noise-free output (N,), if it is known.

    The first `drop` samples are not scored. `given` says what the plant is.
    """

    scenario: str
    method: str
    seed: int
    Ts: float
    drop: int
    unit: str
    u: np.ndarray
    y: np.ndarray
    run: np.ndarray
    clean: np.ndarray | None
    given: str


def redraw(family: Family, scenario: str, method: Method, seed: int, seconds: float) -> Redrawn:
    """Make the task of `scenario` (without the family's name) again and solve it again.

    Raises InputError if the method has no result this time.
    """
    task = family.make(scenario, seed)
    name, test = next(iter(task.tests.items()))
    u, y = test.u[:, 0], test.y[:, 0]
    outcome = method.solve(task, {name: (u, y[: task.drop])}, seconds, seed)
    where = f"{family.name}/{scenario}"
    if outcome.status != "ok":
        raise InputError(f"{method.name} has no result on {where}, seed {seed}: {outcome.status}; draw another row")
    clean = None if task.truth is None else np.asarray(task.truth.y[name], dtype=float)
    run, Ts = outcome.runs[name], test.Ts
    return Redrawn(where, method.name, seed, Ts, task.drop, task.unit, u, y, run, clean, task.given)


def worst_to_draw(rows: pl.DataFrame, methods: list[str], count: int) -> list[tuple[str, str, int]]:
    """The cells with the largest finite gaps of some methods, one a scenario: (scenario, method, seed).

    A gap within the smallest margin is not worth a picture.
    """
    mine = rows.filter(pl.col("method").is_in(methods) & (pl.col("gap") > NEAR[0]) & pl.col("ok"))
    ranked = mine.with_columns(pl.col("gap").clip(-CAP, CAP)).sort(
        "gap", "scenario", "method", "seed", descending=[True, False, False, False]
    )
    first = ranked.unique("scenario", keep="first", maintain_order=True).head(count)
    cells = first.select("scenario", "method", "seed").rows()
    return [(scenario, method_of(scenario, method), int(seed)) for scenario, method, seed in cells]
