"""A structure search at a prompt and in a notebook."""

from sysid.base.card import Card, Table
from sysid.base.quantities import percent
from sysid.selection.table import Selection

ROWS = 12


def line(found: Selection) -> str:
    """The chosen candidate."""
    row = found.chosen
    fit = percent(row.fit_percent)
    return f"<Selection: {row.candidate}, {fit} on unseen data, d {row.d}; {len(found.rows)} candidates>"


def card(found: Selection) -> Card:
    """The best candidates on one screen."""
    rows = []
    for k, row in enumerate(found.rows, 1):
        c = row.candidate
        maps = " / ".join(name.replace("_", " ") for name in c.maps.values()) or "–"
        mark = "chosen" if c == found.chosen.candidate else "equal" if row.equal else row.why.partition(";")[0]
        rows.append((str(k), c.short, maps, mark, percent(row.fit_percent), str(row.d)))
    table = Table(("", "structure", "maps", "", "fit on unseen data", "d"), rows, "", text_columns=4, most=ROWS)
    notes = [f"{note[0].upper()}{note[1:]}." for note in found.notes]
    facts = [("search", f"{found.seconds:.0f} s, {len(found.rows)} candidates")]
    folded = [Table(table.headings, rows, f"All {len(rows)} candidates", text_columns=4)]
    calls = "selection.fit, selection.fit.plot(), selection.rows"
    return Card("Structure search", facts, [table], [found.sentence(), *notes], folded, call=f"Next: {calls}")
