"""The growth of a joint at a prompt and in a notebook."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from sysid.base.card import Card, Table
from sysid.base.errors import InputError
from sysid.base.quantities import number, percent
from sysid.joint.growth import MARGIN, WORDS, Growth
from sysid.notebook import fit as of_fit
from sysid.notebook.figures import figure
from sysid.plots.earned import earned
from sysid.report.joint import bars, hatched

if TYPE_CHECKING:
    from matplotlib.figure import Figure

SAY = (
    "What to see: a part is kept if BIC falls beyond the dashed line and its free runs over unseen parts of the record "
    "get no worse; the filled bar of a round is the part that stayed."
)


def line(growth: Growth) -> str:
    """The parts, and the fit."""
    parts = ", ".join(growth.parts) or "no further part"
    return f"<Growth: {parts}; {of_fit.line(growth.fit).strip('<>')}>"


def card(growth: Growth) -> Card:
    """The steps on one screen."""
    fit = growth.fit
    score = of_fit.own_percent(fit)
    facts = [] if score is None else [("fit, free run", f"{percent(score)} on its own record")]
    if math.isfinite(growth.unseen_percent):
        facts.append(("on unseen parts", percent(growth.unseen_percent)))
    facts += [
        ("BIC", f"{number(fit.criteria.bic, 6)}, of the plain joint {number(growth.plain_bic, 6)}"),
        ("starts that agree", str(growth.agreed)),
        ("search", f"{fit.stop.reason}"),
    ]
    rows = [
        (str(s.round + 1), WORDS[s.part], number(s.bic, 6), number(s.earned, 4), "kept" if s.kept else "–")
        for s in growth.steps
    ]
    table = Table(("round", "part", "BIC", "fall", ""), rows, "Parts tried", text_columns=2)
    sentences = [growth.sentence(), *(f"Warning: {text}." for text in growth.warnings[:3])]
    calls = "growth.plot(), growth.fit, sysid.joint_values(growth.fit)"
    folded = [of_fit.parameter_table(fit)]
    return Card("Actuated joint", facts, [table] if rows else [], sentences, folded, call=f"Next: {calls}")


def plot(growth: Growth) -> Figure:
    """The parts tried, round by round."""
    if not growth.steps:
        raise InputError("no part was tried in this growth, so there is nothing to draw; see growth.fit.plot()")
    return figure(earned, bars(growth), MARGIN, say=SAY + hatched(growth))
