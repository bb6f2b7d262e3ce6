"""Structure search: every structure, cross-validated in free run within a budget of seconds, parallel, resumable.

Round 1: the defaults of every structure; linear models of all orders and delays, which cost little; the first settings
of every structure that has some of its own. Round 2: every pair of maps around the best orders, and the best pairs
around the next ones. Both use few starts, and the first part of every block of a long record. Round 3: the best of
every structure and the best others, with many starts on the whole record. Round 4 and later: what lies around the best
ones (orders, delays, knots and maps), until nothing there is better.

Each candidate is fitted to one part of the record and judged on the other, and vice versa (`sysid.selection.folds`).
The best of every structure then meet on parts that differ in kind, as the inputs of a model's use do: fitted to low
levels and judged on high ones, to slow and to fast inputs, to one end and the other.
"""

import time
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from sysid.base.checks import checked
from sysid.base.errors import InputError
from sysid.base.parallel import results
from sysid.data.record import IOData
from sysid.model.recipes import Recipe
from sysid.selection.final_fit import final_fit
from sysid.selection.folds import Fold, folds, folds_of_other_kinds
from sysid.selection.journal import Journal, writing
from sysid.selection.judge import Effort, Job, from_journal, judge, judge_by_kind, unchanged
from sysid.selection.space import ORDERS, Space
from sysid.selection.table import (
    BLOCKS,
    SECONDS,
    Row,
    Selection,
    choose_by_kind,
    cut,
    mean_log,
    ranked,
    settings,
)

_SCREENED = 2000  # samples of each part in the first two rounds
_LEADERS = 12  # candidates of round 3
_CLIMBS = 10  # rounds around the best
_REACH = 1.5  # times the error of the best, within which another structure is searched further
_PERFECT = 99.9  # fit [%] beyond which no other structure has anything to gain
# Shares of the budget at whose end a round begins no more candidates; the rest is for the fit to all the data.
_SCREENING, _LEADING, _CLIMBING, _CHOICE = 0.4, 0.6, 0.75, 0.88
_FINALISTS, _KIND_STARTS = 5, 3
_KINDS = 0  # the number of the choice in a journal
_FIT_SHARE, _SCREENED_FIT_SHARE = 0.1, 0.03  # of the budget, for one fit


@checked(deferred=("seconds",))
def select(
    data: IOData,
    space: Space | None = None,
    search: str = "auto",
    seed: int = 0,
    jobs: int | None = None,
    journal: str | Path | None = None,
    progress: Callable[[int, int, str], None] | None = None,
    scheduler: str | None = None,
    seconds: float = SECONDS,
) -> Selection:
    """Search the space on a record of one input and output and fit the chosen structure to all of it.

    jobs: processes (all cores if None), or the address of a Dask `scheduler` (see `sysid.base.parallel`); journal: a
    file of finished candidates from which a stopped search continues; progress(done, total, name) is called after each
    candidate. seconds: budget of the search, with the last fit; the result does not depend on jobs unless the budget
    ends the search or a fit, which `notes` of the result say; a structure that got no time has a row that says so. A
    structure with absolute signals is fitted to the record with its means restored, see `Recipe.scale`. Raises
    InputError for a journal of another record, space or seed, for one that another search writes to, for a record too
    short to be halved, for a budget that ends before one candidate is tried, and where no structure has a valid free
    run.
    """
    space = Space() if space is None else space
    if not seconds > 0:
        raise InputError(f"seconds is {seconds}; give a positive number")
    with writing(journal, data, (vars(space), search, seed)) as book:
        work = _Work(folds(data), search, seed, jobs, scheduler, book, progress, time.time(), seconds)
        rows_by_candidate = _judge_rounds(space, data, work)
        rows, chosen_row = ranked(rows_by_candidate)
        if not np.isfinite(rows[0].fit_percent):
            raise InputError(_none_valid(rows))
        rows, chosen_row = _choose(rows, chosen_row, data, work)
        remaining = max(work.begun + seconds - time.time(), 0.1 * seconds)
        chosen_row, fit, notes = final_fit(rows, chosen_row, data, search, seed, Effort(space.starts, 200, remaining))
        fit.remember(chosen_row.candidate.scale(data))
        rows += work.untried(space.kinds, {r.candidate.name for r in rows})
        notes = (*book.notes, *work.notes(), *notes)
        path = None if journal is None else Path(journal)
        return Selection(
            tuple(rows), chosen_row, fit, notes, time.time() - work.begun, seconds, len(work.left_out), path
        )


def _judge_rounds(space: Space, data: IOData, work: "_Work") -> dict[Recipe, Row]:
    """Every candidate with its last row."""
    rows_by_candidate: dict[Recipe, Row] = {}

    def take(rows: Sequence[Row]) -> None:
        rows_by_candidate.update({r.candidate: r for r in rows})

    cheap = Effort(1, 50, _SCREENED_FIT_SHARE * work.seconds)
    full = Effort(space.starts, 200, _FIT_SHARE * work.seconds)
    grid = space.grid()
    first = [c for c in grid if type(c) in space.kinds or len(space.kinds) > 1]
    tasters = space.tasters(data)
    take(work.judge(1, tasters, cheap, _SCREENING, short=True))
    take(work.judge(1, [c for c in (*first, *space.ladders(data)) if c not in tasters], cheap, _SCREENING, short=True))
    if not rows_by_candidate:
        raise InputError(
            f"the budget of {work.seconds:g} s was over before any structure was tried; give the search more seconds"
        )
    linear = sorted((rows_by_candidate[c] for c in grid if c in rows_by_candidate), key=_by_fit)
    orders = [{name: r.candidate.orders[name] for name in ORDERS} for r in linear if np.isfinite(r.fit_percent)]
    brief = Effort(1, 30, cheap.seconds)
    map_rows = work.judge(2, space.around(orders[:1]), brief, _SCREENING, short=True)
    best_third = sorted(map_rows, key=_by_fit)[: -(-len(map_rows) // 3)]
    further_candidates = [replace(r.candidate, **o) for o in orders[1 : space.kept_orders] for r in best_third]
    take([*map_rows, *work.judge(2, further_candidates, brief, _SCREENING, short=True)])
    take(work.judge(3, _leaders(rows_by_candidate), full, _LEADING))
    full_effort = {c for c, r in rows_by_candidate.items() if r.round >= 3}
    best: Recipe | None = None
    smallest: Recipe | None = None
    for k in range(_CLIMBS):
        rows, chosen_row = ranked(rows_by_candidate)
        if chosen_row.candidate == smallest and any(r.equal for r in rows if r.candidate == best):
            break  # the last round brought nothing that differs from what was there
        best, smallest = rows[0].candidate, chosen_row.candidate
        centres = [r.candidate for r in _rows_in_reach(rows, chosen_row)]
        new = [c for c in dict.fromkeys(n for c in centres for n in space.beside(c)) if c not in full_effort]
        new = [*_better_candidates(rows_by_candidate, full_effort), *new]
        new_rows = work.judge(4 + k, new, full, _CLIMBING)
        full_effort |= {r.candidate for r in new_rows}
        take(new_rows)
        if not new_rows:
            break
    return rows_by_candidate


def _choose(rows: list[Row], chosen: Row, data: IOData, work: "_Work") -> tuple[list[Row], Row]:
    """The rows, with what the finalists do on parts of other kinds, and the one that is chosen by it.

    The finalists are in the order of their errors, so that a budget which ends early leaves out the worst.
    """
    in_reach = list({r.candidate: r for r in _rows_in_reach(rows, chosen)}.values())[:_FINALISTS]
    finalists = work.judge_by_kind(in_reach, folds_of_other_kinds(data)) if len(in_reach) > 1 else []
    work.unmet = len(in_reach) - len(finalists) if len(in_reach) > 1 else 0
    if len(finalists) < 2 or finalists[0].candidate != chosen.candidate:
        return rows, chosen
    by_candidate = {r.candidate: r for r in finalists}
    return [by_candidate.get(r.candidate, r) for r in rows], choose_by_kind(finalists)


def _none_valid(rows: Sequence[Row]) -> str:
    """Why no candidate can be used: what most of them say, and how many."""
    reason, times = Counter(row.why.partition(";")[0] for row in rows).most_common(1)[0]
    share = f"all {len(rows)}" if times == len(rows) else f"{times} of {len(rows)}"
    return (
        "no structure of the space has a valid free run on this record, each half of which is fitted and judges the "
        f"other; of {share} candidates: {reason}; record longer, give the search more of the record (qpal identify "
        "--split "
        "0.7), or widen the space"
    )


def _by_fit(row: Row) -> tuple[float, int]:
    return -row.fit_percent, row.d


def _leaders(rows_by_candidate: dict[Recipe, Row]) -> list[Recipe]:
    """The best of every structure, best first, then the best others."""
    leaders: list[Recipe] = []
    names: set[str] = set()
    rows = [r for r in sorted(rows_by_candidate.values(), key=_by_fit) if np.isfinite(r.fit_percent)]
    for r in rows:
        if r.candidate.name not in names:
            names.add(r.candidate.name)
            leaders.append(r.candidate)
    other_candidates = [r.candidate for r in rows if r.candidate not in leaders]
    return leaders + other_candidates[: max(0, _LEADERS - len(leaders))]


def _better_candidates(rows_by_candidate: dict[Recipe, Row], full_effort: set[Recipe]) -> list[Recipe]:
    """Candidates that had little effort and are nevertheless better than the best of those that had all of it."""
    best = max((rows_by_candidate[c].fit_percent for c in full_effort), default=-np.inf)
    rows = sorted(
        (r for c, r in rows_by_candidate.items() if c not in full_effort and r.fit_percent > best), key=_by_fit
    )
    return [r.candidate for r in rows[:_LEADERS]]


def _rows_in_reach(rows: list[Row], chosen: Row) -> list[Row]:
    """The rows around which it goes on: chosen, best, and the best of every structure that is not far behind."""
    if not np.isfinite(rows[0].fit_percent) or not rows[0].whole:
        return []
    if rows[0].fit_percent > _PERFECT:
        return [chosen]
    limit = 100.0 - _REACH * (100.0 - rows[0].fit_percent)
    centres, names = [chosen, rows[0]], {rows[0].candidate.name}
    for r in rows:
        if r.whole and r.candidate.name not in names and r.fit_percent >= limit:
            names.add(r.candidate.name)
            centres.append(r)
    return centres


@dataclass
class _Work:
    folds: tuple[Fold, Fold]
    search: str
    seed: int
    jobs: int | None
    scheduler: str | None
    book: Journal
    progress: Callable[[int, int, str], None] | None
    begun: float  # of time.time(), which the machines of a cluster share
    seconds: float
    left_out: list[Recipe] = field(default_factory=list)
    unmet: int = 0  # finalists that were not judged by kind

    def judge(
        self, number: int, candidates: Sequence[Recipe], effort: Effort, share: float, short: bool = False
    ) -> list[Row]:
        """Validate candidates; those that are not in the journal run in parallel, until their `share` of the time."""
        parts = tuple(f.shortened(_SCREENED) for f in self.folds) if short else self.folds
        whole = all(p.estimation.N == f.estimation.N for p, f in zip(parts, self.folds, strict=True))
        rows: dict[Recipe, Row] = {}
        todo = []
        for c in candidates:
            entry = self.book.find(number, settings(c))
            if entry is None:
                todo.append(c)
            else:
                rows[c] = from_journal(c, number, entry)
        deadline = self.begun + share * self.seconds
        jobs = [Job(c, parts, effort, self.search, self.seed, number, whole, deadline) for c in todo]
        # Results come as they finish, so that the journal holds them when the search is killed.
        for k, row in results(judge, jobs, self.jobs, self.scheduler):
            if row is None:
                self.left_out.append(todo[k])
                continue
            rows[row.candidate] = row
            if time.time() < deadline:  # else its fits may have ended early
                self.book.add(number, settings(row.candidate), unchanged(row))
            if self.progress is not None:
                self.progress(len(rows), len(candidates), str(row.candidate))
        return [rows[c] for c in candidates if c in rows]

    def judge_by_kind(self, finalists: Sequence[Row], kinds: tuple[Fold, ...]) -> list[Row]:
        """The finalists with their errors on all folds, in their order; those that the budget left no time for go."""
        deadline = self.begun + _CHOICE * self.seconds
        effort = Effort(_KIND_STARTS, 100, _SCREENED_FIT_SHARE * self.seconds)
        errors: dict[Recipe, np.ndarray] = {}
        for row in finalists:
            if entry := self.book.find(_KINDS, settings(row.candidate)):
                errors[row.candidate] = np.array(entry["kinds"])
        todo = [r.candidate for r in finalists if r.candidate not in errors]
        jobs = [Job(c, kinds, effort, self.search, self.seed, _KINDS, True, deadline) for c in todo]
        for k, means in results(judge_by_kind, jobs, self.jobs, self.scheduler):
            if means is None:
                continue
            errors[todo[k]] = means
            if time.time() < deadline:
                self.book.add(_KINDS, settings(todo[k]), {"kinds": means.tolist()})
            if self.progress is not None:
                self.progress(len(errors), len(finalists), f"{todo[k]}, on other kinds of parts")
        both = {r.candidate: [mean_log(part) for part in np.split(r.errors, len(self.folds))] for r in finalists}
        return [
            replace(r, kinds=np.concatenate([both[r.candidate], errors[r.candidate]]))
            for r in finalists
            if r.candidate in errors
        ]

    def untried(self, kinds: Sequence[type[Recipe]], tried: set[str]) -> list[Row]:
        """A row for each structure that the budget left no time for, so that the table tells of every structure."""
        rows = []
        for kind in kinds:
            if kind.name not in tried:
                candidate = next((c for c in self.left_out if type(c) is kind), kind())
                no_errors = np.full(BLOCKS, np.inf)
                reason = f"not tried: the budget of {self.seconds:g} s was over; give the search more seconds"
                rows.append(Row(candidate, -np.inf, 0, 0, no_errors, False, whole=False, why=reason))
        return rows

    def notes(self) -> tuple[str, ...]:
        """What the budget left out."""
        words = cut(self.seconds, len(self.left_out))
        notes = [f"{words}; give it more seconds"] if words else []
        if self.unmet:
            notes.append(
                f"the budget of {self.seconds:g} s left no time to compare {self.unmet} of the best on parts of other "
                "levels, rates and ends; give the search more seconds"
            )
        return tuple(notes)
