"""Output of a verb: tables on standard output; progress on standard error, a bar in a terminal, else a few lines."""

import itertools
import sys
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from threading import Event, Thread
from typing import Any

from sysid.base.errors import readable
from sysid.report.answer import Answer
from sysid.report.page import Grid, to_json
from twin.cli.environment import raw, say
from twin.cli.results import is_written


class Interruption(Exception):  # noqa: N818 - a person stopped it: no error
    """The user stopped the run; the text says what was kept and how to continue."""


@contextmanager
def goes_on(journal: str | None) -> Iterator[None]:
    """A run that is stopped within it says how it goes on from its journal, if it has one and has not ended."""
    try:
        yield
    except KeyboardInterrupt:
        if journal is None or not Path(journal).is_file() or is_written():
            raise
        raise Interruption(f"run it again with --resume {journal} to continue from there") from None


class Steps:
    """Receives the name of each step as it begins; `part` receives its progress from 0 to 1 and what it works on.

    `shares` are the parts of the whole that the steps take, all alike if none are given. The progress only grows.
    """

    def __init__(
        self, update: Callable[[float, str], None] = lambda share, name: None, shares: Sequence[float] = ()
    ) -> None:
        self._update, self._shares = update, shares
        self._begun, self._done, self._name = 0, 0.0, ""
        self._ticking: Callable[[], float] | None = None

    def __call__(self, name: str) -> None:
        self._begun += 1
        self._ticking = None
        self._tell(0.0, name)

    def part(self, share: float, name: str) -> None:
        """Within the step that has begun."""
        self._tell(share, name)

    def by_time(self, share: Callable[[], float]) -> None:
        """Until the next step, progress is at least `share()`, which is asked every second."""
        self._ticking = share

    def tick(self) -> None:
        """A second has gone by."""
        if self._ticking is not None:
            self._tell(self._ticking(), self._name)

    def _tell(self, share: float, name: str) -> None:
        k = max(self._begun - 1, 0)
        place = k + share
        if self._shares:
            place = sum(self._shares[:k]) + self._shares[min(k, len(self._shares) - 1)] * share
        self._done, self._name = max(self._done, place), name
        self._update(self._done, name)


class Rounds:
    """Receives the progress of `rounds` rounds of candidates, counted from 1, and advances the bar.

    A search with a budget of `seconds` is told by `begin` that it begins; the bar then moves with the time too.
    """

    def __init__(self, steps: Steps, rounds: int, seconds: float = 0.0) -> None:
        self._steps, self._rounds, self._seconds = steps, rounds, seconds
        self._round, self._last = 0, 0

    def begin(self) -> None:
        """The search begins."""
        start = time.monotonic()
        self._steps.by_time(lambda: min((time.monotonic() - start) / self._seconds, _BUDGET))
        self._steps.part(0.0, f"round 1 of a search of up to {self._seconds:g} s")

    def __call__(self, count: int, total: int, name: str) -> None:
        if self._round == 0 or count <= self._last:
            self._round += 1
        self._last = count
        share = min(self._round - 1 + count / total, self._rounds) / self._rounds
        text = f"round {self._round}: {count} of {total}, {name.replace('_', ' ')}"
        self._steps.part(0.0 if self._seconds else share, text)


class Searches:
    """Receives a text after each of a number of searches that nobody knows, and advances the bar ever more slowly."""

    def __init__(self, steps: Steps, usual: int = 20) -> None:
        self._steps, self._usual, self._done = steps, usual, 0

    def __call__(self, text: str) -> None:
        self._done += 1
        self._steps.part(self._done / (self._done + self._usual), f"search {self._done}, {text.replace('_', ' ')}")


@contextmanager
def progress(
    steps: int,
    shares: Sequence[float] = (),
    lines: bool = False,
    known: bool = False,
    below: Callable[[], Sequence[str]] = tuple,
) -> Iterator[Steps]:
    """Receives the names of `steps` steps and shows them on a progress bar in a terminal.

    `shares` are the parts of the whole that the steps take, see `Steps`. `lines`: without a terminal a line tells the
    progress now and then, so that a log or a pipe shows that a long run lives. `known`: the length of the work is
    known and `shares` are those of its time, so the time that is left is told too. `below` gives lines of text that a
    terminal shows below the bar, drawn in place ten times a second.
    """
    total = sum(shares) or steps
    if not sys.stderr.isatty():
        if not lines:
            yield Steps()
            return
        line_writer = _Lines(total, known)
        quiet = Steps(line_writer.update, shares)
        with _every(_SLOW, quiet.tick, line_writer.write):
            yield quiet
        return
    from rich.console import Console, RenderableType
    from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn
    from rich.text import Text

    class Bar(Progress):
        def get_renderables(self) -> Iterable[RenderableType]:
            yield from super().get_renderables()
            yield from (Text(readable(line), no_wrap=True, overflow="crop") for line in below())
            if _compiles():
                yield Text(_COMPILES)

    columns = (
        TextColumn("{task.percentage:>3.0f} %"),
        BarColumn(24),
        TimeElapsedColumn(),
        TextColumn("{task.description}", markup=False),
    )
    with Bar(*columns, console=Console(file=raw(sys.stderr)), transient=True) as bar:
        task, start = bar.add_task("", total=total), time.monotonic()

        def update(share: float, name: str) -> None:
            time_left = _time_left(time.monotonic() - start, share / total) if known else ""
            bar.update(task, completed=min(share, total), description=readable(f"{name}{time_left}"))

        receiver = Steps(update, shares)
        with _every((1.0,), receiver.tick):
            yield receiver


_TELLING = 0.05  # of the work: before that it does not tell how long the rest takes
_BUDGET = 0.97  # of a step, at the end of its budget
_SLOW = (10.0, 30.0)  # [s] until the first line without a terminal, and between two


_COMPILES = "compiling, once on this machine"


def _compiles() -> bool:
    """Whether numba is at work; a command that has not loaded it waits for nothing of it."""
    compiles = getattr(sys.modules.get("sysid.base.compiled"), "compiles", None)  # None while it is being imported
    return compiles is not None and bool(compiles())


class _Lines:
    """The progress as lines on standard error; a run of a few seconds says nothing."""

    def __init__(self, total: float, known: bool = False) -> None:
        self._total, self._begun, self._share, self._name = total, time.monotonic(), 0.0, ""
        self._known, self._moved = known, self._begun

    def update(self, share: float, name: str) -> None:
        """Keep it for the next line."""
        self._moved = time.monotonic() if share / self._total != self._share else self._moved
        self._share, self._name = min(share / self._total, 1.0), name  # the number of steps is an estimate

    def write(self) -> None:
        """The next line."""
        duration = time.monotonic() - self._begun
        time_left = _time_left(self._moved - self._begun, self._share, time.monotonic() - self._moved)
        time_left = time_left if self._known else ""
        cause = f"; {_COMPILES}" if _compiles() else ""
        say(f"qpal: {duration:.0f} s, {100 * self._share:.0f} %: {self._name}{time_left}{cause}")


def _time_left(duration: float, share: float, since: float = 0.0) -> str:
    """The time left `since` [s] the share was reached after `duration` [s], in words.

    Nothing while too little is done to tell, and where the next step takes longer than expected.
    """
    if share < _TELLING:
        return ""
    seconds = duration * (1.0 - share) / share - since
    if seconds < 0.0:
        return ""
    return f", about {seconds:.0f} s left" if seconds < 120.0 else f", about {seconds / 60.0:.0f} min left"


@contextmanager
def _every(seconds: Sequence[float], *calls: Callable[[], None]) -> Iterator[None]:
    """Calls `calls` in another thread after the first of `seconds` and then after every last of them."""
    stop = Event()

    def run() -> None:
        for k in itertools.count():
            if stop.wait(seconds[min(k, len(seconds) - 1)]):
                return
            for call in calls:
                call()

    thread = Thread(target=run, daemon=True)
    thread.start()
    try:
        yield
    finally:
        stop.set()
        thread.join()


def show(grid: Grid) -> None:
    """A table on standard output; full width if the output goes into a file."""
    from rich import box
    from rich.console import Console
    from rich.table import Table

    table = Table(box=box.SIMPLE_HEAD, title=_cell(grid.caption) or None, title_justify="left", pad_edge=False)
    for j, heading in enumerate(grid.headings):
        table.add_column(_cell(heading), justify="left" if grid.is_text(j) else "right", overflow="fold")
    for i, row in enumerate(grid.rows):
        table.add_row(*map(_cell, row), style="dim" if i in grid.quiet_rows else None)
    Console(file=raw(sys.stdout), width=None if sys.stdout.isatty() else 200).print(table)


def _cell(text: str) -> str:
    from rich.markup import escape

    return escape(readable(text))


def show_json(summary: dict[str, Any]) -> None:
    """The summary alone on standard output, whole: it is data."""
    raw(sys.stdout).write(to_json(summary))


def finish(
    folder: Path,
    summary: dict[str, Any],
    as_json: bool,
    grids: Sequence[Grid],
    sentences: Sequence[str],
    answer: Answer | None = None,
) -> None:
    """The end of a verb: only the summary, or the answer, then tables, sentences and the path of the report."""
    if as_json:
        show_json(summary)
        return
    from rich.console import Console

    console = Console(file=raw(sys.stdout))

    def say(sentence: str) -> None:
        if console.is_terminal:  # breaks lines between words
            console.print(readable(sentence), markup=False, highlight=False)
        else:
            print(sentence)

    if answer is not None:
        for line in answer.lines:
            say(line)
        for grid in answer.tables:
            show(grid)
        if answer.next:
            say(answer.next)
    for grid in grids:
        show(grid)
    for sentence in sentences:
        say(sentence)
    print(f"Report: {folder / 'report.html'}")
