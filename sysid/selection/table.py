"""The table of a structure search: one row a candidate, ranked, and the row that is handed over."""

from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from scipy.special import stdtrit

from sysid.base.files import json_value
from sysid.base.handlers import Shown
from sysid.estimation.result import Fit
from sysid.model.recipes import Recipe
from sysid.nlarx.result import NlarxFit

SECONDS = 110.0  # of a whole search
BLOCKS = 20  # stretches of the judged samples whose errors are compared pair by pair
_SAME, _NEAR = 1.01, 1.1  # times the loss of the best
_POINTS = 0.5  # of fit [%] within which a smaller candidate may replace the best


@dataclass(frozen=True)
class Row:
    """One candidate of the ranked table; `errors` (BLOCKS,) are mean squared free-run errors on unseen segments.

    `whole`: judged on the whole record, not on a shortened one. `why`: the reason why it could not be fitted or ended
    early. `thetas` are the parameters of the fits of both folds. `equal`: its errors do not differ significantly from
    the best candidate's (paired t-test on their logarithms at 95 %; `ranked` has the tolerances).
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


@dataclass(frozen=True, repr=False)
class Selection(Shown):
    """Ranked rows, the chosen one (the smallest of those equal to the best), and its fit to all the data.

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
        if self.chosen.candidate != best.candidate:
            small = self.chosen
            text += f", of which {small.candidate} is the smallest ({small.fit_percent:.2f} %, d {small.d})"
        return text + "."

    def as_dict(self) -> dict[str, Any]:
        """The ranked table, ready for JSON."""
        rows = [
            {
                **settings(r.candidate),
                "fit_percent": r.fit_percent,
                "d": r.d,
                "round": r.round,
                "equal": r.equal,
                "whole": r.whole,
                "why": r.why,
            }
            for r in self.rows
        ]
        chosen = settings(self.chosen.candidate)
        return json_value({"chosen": chosen, "sentence": self.sentence(), "notes": list(self.notes), "rows": rows})


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


def score(row: Row) -> tuple[bool, float, int]:
    """Rows in this order are best first; what was judged on a shortened record comes last."""
    return not row.whole or not np.isfinite(row.fit_percent), -row.fit_percent, row.d


def ranked(judged: dict[Recipe, Row]) -> tuple[list[Row], Row]:
    """Rows sorted best first, with those equal to the best marked, and the smallest of these.

    Errors are compared by their logarithms; otherwise one bad segment, on which every model fails, would hide all
    differences. A loss up to `_SAME` times the best counts as equal even if the difference is significant. A loss
    above `_NEAR` times the best, or a fit more than `_POINTS` below it, is not equal even if it is not significant: a
    test on twenty segments that differ strongly has little power.
    """
    rows = sorted(judged.values(), key=score)
    limit = float(stdtrit(BLOCKS - 1, 0.975))
    best = np.log(np.maximum(rows[0].errors, 1e-300))
    out = []
    for k, r in enumerate(rows):
        with np.errstate(invalid="ignore"):
            gap = np.log(np.maximum(r.errors, 1e-300)) - best
        finite = r.whole and bool(np.all(np.isfinite(gap)))
        told = not finite or float(gap.mean()) > limit * float(gap.std(ddof=1)) / np.sqrt(BLOCKS)
        ratio = float(r.errors.mean()) / max(float(rows[0].errors.mean()), 1e-300) if finite else np.inf
        percent_below = rows[0].fit_percent - r.fit_percent if finite else np.inf
        told = (told and ratio > _SAME) or ratio > _NEAR or percent_below > _POINTS
        out.append(replace(r, equal=k == 0 or not told))
    return out, min((r for r in out if r.equal), key=lambda r: (r.d, -r.fit_percent))
