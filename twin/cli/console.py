"""What a verb says: tables on standard output, progress on standard error and only where a person watches."""

import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from twin.report.page import Grid, to_json


@contextmanager
def progress(steps: int) -> Iterator[Callable[[str], None]]:
    """A function that takes the name of the next of `steps` steps and shows it on a bar."""
    if not sys.stderr.isatty():
        yield lambda name: None
        return
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

    columns = (
        TextColumn("{task.percentage:>3.0f} %"),
        BarColumn(24),
        TimeElapsedColumn(),
        TextColumn("{task.description}"),
    )
    with Progress(*columns, console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task("", total=steps)
        begun = False

        def step(name: str) -> None:
            nonlocal begun
            bar.update(task, advance=1 if begun else 0, description=name)
            begun = True

        yield step


def show(grid: Grid) -> None:
    """A table on standard output; wide enough for itself where the output goes into a file."""
    from rich import box
    from rich.console import Console
    from rich.markup import escape
    from rich.table import Table

    table = Table(box=box.SIMPLE_HEAD, title=grid.caption or None, title_justify="left", pad_edge=False)
    for j, heading in enumerate(grid.headings):
        table.add_column(escape(heading), justify="left" if grid.is_text(j) else "right", overflow="fold")
    for i, row in enumerate(grid.rows):
        table.add_row(*map(escape, row), style="dim" if i in grid.quiet_rows else None)
    console = Console()
    if not sys.stdout.isatty():
        console = Console(width=200)
    console.print(table)


def finish(
    folder: Path, summary: dict[str, Any], as_json: bool, grids: Sequence[Grid], sentences: Sequence[str]
) -> None:
    """The end of a verb: the summary alone, or tables, sentences and where the report lies."""
    if as_json:
        sys.stdout.write(to_json(summary))
        return
    from rich.console import Console

    for grid in grids:
        show(grid)
    console = Console()
    for sentence in sentences:
        if console.is_terminal:  # breaks lines between words
            console.print(sentence, markup=False, highlight=False)
        else:
            print(sentence)
    print(f"Report: {folder / 'report.html'}")
