"""The table of a structure search: one row a candidate, ranked, and the row that is handed over."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from scipy.special import stdtr, stdtrit

from sysid.base.files import json_value
from sysid.base.handlers import Shown
from sysid.estimation.result import Fit
from sysid.model.recipes import Recipe
from sysid.nlarx.result import NlarxFit

SECONDS = 110.0  # of a whole search
BLOCKS = 20  # stretches of the judged samples whose errors are compared pair by pair
SURE = 0.95
_SAME, _NEAR = 1.01, 1.1  # times the loss of the best
_POINTS = 0.5  # of fit [%] within which a smaller candidate may replace the best


@dataclass(frozen=True)
class Row:
    """One candidate of the ranked table; `errors` (BLOCKS,) are mean squared free-run errors on unseen segments.

    `whole`: judged on the whole record, not on a shortened one. `why`: the reason why it could not be fitted or ended
    early. `thetas` are the parameters of the fits of both folds. `equal`: its errors do not differ significantly from
    the best candidate's (paired t-test on their logarithms at 95 %; `ranked` has the tolerances). `kinds` (8,): mean
    logarithms of its squared errors on both folds and on the six of other kinds, for finalists; None for the others.
    """

    candidate: Recipe
    fit_percent: float
    d: int
    round: int
    errors: np.ndarray
    converged: bool
    equal: bool = False
    whole: bool = True
    why: str = ""
    thetas: tuple[np.ndarray, ...] = field(default=(), repr=False)
    kinds: np.ndarray | None = field(default=None, repr=False)

    @property
    def score_of_kinds(self) -> float:
        """Mean logarithm of the squared errors over parts of the same kind and of other kinds."""
        return np.inf if self.kinds is None else float(np.mean(self.kinds))


@dataclass(frozen=True, repr=False)
class Selection(Shown):
    """Ranked rows, the chosen one, and its fit to all the data.

    The finalists are the smallest row that is equal to the best, the best, and the best rows of other structures. The
    chosen one of them has the least errors over parts of the same kind and of other kinds, see `choose_by_kind`.

    `notes` say what the search left out, and why: `left_out` candidates had no time in its `budget` [s]. `journal` is
    its file, from which it goes on.
    """

    rows: tuple[Row, ...]
    chosen: Row
    fit: Fit | NlarxFit
    notes: tuple[str, ...] = ()
    seconds: float = 0.0
    budget: float = SECONDS
    left_out: int = 0
    journal: Path | None = None

    @property
    def cut(self) -> str:
        """What a budget that ended early left out, in words; empty if it was enough."""
        return cut(self.budget, self.left_out)

    @property
    def best_of_each(self) -> tuple[Row, ...]:
        """The best row of every structure, best first."""
        best_rows: dict[str, Row] = {}
        for row in self.rows:
            best_rows.setdefault(row.candidate.name, row)
        return tuple(best_rows.values())

    def sentence(self) -> str:
        """The result in words."""
        equals = [r for r in self.rows if r.equal]
        best = self.rows[0]
        text = f"{best.candidate} has the best free run on unseen data ({best.fit_percent:.2f} %, d {best.d})"
        if len(equals) > 1:
            text += f"; {len(equals) - 1} other(s) do not differ from it significantly"
        chosen = self.chosen
        if chosen.candidate != best.candidate and chosen.equal:
            text += f", of which {chosen.candidate} is the smallest ({chosen.fit_percent:.2f} %, d {chosen.d})"
        return f"{text}. {self._over_kinds()}".strip()

    @property
    def rival(self) -> Row | None:
        """The best finalist of another structure than the chosen one's; None where there is none."""
        others = [r for r in self.rows if r.candidate.name != self.chosen.candidate.name and r.kinds is not None]
        return min(others, key=lambda r: r.score_of_kinds, default=None)

    def _over_kinds(self) -> str:
        """Why the chosen one was chosen of the finalists, and how sure that is; empty without a rival."""
        chosen, rival = self.chosen, self.rival
        if rival is None or chosen.kinds is None or not np.isfinite(chosen.score_of_kinds):
            return ""
        with np.errstate(over="ignore"):
            ratio = float(np.exp(0.5 * (chosen.score_of_kinds - rival.score_of_kinds)))
        sure = confidence(chosen, rival)
        text = (
            f"{chosen.candidate} is chosen: over parts of other levels, rates and ends too its errors are {ratio:.3g} "
            f"times those of {rival.candidate}, the best of another structure"
        )
        if ratio > 1.0:
            larger = rival.d > chosen.d
            reason = f"has more parameters (d {rival.d} for {chosen.d})" if larger else "was passed over, see the notes"
            return f"{text}, which {reason}."
        if sure < SURE:
            return f"{text}; this record does not tell the two apart (sure to {100.0 * sure:.0f} %)."
        return f"{text} (sure to {min(np.floor(1000.0 * sure) / 10.0, 99.9):g} %)."

    def as_dict(self) -> dict[str, Any]:
        """The ranked table, ready for JSON."""
        rows = [
            {
                **settings(r.candidate),
                "fit_percent": r.fit_percent,
                "d": r.d,
                "round": r.round,
                "equal": r.equal,
                "kinds": None if r.kinds is None else r.kinds.tolist(),
                "whole": r.whole,
                "why": r.why,
            }
            for r in self.rows
        ]
        chosen = settings(self.chosen.candidate)
        return json_value({"chosen": chosen, "sentence": self.sentence(), "notes": list(self.notes), "rows": rows})


def mean_log(errors: Any) -> float:
    """Mean logarithm of squared errors, infinite where one is not finite."""
    values = np.asarray(errors, dtype=float)
    return float(np.mean(np.log(np.maximum(values, 1e-300)))) if np.all(np.isfinite(values)) else np.inf


def confidence(row: Row, rival: Row) -> float:
    """Probability that a finalist's errors are smaller than those of another, by Student's t over the eight folds.

    All folds are of one record, and say less than independent ones: the variance of their mean is (1 / 8 + 1) times
    theirs, where as many samples are unseen as fitted (Nadeau and Bengio 2003, Machine Learning 52).
    """
    if row.kinds is None or rival.kinds is None or not np.isfinite(row.score_of_kinds):
        return 0.0
    if not np.isfinite(rival.score_of_kinds):
        return 1.0
    gap = rival.kinds - row.kinds
    spread = float(gap.std(ddof=1)) * np.sqrt(1.0 / len(gap) + 1.0)
    return float(stdtr(len(gap) - 1, float(gap.mean()) / max(spread, 1e-300)))


def choose_by_kind(finalists: Sequence[Row]) -> Row:
    """The finalist with the least errors over parts of the same kind and of other kinds, or a smaller one like it.

    A smaller one replaces it if its errors are at most `_SAME` times as large, or up to `_NEAR` times where the record
    does not tell the two apart.
    """
    best = min(finalists, key=lambda r: (r.score_of_kinds, r.d))
    alike = [best]
    for row in finalists:
        gap = row.score_of_kinds - best.score_of_kinds
        if gap <= np.log(_SAME) or (gap <= np.log(_NEAR) and confidence(best, row) < SURE):
            alike.append(row)
    return min(alike, key=lambda r: (*plainness(r), r.score_of_kinds))


def cut(budget: float, left_out: int) -> str:
    """That a `budget` [s] ended a search before so many of its candidates; empty if it left out none."""
    if not left_out:
        return ""
    return f"the budget of {budget:g} s ended the search before {left_out} of its candidates"


def settings(c: Recipe) -> dict[str, Any]:
    """A candidate in the form of tables and journals: orders 0 if it has none, None for a missing map."""
    orders = {**dict.fromkeys(("nb", "nf", "nk"), 0), **c.orders}
    maps = {"input": c.maps.get("input_map"), "output": c.maps.get("output_map")}
    options = type(c).options()
    other_settings = {name: value for name, value in c.as_dict().items() if options[name].kind != "map"}
    return {"structure": c.name, **orders, **maps, **other_settings}


def plainness(row: Row) -> tuple[int, bool]:
    """Of rows that a record does not tell apart the least is handed over: fewer parameters, then no oscillation."""
    return row.d, row.candidate.swings


def score(row: Row) -> tuple[bool, float, int]:
    """Rows in this order are best first; what was judged on a shortened record comes last."""
    return not row.whole or not np.isfinite(row.fit_percent), -row.fit_percent, row.d


def larger(errors: np.ndarray, others: np.ndarray) -> bool:
    """Whether mean squared errors (n,) of one model are larger than those of another on the same stretches, by more
    than chance explains (paired t-test on their logarithms at 95 %)."""
    gap = np.log(np.maximum(errors, 1e-300)) - np.log(np.maximum(others, 1e-300))
    limit = float(stdtrit(len(gap) - 1, 0.975))
    return float(gap.mean()) > limit * float(gap.std(ddof=1)) / np.sqrt(len(gap))


def ranked(judged: dict[Recipe, Row]) -> tuple[list[Row], Row]:
    """Rows sorted best first, with those equal to the best marked, and the smallest of these.

    Errors are compared by their logarithms; otherwise one bad segment, on which every model fails, would hide all
    differences. A loss up to `_SAME` times the best counts as equal even if the difference is significant. A loss
    above `_NEAR` times the best, or a fit more than `_POINTS` below it, is not equal even if it is not significant: a
    test on twenty segments that differ strongly has little power.
    """
    rows = sorted(judged.values(), key=score)
    out = []
    for k, r in enumerate(rows):
        finite = r.whole and bool(np.all(np.isfinite([r.errors, rows[0].errors])))
        told = not finite or larger(r.errors, rows[0].errors)
        ratio = float(r.errors.mean()) / max(float(rows[0].errors.mean()), 1e-300) if finite else np.inf
        percent_below = rows[0].fit_percent - r.fit_percent if finite else np.inf
        told = (told and ratio > _SAME) or ratio > _NEAR or percent_below > _POINTS
        out.append(replace(r, equal=k == 0 or not told))
    return out, min((r for r in out if r.equal), key=lambda r: (*plainness(r), -r.fit_percent))
