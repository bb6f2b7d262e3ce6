"""The part of `qpal demo` that a real record does not have: the truth beside the identified values."""

import shlex
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

from sysid.base.quantities import capital, display_quantity, number
from sysid.joint.values import distinct_values
from sysid.report import sections as sections_of
from sysid.report.page import Grid, Page, Section
from sysid.workflow.identification import Identification


def page(page: Page, result: Identification, true: Mapping[str, float], log: Path) -> Page:
    """The report of the fit, with the truth beside the values of its first screen."""
    assert page.answer is not None
    file = shlex.quote(str(log))
    first = replace(page.answer, values=grid(result, true), next=f"Next: qpal info {file} shows how a log is read")
    text = "The log is that of the twin, a simulated leg, so the true values are known. The fit was not told them."
    sections = [Section("Beside the truth", [text], [grid(result, true)]), *page.sections]
    return replace(page, title="A simulated joint, identified beside its truth", answer=first, sections=sections)


def grid(result: Identification, true: Mapping[str, float]) -> Grid:
    """A row for each physical value: identified, its interval, the truth, and whether the interval holds it."""
    rows = []
    for value in distinct_values(result.evaluation.values):
        quantity = display_quantity(value.name, value.unit)
        cells = sections_of.value_cells(value)
        truth = number(true[value.name] * quantity.factor, 4)
        holds = ("yes" if value.holds(true[value.name]) else "no") if value.low is not None else "–"
        name = capital(sections_of.WORDS.get(value.name, value.name))
        rows.append((name, *cells[:2], truth, holds, cells[2]))
    headings = ("", "identified", "95 % interval", "truth", "interval holds it", "unit")
    return Grid(headings, rows, "Physical values of a simulated joint", last_text=True)


def open_values(result: Identification, log: Path) -> list[str]:
    """What the record leaves open, in words."""
    words = sections_of.undetermined_in_words(result.evaluation)
    return [words.replace(" FILE", f" {shlex.quote(str(log))}")] if words else []
