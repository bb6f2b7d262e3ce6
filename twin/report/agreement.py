"""Whether the logs of a calibration agree: in words, as a table, and as a forest plot of values by log."""

import shlex

import numpy as np

from sysid.base import style
from sysid.base.quantities import display_quantity, number
from sysid.drawing.figure import Axis, Figure, Item, Panel, Ranges, Rule
from sysid.report.page import Grid, Picture, Section
from twin.calibrate.agreement import Agreement
from twin.calibrate.result import Calibration, Value
from twin.follow import VISIBLE

_CAPTION = (
    "In each panel this value alone differs between the logs, with 95 % intervals; the line is the value of all logs. "
    "The panel that explains the differences best comes first. Logs of one leg scatter about the line by no more than "
    "their intervals. A log without a mark does not tell the value."
)
_BY_LOG = "Parameters with a value of their own in each log, with 95 % intervals; the file has their mean."


def section(result: Calibration) -> list[Section]:
    """The section on the agreement of the logs; none for a single log."""
    if not result.agreements:
        return []
    tables = [grid(result), *([by_log(result)] if result.by_run else [])]
    pictures = [Picture.of("agreement", figure(result), _CAPTION)]
    return [Section("Do the logs agree", sentences(result), tables=tables, pictures=pictures)]


def sentences(result: Calibration) -> list[str]:
    """Whether the logs agree; if not, which value differs, where, and what to do."""
    if not result.agreements:
        return []
    logs = result.provenance["logs"]
    if not result.differing:
        return [
            f"The {len(logs)} logs agree: none of the {len(result.agreements)} values that they share differs between "
            f"them by more than chance and {np.degrees(VISIBLE):g} deg RMS of the angle."
        ]
    first, *rest = result.differing
    texts = [_of_difference(first, logs)]
    if rest:
        texts.append(f"Differences in {', '.join(row.name for row in rest)} would explain it less well.")
    daily = ",".join(row.rpartition(".")[2] for row in (*result.by_run, first.name))
    command = f"qpal calibrate {shlex.join(logs)} --joint {result.joint} --by-run {daily}"
    return [*texts, f"Next: {command} gives each log its own."]


def _of_difference(row: Agreement, logs: list[str]) -> str:
    """How a value differs between logs."""
    q = display_quantity(row.name, row.unit)
    listing = ", ".join(
        f"{number(q.factor * float(value), 4)} in {log}"
        for value, told, log in zip(row.values, row.told, logs, strict=True)
        if told
    )
    text = f"The logs do not agree: {row.name}{f' [{q.unit}]' if q.unit else ''} is {listing} ({_chance(row.chance)})."
    if row.odd is None:
        return text
    rest = "without it the others agree" if row.rest_agrees else "the others do not agree either"
    return f"{text} {logs[row.odd]} is farthest from the others; {rest}."


def _chance(chance: float) -> str:
    return "probability by chance " + ("below 0.0001" if chance < 1e-4 else number(chance, 2))


def grid(result: Calibration) -> Grid:
    """The values that the logs share, log by log, and the probability of their differences."""
    rows = []
    for row in result.agreements:
        q = display_quantity(row.name, row.unit)
        values = [number(q.factor * row.value, 4)]
        values += [
            number(q.factor * float(v) if told else None, 4) for v, told in zip(row.values, row.told, strict=True)
        ]
        rows.append((row.name, q.unit or "–", *values, number(row.chance, 2), "yes" if row.differ else "no"))
    headings = ("parameter", "unit", "all", *result.provenance["logs"], "chance", "differ")
    return Grid(headings, rows, text_columns=2, last_text=True)


def by_log(result: Calibration) -> Grid:
    """The values of parameters that every log has of its own."""
    rows = []
    for name, values in result.by_run.items():
        q = display_quantity(name, values[0].unit)
        rows.append((name, q.unit or "–", *(_cell(value, q.factor) for value in values)))
    return Grid(("parameter", "unit", *result.provenance["logs"]), rows, _BY_LOG, text_columns=2, last_text=True)


def _cell(value: Value, factor: float) -> str:
    found = number(factor * value.value, 4)
    if value.low == value.high:
        return f"{found} (reference)"
    return f"{found} ({number(factor * value.low, 4)} to {number(factor * value.high, 4)})"


def figure(result: Calibration) -> Figure:
    """One panel for each shared value: the logs' own values with intervals about the common one."""
    logs = result.provenance["logs"]
    panels = [_panel(row, logs) for row in sorted(result.agreements, key=lambda row: -row.squares)]
    rows = -(-len(panels) // 2)
    return Figure(panels, columns=2, shared=False, height=0.8 + rows * (1.1 + 0.22 * len(logs)), legend="below")


def _panel(row: Agreement, logs: list[str]) -> Panel:
    q = display_quantity(row.name, row.unit)
    value, low, high = (q.factor * row.values, q.factor * row.low, q.factor * row.high)
    items: list[Item] = [Rule(q.factor * row.value, dash="dash", label="all logs")]
    for odd, colour, label in ((False, style.INPUT, "one log, 95 % interval"), (True, style.MODEL, "odd log")):
        places = [k for k in range(len(logs)) if row.told[k] and (k == row.odd) == odd]
        if places:
            ends = low[places].tolist(), high[places].tolist()
            items.append(Ranges(places, value[places].tolist(), *ends, label, colour=colour))
    title = f"{row.name}: differs" if row.differ else row.name
    return Panel(items, Axis(names=logs), Axis(f"{row.name.rpartition('.')[2]} [{q.unit or 1}]"), title)
