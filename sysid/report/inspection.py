"""The report of `qpal info FILE`: columns, mapping, sampling, repairs, advice, and two figures of the record."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from sysid.base import style
from sysid.base.errors import readable
from sysid.base.files import versions
from sysid.base.quantities import capital, display_quantity
from sysid.channels.signals import Signal as RecordedSignal
from sysid.channels.signals import Signals
from sysid.drawing.figure import Axis, Figure, Histogram, Item, Panel, Rule
from sysid.plots.records import Signal, stack_figure
from sysid.report.inspection_answer import answer
from sysid.report.page import Grid, Listing, Page, Picture, Section
from sysid.workflow.inspection import Inspection, sampling_facts

MOST_PANELS = 6
BINS = 60
COLOURS = {"input": style.INPUT, "output": style.INK}
REPAIRS = {
    "wraps": "times that the clock's counter started again",
    "duplicates": "rows with the stamp of the row before",
    "backward": "rows left out because their stamp runs back",
    "stamps without a value": "rows left out because they have no stamp",
    "lost": "samples lost between rows",
    "ends": "rows without values left out at the ends",
    "empty cells": "cells without a value",
    "interpolated": "samples interpolated because the stamps are not uniform",
    "filled samples": "samples of the record that were filled",
}


def page(result: Inspection, more: Sequence[str] = ()) -> Page:
    """The whole report; `more` are further sentences of the verdict."""
    s = result.signals
    channels, *steps = pictures(s) if s is not None else (None,)
    size = f"{s.N} samples, Ts {s.Ts:g} s" if s is not None else "not read as a record"
    return Page(
        title=f"What {result.path.name} holds",
        subtitle=f"{len(result.columns)} columns, format {result.format}; {size}",
        verdict=[*sentences(result), *more],
        sections=[
            Section("Columns", [_capital(note) for note in result.reader_notes], [column_grid(result)]),
            Section(
                "Mapping",
                ["How the columns become channels. Save it as a file, edit it, and give it with --map."],
                listings=[Listing("The mapping as TOML", readable(result.text))],
            ),
            *([] if s is None else [Section("Record", tables=[sampling_grid(s)], pictures=steps)]),
            *([Section("Advice", ["The diagnosis of the record."], [advice_grid(result)])] if result.advice else []),
        ],
        made_with=versions(),
        answer=answer(result, channels),
    )


def sentences(result: Inspection) -> list[str]:
    """What was assumed and repaired, what is unclear, warnings, and why nothing can be identified."""
    lines = [
        _capital(note) for note in (result.signals.notes if result.signals else (*result.reader_notes, *result.why))
    ]
    lines += [f"Unclear: {_capital(sentence)}" for sentence in result.unclear]
    if result.problem:
        lines.append(f"Refused as it is: {result.problem}.")
    if result.repairs:
        lines.append(f"The mapping repairs this: it sets {' and '.join(result.repairs)} in [repair].")
    lines += [f"Warning: {advice}." for advice in result.advice if advice.severity == "warning"]
    if result.obstacle and not result.command:
        lines.append(f"Nothing can be identified from this record as it is: {result.obstacle.rstrip('.')}.")
    return lines


def column_grid(result: Inspection) -> Grid:
    """Name, unit, role and numbers of every column."""
    rows = [
        (c.name, c.unit or "–", c.role or "–", c.kind, _plain(c.low), _plain(c.high), str(c.cells), str(c.empty))
        for c in result.columns
    ]
    headings = ("column", "unit", "read as", "", "smallest", "largest", "cells", "no number")
    return Grid(headings, rows, text_columns=4)


def sampling_grid(signals: Signals) -> Grid:
    """The stamps, the record and the counts of repairs."""
    facts = sampling_facts(signals)
    rows = [("sampling time of the record [s]", f"{facts['Ts']:.6g}"), ("samples", str(facts["samples"]))]
    rows.append(("length [s]", f"{facts['duration']:.6g}"))
    if facts["median_step"] is not None:
        rows += [
            ("middle step of the stamps [s]", f"{facts['median_step']:.6g}"),
            ("smallest and largest step [s]", f"{facts['smallest_step']:.6g}, {facts['largest_step']:.6g}"),
            ("largest distance of a stamp from the grid [s]", f"{facts['largest_distance_from_grid']:.2g}"),
            ("first stamp [s]", f"{facts['first_stamp']:.9g}"),
        ]
    rows += [(REPAIRS.get(name, name), str(n)) for name, n in signals.counts.items()]
    return Grid(("sampling and repairs", ""), rows)


def advice_grid(result: Inspection) -> Grid:
    """The advice, warnings first; what is fine is left out."""
    rank = {"warning": 0, "note": 1, "fine": 2}
    advice = sorted(result.advice, key=lambda a: rank[a.severity])
    rows = [(a.severity, a.topic, a.sentence.replace("^2", "²"), a.action or "–") for a in advice]
    return Grid(("", "topic", "finding", "what to do"), rows, text_columns=4)


def terminal_tables(result: Inspection) -> list[Grid]:
    """The tables that the command prints."""
    return [column_grid(result), *([sampling_grid(result.signals)] if result.signals is not None else [])]


def pictures(signals: Signals) -> list[Picture]:
    """The channels over time, and the histogram of the steps if there is a clock."""
    count = int(signals.missing.sum())
    caption = "The channels as they are used, in SI (angles in degrees)."
    caption += f" Marked: {count} samples that were filled." if count else ""
    shown_pictures = [Picture.of("channels", channels_figure(signals), caption)]
    if len(signals.sampling.steps):
        words = "How often each step between time stamps occurs; the dashed line is the sampling time of the record."
        shown_pictures.append(Picture.of("steps", steps_figure(signals), words))
    return shown_pictures


def _panel_signals(signals: Signals) -> list[tuple[str, RecordedSignal]]:
    """The channels that are shown, with their roles."""
    return [(role, s) for role in ("input", "output", "other") for s in getattr(signals, role)][:MOST_PANELS]


def channels_figure(signals: Signals) -> Figure:
    """Every input and output over time, with filled samples marked."""
    shown_signals = [
        Signal(display_quantity(s.name, s.unit), s.values, role, COLOURS.get(role, style.SECOND), role == "input")
        for role, s in _panel_signals(signals)
    ]
    return stack_figure(signals.t, shown_signals, signals.missing)


def steps_figure(signals: Signals) -> Figure:
    """Histogram of the steps between stamps."""
    ms = 1e3 * signals.sampling.steps
    middle, Ts = float(np.median(ms)), 1e3 * signals.Ts
    if np.ptp(ms) <= 1e-6 * middle:
        ms, low, high = np.full(len(ms), middle), 0.5 * middle, 1.5 * middle
    else:
        low, high = float(ms.min()), float(ms.max())
    width = (high - low) / BINS
    # The sampling time is the middle of a bin, so that its line stands on its bar.
    least, largest = np.floor((low - Ts) / width + 0.5), np.floor((high - Ts) / width + 0.5)
    edges = Ts + width * (np.arange(least, largest + 2) - 0.5)
    counts, _ = np.histogram(ms, edges)
    items: list[Item] = [Histogram(edges, counts, style.INPUT), Rule(Ts, dash="dash", colour=style.MODEL, width=1.0)]
    y = Axis("steps [number]", "steps", log=True)
    return Figure([Panel(items, y, Axis("step between time stamps [ms]"))], shared=False)


def _plain(value: float) -> str:
    return "–" if np.isnan(value) else f"{value:.5g}".replace("-", "−")


def _capital(sentence: str) -> str:
    return f"{capital(sentence.rstrip('.'))}." if sentence else ""
