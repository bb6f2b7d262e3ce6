"""A cell of the benchmark: a scenario, a method and a seed become one row of the table, or signals to look at.

`run_cells` fills a table. A run that was stopped or killed continues where it was.
"""

import json
import platform
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from importlib.metadata import version
from typing import Any

import numpy as np

from sysid.base.criteria import fit_percent
from sysid.base.errors import InputError
from sysid.base.parallel import results
from sysid.base.poles import match, pairs
from sysid.bench.border import answer, name_of
from sysid.bench.method import Method, Outcome
from sysid.bench.table import COLUMNS, DIVERGED, UNTRIED, Table
from sysid.bench.task import Family, Task

STEADY = "steady state"  # an extra run over levels, each held until the plant is at rest
LEVELS = 9
REST = 1e-4  # what is left of a step when a level ends
LONGEST = 20_000  # samples of a level; a slower plant has no steady state here


@dataclass(frozen=True)
class Cell:
    """One row to be: the objects themselves, so that it can be run in another process."""

    family: Family
    scenario: str
    method: Method
    seed: int
    seconds: float

    @property
    def key(self) -> tuple[str, str, int]:
        """What makes a row unique: (scenario, method, seed)."""
        return f"{self.family.name}/{self.scenario}", name_of(self.method), self.seed


def run_cells(
    cells: Sequence[Cell],
    table: Table,
    workers: int | None = None,
    scheduler: str | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> int:
    """Run every cell that has no row yet; returns how many were run. Rows without data or environment are run again.

    `workers` are local processes, `scheduler` the address of a Dask scheduler (see `sysid.base.parallel`). Each row is
    on the disk as soon as its cell ends.
    """
    with table.writing():
        keys = table.row_keys(UNTRIED)
        todo = [cell for cell in cells if cell.key not in keys]
        for k, (_, row) in enumerate(results(run_cell, todo, workers, scheduler), 1):
            table.add(row)
            if progress is not None:
                progress(k, len(todo))
    return len(todo)


def run_cell(cell: Cell) -> dict[str, Any]:
    """The row of one cell, with every column; whatever the method does, there is a row."""
    row: dict[str, Any] = {name: None if kind.is_numeric() else "" for name, kind in COLUMNS.items()}
    row |= dict(zip(("scenario", "method", "seed"), cell.key, strict=True))
    machine = f"{platform.system()} {platform.machine()}, Python {platform.python_version()}"
    row |= {"budget": cell.seconds, "machine": machine, "qpal": version("qpal")}
    try:
        task = cell.family.make(cell.scenario, cell.seed)
    except InputError as error:
        return row | {"status": f"no data: {error}"}
    stairs = staircase(task)
    tests = {name: (t.u[:, 0], t.y[: task.drop, 0]) for name, t in task.tests.items()}
    if stairs is not None:
        tests[STEADY] = stairs[0], stairs[1][: task.drop]
    outcome = answer(cell.method, task, tests, cell.seconds, cell.seed)
    row |= {"status": outcome.status, "seconds": outcome.seconds, "memory": outcome.memory, "version": outcome.version}
    row |= {name: outcome.details.get(name, "") for name in ("stop", "structure")}
    if outcome.status == "ok":
        with np.errstate(all="ignore"):  # a run of 1e300 has no finite square, and its row says so
            row |= scores(task, outcome) | accuracy(task, outcome, stairs)
    return {name: None if isinstance(v, float) and not np.isfinite(v) else v for name, v in row.items()}


def scores(task: Task, outcome: Outcome) -> dict[str, Any]:
    """Free-run errors on the tests. A method with a run that is not finite has the fit `DIVERGED`."""
    errors, fits, best, squares = dict[str, float](), [], [], []
    finite = all(np.isfinite(run).all() for run in outcome.runs.values())
    for name, test in task.tests.items():
        keep = test.observed[task.drop :, 0]
        y, run = test.y[task.drop :, 0][keep], outcome.runs[name][task.drop :][keep]
        run = np.where(np.isfinite(run), run, 1e12)
        errors[name] = float(np.sqrt(np.mean((y - run) ** 2)))
        squares.append((y - run) ** 2)
        fits.append(max(fit_percent(y, run), 0.1 * DIVERGED))
        if task.truth is not None:
            best.append(fit_percent(y, task.truth.y[name][task.drop :][keep]))
    return {
        "fit": float(np.mean(fits)) if finite else DIVERGED,
        "oracle": float(np.mean(best)) if best else None,
        "rmse": float(np.sqrt(np.mean(np.concatenate(squares)))),
        "errors": json.dumps(errors),
        "loss": outcome.details.get("loss"),
        "noise": task.truth.noise**2 if task.truth is not None else None,
    }


def accuracy(task: Task, outcome: Outcome, stairs: tuple[np.ndarray, ...] | None) -> dict[str, Any]:
    """Errors of poles and of the steady state, and how many intervals hold, for a plant with a truth."""
    truth, out = task.truth, dict[str, Any]()
    if stairs is not None:
        _, y, ends = stairs
        levels = outcome.runs[STEADY][ends]
        scale = float(np.std(np.concatenate([np.asarray(v) for v in truth.y.values()]))) if truth else np.nan
        out["map_error"] = float(min(np.sqrt(np.mean((levels - y[ends]) ** 2)) / scale, 1e6))
    if truth is None or truth.poles is None or "poles" not in outcome.details:
        return out
    poles = np.array(outcome.details["poles"]) @ np.array([1.0, 1.0j])
    out["pole_error"] = pole_error(poles, truth.poles, task.train.Ts)
    claims = outcome.details.get("intervals", {}).get("pole", ())
    if len(claims) == len(truth.poles):
        out |= interval_score(np.array(claims), truth.poles)
    return out


def staircase(task: Task) -> tuple[np.ndarray, np.ndarray, np.ndarray] | None:
    """Input (N,), output (N,) and last sample of each level for a chain that comes to rest; None for another truth."""
    truth = task.truth
    if truth is None or truth.chain is None or truth.theta is None or truth.poles is None or not len(truth.poles):
        return None
    slowest = float(np.abs(truth.poles).max())
    n = int(np.log(REST) / np.log(slowest)) + 20 if slowest < 1.0 else LONGEST + 1
    if n > LONGEST:
        return None
    levels = np.quantile(task.train.u[:, 0], np.linspace(0.02, 0.98, LEVELS))
    u = np.repeat(levels, max(n, task.drop + 1))
    return u, truth.chain.simulate(truth.theta, u), np.arange(1, LEVELS + 1) * max(n, task.drop + 1) - 1


def pole_error(poles: np.ndarray, true: np.ndarray, Ts: float) -> float:
    """Largest error of a true pole in the s-plane (see `sysid.base.poles`), 1e6 at most; nan if poles are missing."""
    matches = match(poles, true, Ts)
    return min(max(pair.s_error for pair in matches), 1e6) if len(matches) == len(true) > 0 else float("nan")


def interval_score(claims: np.ndarray, true: np.ndarray) -> dict[str, Any]:
    """Of intervals [re, im, half axis of re, of im] (n, 4): how many there are, hold, and their median relative width.

    Conjugates are counted once, and the imaginary part of a real pole not at all.
    """
    rows = true.imag >= 0.0
    claim_index, true_index = pairs(claims[:, 0] + 1j * claims[:, 1], true)
    order = claim_index[np.argsort(true_index)]
    claims, z = claims[order][rows], true[rows]
    pair = z.imag > 0.0
    error = np.concatenate([np.abs(claims[:, 0] - z.real), np.abs(claims[:, 1] - z.imag)[pair]])
    half = np.concatenate([claims[:, 2], claims[:, 3][pair]])
    share = half / np.abs(1.0 - np.concatenate([z, z[pair]]))
    finite = np.isfinite(half)
    return {
        "intervals": int(finite.sum()),
        "held": int((error <= half)[finite].sum()),
        "width": float(np.median(share[finite])) if finite.any() else None,
    }


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
    outcome = answer(method, task, {name: (u, y[: task.drop])}, seconds, seed)
    label = f"{family.name}/{scenario}"
    if outcome.status != "ok":
        raise InputError(f"{name_of(method)} has no result on {label}, seed {seed}: {outcome.status}; draw another row")
    clean = None if task.truth is None else np.asarray(task.truth.y[name], dtype=float)
    run, Ts = outcome.runs[name], test.Ts
    return Redrawn(label, name_of(method), seed, Ts, task.drop, task.unit, u, y, run, clean, task.given)
