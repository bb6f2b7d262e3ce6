"""What a report says first: one number, one word, one sentence, a picture, a few values, and one next step."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

from sysid.drawing.figure import Figure
from sysid.report.pieces import Grid, Picture

Word = Literal["good", "usable", "poor"]  # as `sysid.diagnosis.worth` gives it, which loads SciPy
GOOD, USABLE, POOR = Word.__args__  # type: ignore[attr-defined]
MARKS: dict[str, str] = {GOOD: "●", USABLE: "◐", POOR: "▲"}  # told apart without their colours
MOST = 5  # values
WORDS = 60  # above the picture


@dataclass(frozen=True)
class Answer:
    """The first screen of a page, and the first lines in a terminal.

    `number` is that of what `of` says. A run without a measurement has no `word`. `plot` is an element of
    `page.element` in place of a picture. Of `values` the first `MOST` rows are shown.
    """

    number: str
    of: str
    word: Word | None
    sentence: str
    picture: Picture | None = None
    plot: str = ""
    values: Grid | None = None
    next: str = ""

    @property
    def tables(self) -> Sequence[Grid]:
        """The values that have a place, none or one table."""
        if self.values is None or not self.values.rows:
            return ()
        return (replace(self.values, rows=self.values.rows[:MOST], caption="", note=""),)

    @property
    def lines(self) -> list[str]:
        """Number, word and sentence for a terminal."""
        verdict = f" {MARKS[self.word]} {self.word}" if self.word else ""
        return [f"{self.number}{verdict}: {self.of}", self.sentence]


def short(figure: Figure, runs: int = 1) -> Figure:
    """Of a figure of runs with errors below, and what stands below those, the `runs` and their errors: one screen."""
    heights = [1.1] * runs + [0.65] * runs
    panels = [replace(panel, weight=height) for panel, height in zip(figure.panels, heights, strict=False)]
    return replace(figure, panels=panels, height=0.9 + 1.7 * sum(heights[: len(panels)]), lettered=False)
