"""The first screen of `qpal bench report`: in how many families of tasks this library is first."""

from collections.abc import Sequence

import polars as pl

from sysid.bench import leaderboard as boards
from sysid.bench.regression import Verdict
from sysid.report.answer import GOOD, POOR, USABLE, Answer, Word
from sysid.report.page import Grid

_STEPS = ("Repeat it: ", "Run more: ")  # behind which a sentence has its command


def answer(
    winners: pl.DataFrame, sentences: Sequence[str], verdict: Verdict | None, values: Grid, plot: str = ""
) -> Answer:
    """In how many families of the `winners` this library is first.

    Poor where it is in none, or is worse than a base beyond noise. `sentences` are those of the leaderboard.
    """
    ranked = winners.filter(pl.any_horizontal(pl.col("ours_lost", "peer_lost").is_not_null()))
    ahead = ranked.filter(pl.col("ours_lost") <= pl.col("peer_lost").fill_null(float("inf")))
    word: Word = GOOD if len(ahead) == len(ranked) else USABLE
    text = "No method of others is ahead in any family."
    if ranked["peer"].null_count() == len(ranked):  # nobody to compare with
        word, text = USABLE, "No method of others is ranked in any family."
    if ahead.is_empty() or (verdict is not None and verdict.worse):
        word = POOR
    behind = ranked.join(ahead, "family", "anti").sort(pl.col("ours_lost").fill_null(boards.CAP) - pl.col("peer_lost"))
    if ranked.is_empty():
        text = "No method tried enough of the tasks to be ranked."
    elif len(behind):
        text = f"Farthest behind: {behind['family'][-1]}, where {behind['peer'][-1]} is first."
    steps = [s[s.index(mark) + len(mark) :] for s in sentences for mark in _STEPS if mark in s]
    return Answer(
        f"{len(ahead)} of {len(ranked)}",
        "families of tasks in which a method of this library comes nearest to the bar",
        word,
        text if verdict is None else verdict.sentences[0],
        plot=plot,
        values=values,
        next=f"Next: {steps[0]}" if steps else "",
    )
