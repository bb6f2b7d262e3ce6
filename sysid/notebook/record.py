"""IOData at a prompt and in a notebook."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from sysid.base.card import Card, Table
from sysid.base.quantities import display_quantity, number
from sysid.data.record import IOData
from sysid.notebook.figures import figure
from sysid.plots.records import record

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_NOTHING = 1e-12  # of the largest value: what rounding leaves of a mean that was removed


def line(data: IOData) -> str:
    """Size, rate and channels."""
    several = f" in {len(data.lengths)} experiments" if len(data.lengths) > 1 else ""
    return f"<IOData: {data.N} samples{several} every {data.Ts:g} s, {_channels(data, 'u')} to {_channels(data, 'y')}>"


def card(data: IOData) -> Card:
    """The same with the range of every channel."""
    facts = [
        ("samples", f"{data.N} every {data.Ts:g} s, {data.N * data.Ts:g} s in all"),
    ]
    if len(data.lengths) > 1:
        shown_lengths = ", ".join(map(str, data.lengths[:8])) + (", ..." if len(data.lengths) > 8 else "")
        facts.append(("experiments", f"{len(data.lengths)}, of {shown_lengths} samples"))
    lost = int((~data.observed).sum())
    if lost:
        facts.append(("missing", f"{lost} output samples, {100 * lost / data.y.size:.2g} %"))
    rows: list[tuple[str, ...]] = []
    for which, values, offsets in (("u", data.u, data.u_offset), ("y", data.y, data.y_offset)):
        name, unit = (data.u_name, data.u_unit) if which == "u" else (data.y_name, data.y_unit)
        for k in range(values.shape[1]):
            q, own = display_quantity(name, unit), name if values.shape[1] == 1 else f"{name}{k + 1}"
            x = values[:, k] * q.factor
            size = float(np.abs(x).max())
            found = (x.min(), x.max(), x.mean(), x.std(), offsets[k] * q.factor)
            cells = (number(float(v) if abs(v) > _NOTHING * size else 0.0) for v in found)
            rows.append((own, "input" if which == "u" else "output", q.unit or "–", *cells))
    headings: tuple[str, ...] = ("channel", "", "unit", "least", "largest", "mean", "std", "removed")
    if not np.any(data.u_offset) and not np.any(data.y_offset):
        headings, rows = headings[:-1], [row[:-1] for row in rows]
    calls = "data.plot(), data.between(start, stop), sysid.advise(data), sysid.fit(model, data)"
    return Card("Record", facts, [Table(headings, rows, text_columns=3)], call=f"Next: {calls}")


def plot(data: IOData) -> Figure:
    """Every channel over time."""
    say = "What to see: the input should move at the speeds and over the levels that matter, and the output answer it."
    return figure(record, data, say=say)


def _channels(data: IOData, which: str) -> str:
    name, unit, n = (data.u_name, data.u_unit, data.u.shape[1])
    if which == "y":
        name, unit, n = (data.y_name, data.y_unit, data.y.shape[1])
    return f"{f'{n} x ' if n > 1 else ''}{name}{f' [{unit}]' if unit else ''}"
