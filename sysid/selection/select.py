"""Structure search: orders x delay x maps, cross-validated in free run, with early pruning, parallel, resumable.

The search has four rounds. Round 1: linear models of all orders and delays, which cost little, and an actuated joint.
Round 2: every pair of maps around the few best orders, one start each. Round 3: the best third of these with many
starts, and the joint if it beat every linear model, as on an integrating record with end stops. Round 4: lower orders
around the winner, as long as the fit does not get worse. Each candidate is fitted to one half of the record and
validated on the other, and vice versa (two folds), so the winner is chosen on unseen data.
"""

import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from scipy.special import stdtrit

from sysid.base.errors import InputError
from sysid.base.executor import results
from sysid.base.json_values import plain
from sysid.data.record import IOData
from sysid.estimation.fit import fit_chain
from sysid.estimation.result import Fit
from sysid.model.recipes import Recipe
from sysid.selection.journal import Journal
from sysid.solver.iterate import Options
from sysid.structures import TABLE

_SHRINKING = 6  # how often the winner's orders may come down
_SAME, _NEAR = 1.01, 1.1  # times the loss of the best
BLOCKS = 20  # stretches of the judged samples whose errors are compared pair by pair
ORDERS = ("nb", "nf", "nk")
MAPS = ("unit_gain", "saturation", "dead_zone", "piecewise_linear")


@dataclass(frozen=True)
class Space:
    """The search space: every combination of nb, nf, nk, and of the maps that the structure has.

    alone: structures without orders, tried as they are (an actuated joint).
    """

    nb: tuple[int, ...] = (1, 2, 3)
    nf: tuple[int, ...] = (1, 2, 3)
    nk: tuple[int, ...] = (1, 2, 3)
    input: tuple[str, ...] = MAPS
    output: tuple[str, ...] = MAPS
    kept_orders: int = 3
    starts: int = 5
    alone: bool = True

    def __post_init__(self) -> None:
        for name in ("nb", "nf", "nk", "input", "output"):
            if not getattr(self, name):
                raise InputError(f"the search space has no {name}; name at least one")


@dataclass(frozen=True)
class Row:
    """One candidate of the ranked table; `errors` (BLOCKS,) are mean squared free-run errors on unseen segments.

    `equal`: its errors do not differ significantly from the best candidate's (paired t-test on their logarithms at 95
    %; `_ranked` has the tolerances).
    """

    candidate: Recipe
    fit_percent: float
    d: int
    round: int
    errors: np.ndarray
    converged: bool
    equal: bool = False


@dataclass(frozen=True)
class Selection:
    """Ranked rows, the chosen one (the smallest of those equal to the best), and its fit to all the data."""

    rows: tuple[Row, ...]
    chosen: Row
    fit: Fit

    def sentence(self) -> str:
        """The result in words."""
        equals = [r for r in self.rows if r.equal]
        best = self.rows[0]
        text = f"{best.candidate} has the best free run on unseen data ({best.fit_percent:.2f} %, d {best.d})"
        if len(equals) > 1:
            text += f"; {len(equals) - 1} other(s) do not differ from it significantly"
        if self.chosen is not best:
            small = self.chosen
            text += f", of which {small.candidate} is the smallest ({small.fit_percent:.2f} %, d {small.d})"
        return text + "."

    def as_dict(self) -> dict[str, Any]:
        """The ranked table, ready for JSON."""
        rows = [
            {
                **_row(r.candidate),
                "fit_percent": r.fit_percent,
                "d": r.d,
                "round": r.round,
                "equal": r.equal,
            }
            for r in self.rows
        ]
        return plain({"chosen": _row(self.chosen.candidate), "sentence": self.sentence(), "rows": rows})


def select(
    data: IOData,
    space: Space | None = None,
    search: str = "auto",
    seed: int = 0,
    jobs: int | None = None,
    journal: str | Path | None = None,
    progress: Callable[[int, int, str], None] | None = None,
    scheduler: str | None = None,
) -> Selection:
    """Search the space on a record of one input and output and fit the chosen structure to all of it.

    jobs: processes (all cores if None), or the address of a Dask `scheduler` (see `sysid.base.executor`); journal: a
    file of finished candidates from which a stopped search continues; progress(done, total, name) is called after each
    candidate. The results do not depend on jobs. A structure with absolute signals is fitted to the record with its
    means restored, see `Recipe.scale`. Raises InputError for a journal of another record, space or seed.
    """
    space = space or Space()
    folds = _folds(data)
    book = Journal(journal, data, (vars(space), search, seed))
    work = _Work(folds, search, seed, jobs, scheduler, book, progress)
    every = [dict(zip(ORDERS, o, strict=True)) for o in itertools.product(space.nb, space.nf, space.nk)]
    linear = [c for o in every if o["nb"] <= o["nf"] + 1 for c in _made_of(o)]
    first = work.judge(1, linear, starts=1, iterations=50)
    alone = work.judge(1, _alone() if space.alone else [], starts=1, iterations=50)
    orders = _best_orders(first, space.kept_orders)
    second = work.judge(2, _around(space, orders), starts=1, iterations=30)
    survivors = sorted(second, key=_score)[: max(3, -(-len(second) // 3))]
    survivors += [r for r in alone if r.fit_percent > max(other.fit_percent for other in first)]
    third = work.judge(3, [r.candidate for r in survivors], starts=space.starts, iterations=200)
    judged = {r.candidate: r for r in (*first, *alone, *second, *third)}  # the latest round counts
    rows, chosen = _ranked(judged)
    for _ in range(_SHRINKING):
        smaller = [c for c in _smaller(chosen.candidate) if c not in judged or judged[c].round < 3]
        judged |= {r.candidate: r for r in work.judge(4, smaller, starts=space.starts, iterations=200)}
        before = chosen
        rows, chosen = _ranked(judged)
        if chosen.candidate == before.candidate:
            break
    if not np.isfinite(rows[0].fit_percent):
        raise InputError(
            "no structure of the space has a valid free run on this record; inspect the data or widen the space"
        )
    winner = chosen.candidate
    best = fit_chain(winner.model(), winner.scale(data), search=search, starts=space.starts, seed=seed)
    return Selection(tuple(rows), chosen, best)


@dataclass(frozen=True)
class _Work:
    folds: tuple[tuple[IOData, IOData], ...]
    search: str
    seed: int
    jobs: int | None
    scheduler: str | None
    book: Journal
    progress: Callable[[int, int, str], None] | None

    def judge(self, number: int, candidates: Sequence[Recipe], starts: int, iterations: int) -> list[Row]:
        """Validate candidates; those that are not in the journal run in parallel."""
        rows: dict[Recipe, Row] = {}
        todo = []
        for c in candidates:
            known = self.book.find(number, _row(c))
            if known is None:
                todo.append(c)
            else:
                rows[c] = Row(c, known["fit"], known["d"], number, np.array(known["errors"]), known["converged"])
        options = Options(max_iterations=iterations)
        jobs = [(c, self.folds, self.search, starts, self.seed, options, number) for c in todo]
        # Results come as they finish, so that the journal holds them when the search is killed.
        for _, row in results(_judge_one, jobs, self.jobs, self.scheduler):
            rows[row.candidate] = row
            values = {"fit": row.fit_percent, "d": row.d, "errors": row.errors.tolist(), "converged": row.converged}
            self.book.add(number, _row(row.candidate), values)
            if self.progress is not None:
                self.progress(len(rows), len(candidates), str(row.candidate))
        return [rows[c] for c in candidates]


def _judge_one(job: tuple[Any, ...]) -> Row:
    """Free-run errors of one candidate on the unseen part of every fold."""
    candidate, folds, search, starts, seed, options, number = job
    parts, d, converged, variance = [], 0, True, 0.0
    for estimation, unseen in folds:
        try:
            estimation, unseen = candidate.scale(estimation), candidate.scale(unseen)
            fit = fit_chain(candidate.model(), estimation, search=search, starts=starts, seed=seed, options=options)
            error = fit.residuals(unseen) ** 2
        except InputError:  # too short for these orders: not a usable structure here
            return Row(candidate, -np.inf, 0, number, np.full(BLOCKS, np.inf), False)
        d, converged = fit.criteria.d, converged and fit.stop.converged
        parts.append(np.array([block.mean() for block in np.array_split(error, BLOCKS // len(folds))]))
        variance += float(unseen.y[fit.n_init :].var()) / len(folds)
    errors = np.concatenate(parts)
    mean = float(errors.mean())
    percent = 100.0 * (1.0 - np.sqrt(mean / variance)) if np.isfinite(mean) and variance > 0 else -np.inf
    return Row(candidate, percent, d, number, np.where(np.isfinite(errors), errors, np.inf), converged)


def _folds(data: IOData) -> tuple[tuple[IOData, IOData], ...]:
    """Two halves, one for estimation and the other for validation, and vice versa; every experiment is halved."""
    first, second = data.split(0.5)
    return (first, second), (second, first)


def _score(row: Row) -> tuple[float, int]:
    return -row.fit_percent, row.d


def _best_orders(rows: list[Row], count: int) -> list[dict[str, int]]:
    ranked = [r for r in sorted(rows, key=_score) if np.isfinite(r.fit_percent)]
    return [r.candidate.orders for r in ranked[:count]]


def _made_of(orders: dict[str, int], **maps: str) -> list[Recipe]:
    """Every structure of these orders that has exactly these maps."""
    kinds = [kind for kind in TABLE.values() if kind.searched and kind.of_kind("order") == ORDERS]
    return [kind(**orders, **maps) for kind in kinds if set(kind.of_kind("map")) == set(maps)]


def _alone() -> list[Recipe]:
    """The structures without orders."""
    return [kind() for kind in TABLE.values() if kind.searched and not kind.of_kind("order")]


def _around(space: Space, orders: list[dict[str, int]]) -> list[Recipe]:
    """Every pair of maps at every order, as the resulting structure."""
    found = []
    for o, first, last in itertools.product(orders, space.input, space.output):
        maps = {name: m for name, m in (("input_map", first), ("output_map", last)) if m != "unit_gain"}
        if maps:
            found += _made_of(o, **maps)
    return found


def _smaller(c: Recipe) -> list[Recipe]:
    """The same maps with fewer zeros, fewer poles, or one coefficient of B replaced by a delay."""
    if not c.orders:
        return []
    nb, nf, nk = (c.orders[name] for name in ORDERS)
    orders = [(nb - 1, nf, nk), (nb, nf - 1, nk), (nb - 1, nf - 1, nk), (nb - 1, nf, nk + 1)]
    return [replace(c, **dict(zip(ORDERS, o, strict=True))) for o in orders if o[0] >= 1 and o[1] >= 0]


def _row(c: Recipe) -> dict[str, Any]:
    """A candidate in the form of tables and journals: orders 0 if it has none, None for a missing map."""
    orders = {**dict.fromkeys(ORDERS, 0), **c.orders}
    return {"structure": c.name, **orders, "input": c.maps.get("input_map"), "output": c.maps.get("output_map")}


def _ranked(judged: dict[Recipe, Row]) -> tuple[list[Row], Row]:
    """Rows sorted best first, with those equal to the best marked, and the smallest of these.

    Errors are compared by their logarithms; otherwise one bad segment, on which every model fails, would hide all
    differences. A loss up to `_SAME` times the best counts as equal even if the difference is significant. A loss
    above `_NEAR` times the best is not equal even if it is not significant: a test on twenty segments that differ
    strongly has little power.
    """
    rows = sorted(judged.values(), key=_score)
    limit = float(stdtrit(BLOCKS - 1, 0.975))
    best = np.log(np.maximum(rows[0].errors, 1e-300))
    out = []
    for k, r in enumerate(rows):
        gap = np.log(np.maximum(r.errors, 1e-300)) - best
        finite = bool(np.all(np.isfinite(gap)))
        told = not finite or float(gap.mean()) > limit * float(gap.std(ddof=1)) / np.sqrt(BLOCKS)
        ratio = float(r.errors.mean()) / max(float(rows[0].errors.mean()), 1e-300) if finite else np.inf
        told = (told and ratio > _SAME) or ratio > _NEAR
        out.append(replace(r, equal=k == 0 or not told))
    return out, min((r for r in out if r.equal), key=lambda r: (r.d, -r.fit_percent))
