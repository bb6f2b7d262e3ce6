"""The part of `qpal demo` that a real record does not have: the truth beside the identified values."""

import shlex
from collections.abc import Mapping
from pathlib import Path

from sysid.base.quantities import capital, display_quantity, number, percent
from sysid.joint.values import distinct_values
from sysid.report import sections
from sysid.report.page import Grid, Section
from sysid.workflow.identification import Identification


def section(result: Identification, true: Mapping[str, float]) -> Section:
    """Identified values beside the truth."""
    text = "The log is that of the twin, a simulated leg, so the true values are known. The fit was not told them."
    return Section("Beside the truth", [text], [grid(result, true)])


def grid(result: Identification, true: Mapping[str, float]) -> Grid:
    """A row for each physical value: identified, its interval, the truth, and whether the interval holds it."""
    rows = []
    for value in distinct_values(result.evaluation.values):
        quantity = display_quantity(value.name, value.unit)
        cells = sections.value_cells(value)
        truth = number(true[value.name] * quantity.factor, 4)
        holds = ("yes" if value.holds(true[value.name]) else "no") if value.low is not None else "–"
        name = capital(sections.WORDS.get(value.name, value.name))
        rows.append((name, *cells[:2], truth, holds, cells[2]))
    headings = ("", "identified", "95 % interval", "truth", "interval holds it", "unit")
    return Grid(headings, rows, "Physical values of a simulated joint", last_text=True)


def sentences(result: Identification, log: Path) -> list[str]:
    """The fit in a sentence, what the record leaves open, and what to do with a log of one's own."""
    fit, file = percent(result.evaluation.judged_fit), shlex.quote(str(log))
    open_values = sections.undetermined_in_words(result.evaluation)
    return [
        f"The free run of the model fits the half of the log that it has not seen to {fit}.",
        *filter(None, [open_values.replace(" FILE", f" {file}")]),
        f"Next: qpal info {file} shows how a log is read; qpal identify reads one of yours.",
    ]
