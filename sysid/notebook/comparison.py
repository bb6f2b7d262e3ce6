"""A comparison of fits at a prompt and in a notebook."""

from __future__ import annotations

from typing import TYPE_CHECKING

from sysid.base.card import Card, Table
from sysid.base.quantities import display_quantity, number, percent
from sysid.notebook.figures import figure
from sysid.plots.comparison import comparison
from sysid.validation.compare import Comparison

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def line(table: Comparison) -> str:
    """The best model."""
    best = table.rows[0]
    return f"<Comparison: {len(table.rows)} models on {table.scored} samples; best {best.label}, {percent(best.fit)}>"


def card(table: Comparison) -> Card:
    """The ranking."""
    q = display_quantity("RMSE", table.y_unit)
    rows = [
        (
            str(r.rank),
            r.label,
            "converged" if r.converged else "not converged",
            percent(r.fit),
            number(r.rmse * q.factor),
            "–" if r.one_step is None else percent(r.one_step),
            str(r.criteria.d),
            number(r.criteria.aicc, 6),
            number(r.criteria.bic, 6),
        )
        for r in table.rows
    ]
    headings = ("", "model", "search", "free run", q.label, "one step ahead", "d", "AICc", "BIC")
    facts = [("scored", f"{table.scored} samples; the first {table.n_init} of each experiment give the initial state")]
    if table.numbered:
        facts.append(("model", table.numbered))
    return Card("Comparison", facts, [Table(headings, rows, text_columns=3, most=20)], call="Next: comparison.plot()")


def plot(table: Comparison) -> Figure:
    """The free-run fits as bars."""
    say = "What to see: the longest bar has the best free run; of models that are equally good, prefer the smallest d."
    return figure(comparison, table, say=say)
