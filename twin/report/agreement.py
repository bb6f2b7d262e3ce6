"""Whether the logs of a calibration agree: in words, as a table, and as a forest plot of values by log."""

import numpy as np

from sysid.base import style
from sysid.base.quantities import display_quantity, estimate, number
from sysid.drawing.figure import Axis, Figure, Item, Panel, Ranges, Rule
from sysid.report.page import Grid, Picture, Section
from twin.calibrate import advice
from twin.calibrate.agreement import Agreement
from twin.calibrate.result import Calibration, Value
from twin.follow import VISIBLE

_LEAST = 1e-4  # a smaller probability is not told
_CAPTION = (
    "In each panel this value alone differs between the logs, with 95 % intervals; the line is the value of all logs. "
    "The panel that explains the differences best comes first; where a value differs, the others were searched again "
    "beside it, so that the line may lie apart. Logs of one leg scatter about the line within their intervals. "
    "A log without a mark does not tell the value."
)
_BY_LOG = (
    "Parameters with a value of their own in each log, with 95 % intervals. The joint's file has the mean over the "
    "logs that agree (over all, if no more than half agree); a file for each log has its own."
)


def section(result: Calibration) -> list[Section]:
    """The section on the agreement of the logs; none for a single log."""
    if not result.agreements:
        return []
    tables = [grid(result), *([by_log(result)] if result.by_run else [])]
    is_told = any(np.any(row.told) for row in result.agreements)
    pictures = [Picture.of("agreement", figure(result), _CAPTION)] if is_told else []
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
    names = {True: [row.name for row in rest if row.rival], False: [row.name for row in rest if not row.rival]}
    if names[True]:
        texts.append(
            f"Differences in {' or '.join(names[True])} explain it about as well: these logs do not show which."
        )
    if names[False]:
        texts.append(f"Differences in {', '.join(names[False])} explain it less well.")
    return [*texts, f"Next, a value for each log: {advice.again(result, by_run=[first.name])}"]


def _of_difference(row: Agreement, logs: list[str]) -> str:
    """How a value differs between logs."""
    q = display_quantity(row.name, row.unit)
    listing = ", ".join(
        f"{number(q.factor * float(value), 4)} in {log}"
        for value, told, log in zip(row.values, row.told, logs, strict=True)
        if told
    )
    named = f"{row.name}{f' [{q.unit}]' if q.unit else ''}"
    text = f"The logs do not agree: {named} is {listing} (probability by chance {_chance(row.chance, 'below')})."
    if row.rms is not None:
        text += f" With these values {number(np.degrees(row.rms), 2)} deg RMS of the angle are left."
    if row.odd is None:
        return text
    rest = "without it the others agree" if row.rest_agrees else "the others do not agree either"
    return f"{text} {logs[row.odd]} is farthest from the others; {rest}."


def _chance(chance: float, below: str) -> str:
    return f"{below} {_LEAST}" if chance < _LEAST else number(chance, 2)


def grid(result: Calibration) -> Grid:
    """The values that the logs share, log by log, and the probability of their differences."""
    rows = []
    for row in result.agreements:
        q = display_quantity(row.name, row.unit)
        values = [number(q.factor * row.value, 4)]
        values += [
            number(q.factor * float(v) if told else None, 4) for v, told in zip(row.values, row.told, strict=True)
        ]
        rows.append((row.name, q.unit or "–", *values, _chance(row.chance, "<"), "yes" if row.differ else "no"))
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
    found, low, high = estimate(*(factor * x for x in (value.value, value.low, value.high)))
    return f"{found} (reference)" if value.low == value.high else f"{found} ({low} to {high})"


def figure(result: Calibration) -> Figure:
    """One panel for each shared value: the logs' own values with intervals about the common one."""
    logs = result.provenance["logs"]
    order = [*result.differing, *sorted((row for row in result.agreements if not row.differ), key=lambda r: -r.squares)]
    odd = order[0].odd
    panels = [_panel(row, logs, odd) for row in order if np.any(row.told)]
    rows = -(-len(panels) // 2)
    return Figure(panels, columns=2, shared=False, height=0.8 + rows * (1.1 + 0.22 * len(logs)), legend="below")


def _panel(row: Agreement, logs: list[str], odd: int | None) -> Panel:
    q = display_quantity(row.name, row.unit)
    value, low, high = (q.factor * row.values, q.factor * row.low, q.factor * row.high)
    items: list[Item] = [Rule(q.factor * row.value, dash="dash", label="all logs")]
    for is_odd, colour, label in ((False, style.INPUT, "one log, 95 % interval"), (True, style.MODEL, "odd log")):
        places = [k for k in range(len(logs)) if row.told[k] and (k == odd) == is_odd]
        if places:
            ends = low[places].tolist(), high[places].tolist()
            items.append(Ranges(places, value[places].tolist(), *ends, label, colour=colour))
    title = f"{row.name}: differs" if row.differ else row.name
    return Panel(items, Axis(names=logs), Axis(f"{row.name.rpartition('.')[2]} [{q.unit or 1}]"), title)
