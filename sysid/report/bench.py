"""The pages of `qpal bench report`: the leaderboard, and one page for each scenario."""

from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import polars as pl

from sysid.base import style
from sysid.base.errors import InputError
from sysid.base.files import json_value, write_text
from sysid.bench import leaderboard as boards
from sysid.bench import presentation
from sysid.bench.cell import Redrawn
from sysid.bench.leaderboard import worst_to_draw
from sysid.bench.regression import Verdict
from sysid.drawing.axes import draw
from sysid.report import bench_figures as plots
from sysid.report.bench_answer import answer
from sysid.report.page import Grid, Page, Picture, Section, element
from sysid.report.page import write as write_page

REPORT, FOLDER, TABLES = "report.html", "scenarios", "tables.md"
WORST, EACH = 20, 3  # rows of a scenario's page, and of one method among them
DRAWN = 6  # worst cells that are solved again and drawn
Redraw = Callable[[str, str, int], Redrawn]


@dataclass(frozen=True)
class Board:
    """The frames of the leaderboard, computed once for all pages; `ours` are the methods of this library."""

    rows: pl.DataFrame
    ours: tuple[str, ...]
    board: pl.DataFrame
    winners: pl.DataFrame
    calibration: pl.DataFrame
    errors: pl.DataFrame
    scenarios: pl.DataFrame
    worst: pl.DataFrame
    untried: pl.DataFrame
    sentences: tuple[str, ...]

    @classmethod
    def of(cls, table: pl.DataFrame, ours: Collection[str]) -> "Board":
        """All frames of a results table. Raises InputError for a table without rows."""
        ours = (*ours, boards.OWN)
        rows = boards.score_rows(table)
        board = boards.leaderboard(rows)
        return cls(
            rows,
            ours,
            board,
            boards.winners(board, ours),
            boards.calibration(rows),
            boards.errors(rows),
            boards.scenarios(rows),
            boards.worst(boards.worst(rows, EACH), WORST, ("scenario",)),
            boards.missing_methods(table),
            tuple(presentation.sentences(rows, board, ours)),
        )


def write(
    folder: Path,
    table: pl.DataFrame,
    ours: Collection[str],
    verdict: Verdict | None = None,
    redraw: Redraw | None = None,
    drawn: int = DRAWN,
) -> tuple[dict[str, Any], Page]:
    """Write scenarios/*.html, tables.md and what `page.write` writes; returns the summary and the page.

    `folder` exists; the caller moves it into place. `verdict` is that of `sysid.bench.regression.compare`. With
    `redraw` the `drawn` worst cells of our best methods are solved again and drawn.
    """
    board = Board.of(table, ours)
    pictures = {} if redraw is None else _pictures(board, redraw, drawn)
    page = front(board, verdict, pictures)
    (folder / FOLDER).mkdir()
    for scenario, scenario_page in scenario_pages(board, pictures):
        write_text(folder / FOLDER / file_name(scenario), scenario_page.html())
    write_text(folder / TABLES, tables(board))
    summary_values = summary(board, verdict)
    write_page(folder, page, summary_values)
    return summary_values, page


def front(board: Board, verdict: Verdict | None, pictures: dict[str, Picture]) -> Page:
    """The leaderboard."""
    figures, winners = _figures(board), _grid(board.winners, presentation.WINNERS, 3)
    sections = [
        *([_changes(verdict)] if verdict is not None else []),
        _families(board),
        Section(
            "Accuracy",
            [
                "A curve shows on which share of the tasks a method comes within a factor of the best method: of its "
                "error in the first plot, of its time for a fit near the bar in the second. Higher is better. Methods "
                "of others are dashed; a method without a rival on its tasks is level. Drag to zoom, "
                "double-click to go back. The first plot stands above.",
            ],
            plots=figures[1:2],
        ),
        Section("Cost", ["Mean gap to the bar against the time of a fit; low and left is better."], plots=figures[2:3]),
        _intervals(board, figures[3:4]),
        Section(
            "Poles and maps",
            [
                "Largest relative error of a pole in the s-plane, and of the steady state relative to the standard "
                "deviation of the output, for tasks whose truth is known."
            ],
            tables=[_grid(board.errors, presentation.ERRORS, 2)],
        ),
        _failures(board),
        _scenarios(board, pictures),
    ]
    packages = {"qpal": ", ".join(sorted(set(board.rows["qpal"].drop_nulls()) - {""}))}
    machines = ", ".join(sorted(set(board.rows["machine"].drop_nulls()) - {""}))
    tasks = board.rows.select(pl.struct(boards.TASK).n_unique()).item()
    subtitle = f"{len(board.rows)} rows, {tasks} tasks, {board.rows['method'].n_unique()} methods. {machines}"
    return Page(
        "Identification benchmark",
        subtitle,
        [*([verdict.sentences[0]] if verdict else []), *_first(board)],
        sections,
        packages,
        wide=True,
        answer=answer(board.winners, board.sentences, verdict, winners, figures[0]),
    )


def scenario_pages(board: Board, pictures: dict[str, Picture]) -> list[tuple[str, Page]]:
    """A page for each scenario: its methods, and the worst seeds of each."""
    methods = board.scenarios.partition_by("scenario", as_dict=True)
    worst = board.worst.partition_by("scenario", as_dict=True)
    bars = dict(board.rows.group_by("scenario").agg(pl.col("bar_is").unique().sort().str.join(" or ")).rows())
    return [
        (str(key[0]), _scenario(str(key[0]), part, worst.get(key), bars[key[0]], pictures.get(str(key[0]))))
        for key, part in methods.items()
    ]


def _scenario(
    scenario: str, methods: pl.DataFrame, worst: pl.DataFrame | None, bar: str, picture: Picture | None
) -> Page:
    """The page of one scenario."""
    from markupsafe import Markup

    sections = [Section("Methods", tables=[_grid(methods, presentation.METHODS)])]
    if picture is not None:
        sections.append(Section("The worst seed drawn", pictures=[picture]))
    if worst is not None and len(worst):
        top = worst.sort("gap", descending=True).row(0, named=True)
        repeat = f"Repeat the worst: {presentation.command(scenario, top['method'], top['seed'], top.get('budget'))}"
        sections.append(Section("Worst seeds", [repeat], tables=[_grid(worst, presentation.WORST, last_text=True)]))
    tasks = max(row[0] for row in methods.select("n").iter_rows())
    back = Markup('<a href="../{}">The leaderboard</a>').format(REPORT)
    verdict = [f"{tasks} tasks. The bar is {bar}.", back]
    return Page(scenario, "a scenario of the identification benchmark", verdict, sections, wide=True)


def tables(board: Board) -> str:
    """The tables for README and docs, as Markdown."""
    parts = ["## Winners\n\n" + presentation.markdown(board.winners, presentation.WINNERS)]
    for (family,), part in board.board.partition_by("family", as_dict=True, maintain_order=True).items():
        parts.append(f"## {family}\n\n" + presentation.markdown(part))
    parts.append("## Intervals\n\n" + presentation.markdown(board.calibration, presentation.CALIBRATION))
    return "\n".join(parts)


def summary(board: Board, verdict: Verdict | None) -> dict[str, Any]:
    """The leaderboard as JSON values."""
    values: dict[str, Any] = {
        "rows": len(board.rows),
        "sentences": list(board.sentences),
        "winners": board.winners.to_dicts(),
        "leaderboard": board.board.to_dicts(),
    }
    if verdict is not None:
        values |= {"worse": verdict.worse, "changes": list(verdict.sentences)}
    return dict(json_value(values))


def drawing(cell: Redrawn) -> Picture:
    """The free run of a cell over the measured output, and its error."""
    caption = f"{cell.method} on {cell.scenario}, seed {cell.seed}: free run on the first test, and its error."
    name = file_name(f"{cell.scenario}-{cell.method}")[:-5]
    return Picture(name, style.png(draw(plots.cell_figure(cell))), f"{caption} {cell.given}".strip())


def file_name(scenario: str) -> str:
    """The page of a scenario: `family/name` becomes family.name.html; no two scenarios share one."""
    safe = (c if c.isascii() and (c.isalnum() or c in "-_") else "." if c == "/" else f"~{ord(c):x}~" for c in scenario)
    return f"{''.join(safe)}.html"


def _pictures(board: Board, redraw: Redraw, count: int) -> dict[str, Picture]:
    """The worst cells of our best method of each family, by scenario; one without a result this time is left out."""
    pictures, best = {}, board.winners["ours"].drop_nulls().unique().to_list()
    for scenario, method, seed in worst_to_draw(board.rows, best, count):
        try:
            pictures[scenario] = drawing(redraw(scenario, method, seed))
        except InputError:
            continue
    return pictures


def _first(board: Board) -> list[str]:
    """The first sentence of each family, and who has no rival."""
    return [s for s in board.sentences if " is first" in s or " is ranked" in s]


def _figures(board: Board) -> list[str]:
    """The plots."""
    return [
        element(plots.error_profile(board.rows, board.ours), "errors"),
        element(plots.time_profile(board.rows, board.ours, boards.NEAR[1]), "times"),
        element(plots.cost(board.board, board.ours), "cost"),
        element(plots.calibration(board.calibration, board.board, board.ours), "intervals"),
    ]


def _families(board: Board) -> Section:
    """The leaderboard of each family, with what it says in words."""
    parts = board.board.partition_by("family", as_dict=True, maintain_order=True)
    grids = [
        _grid(part, presentation.LEADERBOARD, caption=f"{family}. Click a heading to sort.", bar=True)
        for (family,), part in parts.items()
    ]
    return Section(
        "Leaderboard",
        [*(s for s in board.sentences if s not in _first(board)), *presentation.bar_sentences(board.board)],
        tables=[_grid(board.winners, presentation.WINNERS, 3), *grids],
    )


def _intervals(board: Board, figures: Sequence[str]) -> Section:
    text = (
        f"Pole intervals that claim {100 * boards.CLAIMED:.0f} %, of models that explain their record: their loss is "
        f"at most {boards.EXPLAINED:g} times the variance of the noise. No interval of another model can be right; the "
        "share of those that hold is shown for comparison. Intervals of one fit depend on each other, so the ranges "
        "are somewhat too narrow."
    )
    grid = _grid(board.calibration, presentation.CALIBRATION, 2)
    return Section("Intervals", [text, *presentation.interval_sentences(board.rows)], tables=[grid], plots=figures)


def _failures(board: Board) -> Section:
    """The most frequent reasons why a row has no usable result."""
    failures = board.rows.filter(~pl.col("ok"))
    reason = pl.when(pl.col("status") == "ok").then(pl.lit("the free run diverged")).otherwise("status").alias("why")
    counts = (
        failures.group_by("method", reason)
        .agg(pl.len().alias("n"), pl.col("scenario", "seed").first())
        .sort("n", "method", "why", descending=[True, False, False])
    )
    rows = [[r["method"], r["why"][:160], str(r["n"]), r["scenario"], str(r["seed"])] for r in counts.to_dicts()]
    absent = [[r["method"], r["status"][:160], str(r["n"]), "", ""] for r in board.untried.to_dicts()]
    headings = ("method", "why", "rows", "for example", "seed")
    total = f"{len(failures)} of {len(board.rows)} rows have no usable result."
    top = Grid(headings, [*rows, *absent][:50], "The 50 most frequent reasons.", 2, sortable=True)
    return Section("Failures", [total], tables=[top] if rows or absent else [])


def _scenarios(board: Board, pictures: dict[str, Picture]) -> Section:
    """A line for each scenario with a link to its page."""
    import markupsafe

    best = board.scenarios.filter(pl.col("method") != boards.BAR).group_by("scenario", maintain_order=True)
    frame = best.agg(pl.col("n").max(), pl.col("method").first(), pl.col("lost").first(), pl.col("gap_worst").first())
    link = '<a href="{}/{}">{}</a>'
    rows = [
        [
            str(markupsafe.Markup(link).format(FOLDER, file_name(r["scenario"]), r["scenario"])),
            str(r["n"]),
            r["method"],
            presentation.points(r["lost"]),
            presentation.points(r["gap_worst"]),
        ]
        for r in frame.iter_rows(named=True)
    ]
    links = [[markupsafe.Markup(row[0]), *row[1:]] for row in rows]
    headings = ("scenario", "tasks", "best method", "its mean gap [points]", "its worst")
    grid = Grid(headings, links, "Each page lists the worst seeds.", sortable=True)
    return Section("Scenarios", tables=[grid], pictures=list(pictures.values()))


def _changes(verdict: Verdict) -> Section:
    return Section("Changes against the base", verdict.sentences)


def _grid(
    frame: pl.DataFrame,
    columns: Sequence[presentation.Column],
    text: int = 1,
    caption: str = "",
    bar: bool = False,
    last_text: bool = False,
) -> Grid:
    """A sortable table; the bar and methods that are not ranked are grey if `bar`."""
    quiet = frozenset[int]()
    if bar:
        competing = boards.competitors(frame)["method"].to_list()
        quiet = frozenset(k for k, name in enumerate(frame["method"]) if name not in competing)
    headings = [column.heading for column in columns]
    return Grid(headings, presentation.cells(frame, columns), caption, text, quiet, last_text, sortable=True)
