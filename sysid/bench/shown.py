"""How the frames of the leaderboard are written: cells of a page, and tables of Markdown for README and docs."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import polars as pl

from sysid.bench.leaderboard import NEAR

NONE = "–"
NO_RESULT = "no result"


@dataclass(frozen=True)
class Column:
    """A heading, and a cell from a row of the frame."""

    heading: str
    cell: Callable[[dict[str, Any]], str]
    text: bool = False


def of(name: str, heading: str, form: Callable[[Any], str] = str, text: bool = False) -> Column:
    """A column that shows one column of the frame; a missing value is `NONE`."""
    return Column(heading, lambda row: NONE if row[name] is None else form(row[name]), text)


def share(name: str, heading: str) -> Column:
    """A rate in percent with its Wilson interval."""

    def cell(row: dict[str, Any]) -> str:
        if row[f"{name}_rate"] is None or math.isnan(row[f"{name}_rate"]):
            return NONE
        rate, low, high = (100 * row[f"{name}_{end}"] for end in ("rate", "low", "high"))
        return f"{rate:.0f} ({low:.0f} to {high:.0f})"

    return Column(heading, cell)


def points(x: float) -> str:
    """Points of fit; an infinite gap is no result."""
    return NO_RESULT if math.isinf(x) else f"{x + 0.0:.2f}" if abs(x) < 1e4 else f"{x:.1e}"


def seconds(x: float) -> str:
    """Three digits or so, without powers of ten."""
    return f"{x:.3f}" if x < 0.1 else f"{x:.2f}" if x < 10 else f"{x:.1f}" if x < 100 else f"{x:.0f}"


def error(x: float) -> str:
    """A relative error in percent."""
    return f"{100 * x:.2g}" if x < 1.0 else f"{100 * x:.0f}" if x < 100.0 else "over 10000"


LEADERBOARD = (
    of("method", "method", text=True),
    of("n", "tasks"),
    share(f"near_{NEAR[0]:g}", f"within {NEAR[0]:g} point [%]"),
    share(f"near_{NEAR[1]:g}", f"within {NEAR[1]:g} point [%]"),
    of("lost", "mean gap [points]", points),
    of("gap_median", "median", points),
    of("gap_p95", "95 % below", points),
    of("gap_worst", "worst", points),
    of("fit_median", "median fit [%]", points),
    of("crashed", "crashed"),
    of("stopped", "stopped"),
    of("refused", "refused"),
    of("seconds", "time [s]", seconds),
    of("memory", "memory [MiB]", "{:.0f}".format),
)
WINNERS = (
    of("family", "family", text=True),
    of("ours", "our best", text=True),
    of("peer", "best of the others", text=True),
    of("ours_lost", "mean gap, ours [points]", points),
    of("peer_lost", "other", points),
    of("ours_seconds", "time, ours [s]", seconds),
    of("peer_seconds", "other", seconds),
)
CALIBRATION = (
    of("family", "family", text=True),
    of("method", "method", text=True),
    of("n", "fits"),
    of("intervals", "intervals"),
    share("held", "hold the truth [%]"),
    Column("other models [%]", lambda r: f"{100 * r['others_held'] / r['others']:.0f}" if r["others"] else NONE),
    of("width", "half width [%]", error),
)
ERRORS = (
    of("family", "family", text=True),
    of("method", "method", text=True),
    of("pole_error_n", "tasks"),
    of("pole_error_median", "poles, median [%]", error),
    of("pole_error_p95", "95 % below", error),
    of("map_error_n", "tasks"),
    of("map_error_median", "steady state, median [%]", error),
    of("map_error_p95", "95 % below", error),
)
METHODS = (
    of("method", "method", text=True),
    of("n", "tasks"),
    of("lost", "mean gap [points]", points),
    of("gap_median", "median", points),
    of("gap_worst", "worst", points),
    of("worst_seed", "its seed"),
    of("fit_median", "median fit [%]", points),
    of("oracle_median", "oracle [%]", points),
    of("seconds", "time [s]", seconds),
)
WORST = (
    of("method", "method", text=True),
    of("seed", "seed"),
    of("gap", "gap [points]", points),
    of("fit", "fit [%]", points),
    of("bar", "bar [%]", points),
    of("oracle", "oracle [%]", points),
    of("seconds", "time [s]", seconds),
    Column("structure, end of the search", lambda r: _ended(r), text=True),
)


def _ended(row: dict[str, Any]) -> str:
    said = row["status"] if row["status"] != "ok" else row["stop"]
    return "; ".join(part for part in (row["structure"], said) if part) or NONE


def cells(frame: pl.DataFrame, columns: Sequence[Column]) -> list[list[str]]:
    """The frame as rows of text."""
    return [[column.cell(row) for column in columns] for row in frame.iter_rows(named=True)]


def markdown(frame: pl.DataFrame, columns: Sequence[Column] = LEADERBOARD) -> str:
    """The frame as a table of Markdown, numbers to the right."""
    lines = [[column.heading for column in columns], [":--" if c.text else "--:" for c in columns]]
    body = [[cell.replace("|", "\\|") for cell in row] for row in cells(frame, columns)]
    return "\n".join("| " + " | ".join(line) + " |" for line in (*lines, *body)) + "\n"
