"""The page of `qpal bench certify`: tables of digits, a figure of them, and the rules with what breaks them."""

import shlex
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from sysid.base import style
from sysid.base.files import versions, write_text
from sysid.bench.certificate.digits import MOST
from sysid.bench.certificate.grade import LEAST, Grade
from sysid.bench.certificate.record import Record
from sysid.bench.certificate.static import LEVELS, StaticGrade
from sysid.drawing.figure import Axis, Bars, Figure, Panel, Rule
from sysid.report.answer import GOOD, POOR, Answer, Word
from sysid.report.page import Grid, Page, Picture, Section, write

NONE = "–"
TABLES = "tables.md"  # those of the terminal, in Markdown
COLOURS = (style.MODEL, style.SECOND, style.INPUT, style.BOUND)


def dynamic_grid(rows: Sequence[Grade]) -> Grid:
    """A row for each method and difficulty: how many, the fewest and the median digits, and how many are enough."""
    cells = []
    for method in _methods(rows):
        for level in LEVELS:
            part = [row for row in rows if row.method == method and row.level == level]
            if part:
                cells.append([method, level, str(len(part)), *_columns(part)])
    return Grid(["method", "difficulty", "fits", *HEADINGS], cells, "Dynamic reference records", 2)


HEADINGS = ("parameters, fewest digits", "median", f"with {LEAST:g} or more", "deviations, median", "rss, median")


def _columns(part: Sequence[Any]) -> list[str]:
    values = [row.parameters for row in part if row.parameters is not None]
    enough = str(sum(value >= LEAST for value in values)) if values else NONE
    medians = [_median([getattr(r, key) for r in part if getattr(r, key) is not None]) for key in ("deviations", "rss")]
    return [_text(min(values, default=None)), _median(values), enough, *medians]


def _median(values: Sequence[float]) -> str:
    return _text(sorted(values)[(len(values) - 1) // 2] if values else None)


def _text(value: float | None) -> str:
    return NONE if value is None else f"{value + 0.0:.1f}"


def static_grid(rows: Sequence[StaticGrade]) -> Grid:
    """The same for NIST's sets, a row for each difficulty and start."""
    cells = []
    for level in LEVELS:
        for start in (1, 2):
            part = [row for row in rows if row.level == level and row.start == start]
            if part:
                cells.append([level, f"start {start}", str(len(part)), *_columns(part)])
    return Grid(["difficulty", "start", "sets", *HEADINGS], cells, "NIST StRD, nonlinear regression", 2)


def every(rows: Sequence[Grade]) -> Grid:
    """A row for each record, method and start."""
    cells = [
        [r.record, r.level, r.method, str(r.start), _text(r.parameters), _text(r.deviations), _text(r.rss), r.status]
        for r in rows
    ]
    headings = ["record", "difficulty", "method", "start", "parameters", "deviations", "rss", "status"]
    return Grid(headings, cells, "Every record", 3, last_text=True, sortable=True)


def every_set(rows: Sequence[StaticGrade]) -> Grid:
    """A row for each of NIST's sets and starts."""
    cells = [
        [
            s.name,
            s.level,
            str(s.start),
            _text(s.parameters),
            _text(s.deviations),
            _text(s.rss),
            str(s.iterations),
            s.stop,
        ]
        for s in rows
    ]
    headings = ["set", "difficulty", "start", "parameters", "deviations", "rss", "steps", "end of the search"]
    return Grid(headings, cells, "Every set", 2, last_text=True, sortable=True)


def figure(names: Sequence[str], series: Sequence[str], digits: dict[tuple[str, str], float]) -> Figure:
    """Bars of digits by name, a colour each of `series`."""
    width = 0.8 / len(series)
    bars = [
        Bars(
            [digits[name, label] for name in names],
            label,
            (COLOURS[k % len(COLOURS)],),
            width=width,
            shift=(k - (len(series) - 1) / 2) * width,
        )
        for k, label in enumerate(series)
    ]
    axis = Axis("digits", limits=(0.0, MOST + 0.5), ticks=range(0, 12, 2))
    panel = Panel([*bars, Rule(LEAST, label=f"{LEAST:g} digits")], Axis(names=names), axis)
    height = 1.1 + (0.14 + 0.08 * len(series)) * len(names)
    return Figure([panel], shared=False, height=height, legend="above")


def _pictures(kind: str, levels: dict[str, str], series: Sequence[str], digits: dict, caption: str) -> list[Picture]:
    """A picture for each difficulty that has names."""
    by_level = {level: sorted(name for name in levels if levels[name] == level) for level in LEVELS}
    return [
        Picture.of(
            f"{kind}-{level}", figure(names, series, digits), f"{level.capitalize()} difficulty: {caption}", False
        )
        for level, names in by_level.items()
        if names
    ]


def _of_records(rows: Sequence[Grade]) -> list[Picture]:
    worst: dict[tuple[str, str], float] = {}
    for row in rows:
        value = row.rss if row.parameters is None else row.parameters
        worst[row.record, row.method] = min(value, worst.get((row.record, row.method), MOST))
    caption = (
        "digits of the worst parameter from the worse of two starts, of rss where a method does not tell parameters; "
        "no bar is no digit."
    )
    return _pictures("records", {row.record: row.level for row in rows}, _methods(rows), worst, caption)


def _of_sets(rows: Sequence[StaticGrade]) -> list[Picture]:
    starts = {(s.name, f"start {s.start}"): s.parameters for s in rows}
    return _pictures(
        "sets",
        {s.name: s.level for s in rows},
        ["start 1", "start 2"],
        starts,
        "digits of the worst parameter; no bar is no digit.",
    )


def _methods(rows: Sequence[Grade]) -> list[str]:
    return list(dict.fromkeys(row.method for row in rows))


def rules(is_judged: bool, violations: Sequence[Any] = ()) -> str:
    """The rule in words, and whether it holds."""
    text = f"stated and the solver give {LEAST:g} digits of every parameter at lower difficulty, from both starts"
    holds = "It DOES NOT HOLD." if violations else "It holds."
    return f"Rule: {text}. {holds}" if is_judged else "No rule: methods of others are graded, not judged."


def answer(rows: Sequence[Grade], violations: Sequence[str], is_judged: bool, texts: Mapping[str, str]) -> Answer:
    """The first screen: how many fits give the digits that the rule asks for, and whether it holds.

    Methods of others are graded and not judged, so they have no word. `texts` name a method as a command has it.
    """
    method = rows[0].method  # that is judged, or was named first
    rows_of_first = [row for row in rows if row.method == method]
    told = [row.parameters for row in rows_of_first if row.parameters is not None]
    digits, of = (told, "every parameter") if told else ([row.rss for row in rows_of_first], "the sum of squares alone")
    word: Word | None = (POOR if violations else GOOD) if is_judged else None
    worst = min(rows_of_first, key=lambda row: (row.rss if row.parameters is None else row.parameters, row.record))
    again = shlex.join(["qpal", "bench", "certify", texts.get(worst.method, worst.method), "--record", worst.record])
    return Answer(
        f"{sum(value >= LEAST for value in digits)} of {len(digits)}",
        f"fits of certified records by {method} give {LEAST:g} digits of {of}",
        word,
        rules(is_judged, violations),
        next(iter(_of_records(rows)), None),
        values=dynamic_grid(rows).only("method", "difficulty", "fits", HEADINGS[0], HEADINGS[2]),
        next=f"Next, the record with the fewest digits alone: {again}",
    )


def write_page(
    folder: Path,
    rows: Sequence[Grade],
    static: Sequence[StaticGrade],
    table: dict[str, Record],
    violations: Sequence[str],
    is_judged: bool,
    texts: Mapping[str, str],
) -> tuple[dict[str, Any], Answer]:
    """Write report.html, summary.json, tables.md and figures/; returns the summary and the first screen."""
    proved = sum(table[name].is_global for name in table)
    verdict = [rules(is_judged, violations), *violations]
    sections = [
        Section(
            "Dynamic reference records",
            [
                f"{len(table)} records; each has one stationary point in a box, by proof, and {proved} of them have a "
                "proof that it is the lowest of a whole domain. Digits are -log10 of the relative error, 11 at most. A "
                "method that does not tell its parameters is graded by the sum of squares of its free run alone."
            ],
            tables=[dynamic_grid(rows)],
            pictures=_of_records(rows)[1:],
            details=[every(rows)],
        )
    ]
    if static:
        sections.append(
            Section(
                "NIST StRD, nonlinear regression",
                ["The solver of sysid.fit on functions in place of chains, one search from each published start."],
                tables=[static_grid(static)],
                pictures=_of_sets(static),
                details=[every_set(static)],
            )
        )
    summary = {
        "records": len(table),
        "global": proved,
        "judged": is_judged,
        "violations": list(violations),
        "dynamic": [asdict(row) for row in rows],
        "static": [asdict(row) for row in static],
        "versions": versions(),
    }
    size = f"{len(rows)} fits, {len(static)} regressions"
    first = answer(rows, violations, is_judged, texts)
    page = Page("Digits of certified values", size, verdict, sections, versions(), answer=first)
    write(folder, page, summary)
    write_text(folder / TABLES, "\n".join(grid.markdown() for section in sections for grid in section.tables))
    return summary, first
