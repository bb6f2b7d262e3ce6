"""Output of a verb: tables on standard output; progress on standard error, only in a terminal."""

import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from sysid.report.page import Grid, to_json


class Stopped(Exception):  # noqa: N818 - a person stopped it: no error
    """The user stopped the run; the text says what was kept and how to continue."""


class Steps:
    """Receives the name of each step as it begins; `part` receives its progress from 0 to 1 and what it works on."""

    def __init__(self, update: Callable[[float, str], None] = lambda done, name: None) -> None:
        self._update = update
        self._begun = 0

    def __call__(self, name: str) -> None:
        self._update(self._begun, name)
        self._begun += 1

    def part(self, done: float, name: str) -> None:
        """Within the step that has begun."""
        self._update(self._begun - 1 + done, name)


class Rounds:
    """Receives the progress of `rounds` rounds of candidates, counted from 1, and advances the bar."""

    def __init__(self, steps: Steps, rounds: int) -> None:
        self._steps, self._rounds, self._round, self._last = steps, rounds, 0, 0

    def __call__(self, done: int, total: int, name: str) -> None:
        if self._round == 0 or done <= self._last:
            self._round += 1
        self._last = done
        share = min(self._round - 1 + done / total, self._rounds) / self._rounds
        self._steps.part(share, f"round {self._round}: {done} of {total}, {name.replace('_', ' ')}")


class Searches:
    """Receives a text after each of a number of searches that nobody knows, and advances the bar ever more slowly."""

    def __init__(self, steps: Steps, usual: int = 20) -> None:
        self._steps, self._usual, self._done = steps, usual, 0

    def __call__(self, text: str) -> None:
        self._done += 1
        self._steps.part(self._done / (self._done + self._usual), f"search {self._done}, {text.replace('_', ' ')}")


@contextmanager
def progress(steps: int) -> Iterator[Steps]:
    """Receives the names of `steps` steps and shows them on a progress bar in a terminal."""
    if not sys.stderr.isatty():
        yield Steps()
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
        yield Steps(lambda done, name: bar.update(task, completed=done, description=name))


def show(grid: Grid) -> None:
    """A table on standard output; full width if the output goes into a file."""
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
    """The end of a verb: only the summary, or tables, sentences and the path of the report."""
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
