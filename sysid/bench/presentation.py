"""The leaderboard to read: its verdict in sentences, its frames as cells of a page and as tables of Markdown.

The sentences say who is first in each family, where a peer wins, and where a method of ours is slower.
"""

import math
import shlex
from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import polars as pl

from sysid.bench.leaderboard import CAP, ENOUGH, NEAR, calibration, compare_methods, competitors, method_of, winners
from sysid.bench.statistics import Duel, wilson

FEW = 6  # tasks: with all of them won, chance still explains it once in 32 times
TENTH = 0.1  # of the seconds of the best peer with an equal fit: what ours should need
NONE = "–"
NO_RESULT = "no result"


def sentences(rows: pl.DataFrame, board: pl.DataFrame, ours: Collection[str]) -> list[str]:
    """The verdict of the leaderboard, family by family; `rows` are `scored`, `board` is their `leaderboard`."""
    families = winners(board, ours).to_dicts()
    texts = [sentence for row in families for sentence in _family(row, rows, board, ours)]
    for side, rival, whose in (("peer", "ours", "of others"), ("ours", "peer", "of this library")):
        alone = [row["family"] for row in families if row[side] is None and row[rival] is not None]
        texts += [f"No method {whose} is ranked in {', '.join(alone)}."] if alone else []
    return texts


def command(scenario: str, method: str, seed: int, budget: float | None = None) -> str:
    """The command that runs one cell by itself; a method that the library does not have is a file."""
    from sysid.bench.methods import TABLE

    name = method_of(scenario, method)
    file = "" if name in TABLE else ".py"
    time = [] if budget is None else ["--budget", f"{budget:g}"]
    words = ["--scenario", scenario, "--method", f"{name}{file}", "--first", str(seed), "--seeds", "1", *time]
    return shlex.join(["qpal", "bench", "run", *words, *_records_of(scenario), "--out", "runs/again.parquet"])


def _records_of(scenario: str) -> list[str]:
    """The option that families of records need, which are in a folder of the user's."""
    return ["--records", "FOLDER"] if scenario.startswith(("real/", "files/")) else []


def _more(family: str) -> str:
    """The command that runs all tasks of a family, which of drawn records may end in their length."""
    name, _, length = family.partition("-")
    scenarios = f"{name}/*{length and f'-{length}'}"
    return shlex.join(["qpal", "bench", "run", "--scenario", scenarios, *_records_of(scenarios)])


def _family(row: dict[str, Any], rows: pl.DataFrame, board: pl.DataFrame, ours: Collection[str]) -> Iterator[str]:
    """The sentences of one family: who is first, the duel of the two sides, and what it costs."""
    family, library, peer = row["family"], row["ours"], row["peer"]
    if library is None and peer is None:
        yield (
            f"{family}: no method tried {_percent(ENOUGH)} of the tasks, so none is ranked. Run more: {_more(family)}"
        )
        return
    losses = [row[f"{side}_lost"] for side in ("ours", "peer") if row[f"{side}_lost"] is not None]
    if min(losses) >= CAP:
        yield f"{family}: no method has a usable result; the table of failures says why."
        return
    side = "ours" if peer is None or (library is not None and row["ours_lost"] <= row["peer_lost"]) else "peer"
    first = library if side == "ours" else peer
    rate = wilson(row[f"{side}_near_0.1"], row[f"{side}_n"])
    yield (
        f"{family}: {first} is first{'' if side == 'ours' else ', which is not of this library'}. It loses "
        f"{row[f'{side}_lost']:.2f} points of fit to the bar on average over {_tasks(rate.n)}; "
        f"{_percent(rate.value)} of its fits ({_percent(rate.low)} to {_percent(rate.high)}) are within "
        f"{NEAR[0]:g} point of the bar."
    )
    if library is None or peer is None:
        return
    yield f"{family}: {_versus(library, peer, compare_methods(rows, library, peer, family))}"
    if side == "peer":
        yield f"{family}: {_worst_against(rows, family, library, peer)}"
    yield from (f"{family}: {text}" for text in _cost(row, board, ours))


def _versus(library: str, peer: str, result: Duel) -> str:
    """Win, tie and loss against the best peer, and whether the shares differ beyond chance."""
    counts = (
        f"{library} against {peer}: {result.wins} won, {result.ties} tied and {result.losses} lost of "
        f"{_tasks(result.n)}"
    )
    shares = (
        f"won {_percent(result.win[0])} to {_percent(result.win[1])}, lost {_percent(result.loss[0])} to "
        f"{_percent(result.loss[1])}"
    )
    if result.n < FEW:
        return f"{counts}: too few to tell who is ahead."
    if result.win[0] > result.loss[1]:
        end = f"{library} is ahead"
    elif result.loss[0] > result.win[1]:
        end = f"{peer} is ahead"
    else:
        end = "neither is ahead beyond chance"
    return f"{counts} (95 % intervals: {shares}); {end}."


def _worst_against(rows: pl.DataFrame, family: str, library: str, peer: str) -> str:
    """The task on which a peer is farthest ahead, with the command that repeats it."""
    fit = pl.when("ok").then("fit").otherwise(-CAP).alias("fit")
    pair = rows.filter((pl.col("family") == family) & pl.col("method").is_in([library, peer])).with_columns(fit)
    wide = pair.pivot("method", index=["scenario", "seed"], values="fit", aggregate_function="first").drop_nulls()
    top = wide.sort(pl.col(peer) - pl.col(library), "scenario", "seed", descending=[True, False, False]).row(
        0, named=True
    )
    fits = {name: f"{top[name]:.2f} %" if top[name] > -CAP else "no result" for name in (library, peer)}
    return (
        f"{peer} is farthest ahead on {top['scenario']}, seed {top['seed']}: {fits[peer]} against {fits[library]}. "
        f"Repeat it: {command(top['scenario'], library, top['seed'], _budget(rows))}"
    )


def _cost(row: dict[str, Any], board: pl.DataFrame, ours: Collection[str]) -> Iterator[str]:
    """Seconds of our best method against the fastest peer that is as good."""
    library, family = row["ours"], row["family"]
    equal = competitors(board).filter(
        (pl.col("family") == family)
        & ~pl.col("method").is_in(list(ours))
        & (pl.col("lost") <= row["ours_lost"] + NEAR[0])
        & pl.col("seconds").is_not_null()
    )
    if equal.is_empty():
        yield (
            f"no peer's mean gap is within {NEAR[0]:g} point of that of {library}, which takes "
            f"{_duration(row['ours_seconds'])}; {row['peer']} takes {_duration(row['peer_seconds'])} (shifted "
            "geometric means)."
        )
        return
    peer = equal.sort("seconds").row(0, named=True)
    slower = row["ours_seconds"] / peer["seconds"]
    faster = "is faster than" if slower > TENTH else "needs a tenth or less of the time of"
    yield (
        f"{library} {'is slower than' if slower > 1 else faster} {peer['method']}, whose mean gap is no larger: "
        f"{_duration(row['ours_seconds'])} against {_duration(peer['seconds'])} (shifted geometric means)."
    )


def interval_sentences(rows: pl.DataFrame) -> list[str]:
    """A sentence for each method whose intervals hold less or more often than claimed; see `calibration`."""
    texts = []
    for row in calibration(rows, ("method",)).iter_rows(named=True):
        if row["held_low"] <= 0.95 <= row["held_high"]:
            continue
        side = "too narrow" if row["held_high"] < 0.95 else "wider than need be"
        texts.append(
            f"The pole intervals of {row['method']} are {side}: {row['held']} of {row['intervals']} hold the truth, "
            f"{_percent(row['held_rate'])} ({_percent(row['held_low'])} to {_percent(row['held_high'])}); "
            "95 % is claimed."
        )
    return texts


def bar_sentences(board: pl.DataFrame) -> list[str]:
    """Which families have no bar from the truth, and where the bar itself failed."""
    shares = board.group_by("family").agg(pl.col("bar_at_truth").mean()).sort("family").iter_rows()
    return [
        f"{family}: the bar is the best fit of any method on {_percent(1 - share)} of the rows, which have no "
        "truth or no fit from it."
        for family, share in shares
        if share < 1
    ]


def _budget(rows: pl.DataFrame) -> float | None:
    budgets = rows["budget"].to_numpy()
    return float(budgets[0]) if len(budgets) and (budgets == budgets[0]).all() else None


def _tasks(n: int) -> str:
    return f"{n} task{'s' * (n != 1)}"


def _percent(share: float) -> str:
    return f"{100 * share:.0f} %"


def _duration(value: float | None) -> str:
    return "an unknown time" if value is None else f"{value:.3g} s"


@dataclass(frozen=True)
class Column:
    """A heading, and a cell from a row of the frame."""

    heading: str
    cell: Callable[[dict[str, Any]], str]
    text: bool = False


def column(name: str, heading: str, form: Callable[[Any], str] = str, text: bool = False) -> Column:
    """A column that shows one column of the frame; a missing value is `NONE`."""
    return Column(heading, lambda row: NONE if row[name] is None else form(row[name]), text)


def share_column(name: str, heading: str) -> Column:
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
    column("method", "method", text=True),
    column("n", "tasks"),
    share_column(f"near_{NEAR[0]:g}", f"within {NEAR[0]:g} point [%]"),
    share_column(f"near_{NEAR[1]:g}", f"within {NEAR[1]:g} point [%]"),
    column("lost", "mean gap [points]", points),
    column("gap_median", "median", points),
    column("gap_p95", "95 % below", points),
    column("gap_worst", "worst", points),
    column("fit_median", "median fit [%]", points),
    column("crashed", "crashed"),
    column("stopped", "stopped"),
    column("refused", "refused"),
    column("seconds", "time [s]", seconds),
    column("memory", "memory [MiB]", "{:.0f}".format),
)
WINNERS = (
    column("family", "family", text=True),
    column("ours", "our best", text=True),
    column("peer", "best of the others", text=True),
    column("ours_lost", "mean gap, ours [points]", points),
    column("peer_lost", "other", points),
    column("ours_seconds", "time, ours [s]", seconds),
    column("peer_seconds", "other", seconds),
)
CALIBRATION = (
    column("family", "family", text=True),
    column("method", "method", text=True),
    column("n", "fits"),
    column("intervals", "intervals"),
    share_column("held", "hold the truth [%]"),
    Column("other models [%]", lambda r: f"{100 * r['others_held'] / r['others']:.0f}" if r["others"] else NONE),
    column("width", "half width [%]", error),
)
ERRORS = (
    column("family", "family", text=True),
    column("method", "method", text=True),
    column("pole_error_n", "tasks"),
    column("pole_error_median", "poles, median [%]", error),
    column("pole_error_p95", "95 % below", error),
    column("map_error_n", "tasks"),
    column("map_error_median", "steady state, median [%]", error),
    column("map_error_p95", "95 % below", error),
)
METHODS = (
    column("method", "method", text=True),
    column("n", "tasks"),
    column("lost", "mean gap [points]", points),
    column("gap_median", "median", points),
    column("gap_worst", "worst", points),
    column("worst_seed", "its seed"),
    column("fit_median", "median fit [%]", points),
    column("oracle_median", "oracle [%]", points),
    column("seconds", "time [s]", seconds),
)
WORST = (
    column("method", "method", text=True),
    column("seed", "seed"),
    column("gap", "gap [points]", points),
    column("fit", "fit [%]", points),
    column("bar", "bar [%]", points),
    column("oracle", "oracle [%]", points),
    column("seconds", "time [s]", seconds),
    Column("structure, end of the search", lambda r: _end_of_search(r), text=True),
)


def _end_of_search(row: dict[str, Any]) -> str:
    reason = row["status"] if row["status"] != "ok" else row["stop"]
    return "; ".join(part for part in (row["structure"], reason) if part) or NONE


def cells(frame: pl.DataFrame, columns: Sequence[Column]) -> list[list[str]]:
    """The frame as rows of text."""
    return [[column.cell(row) for column in columns] for row in frame.iter_rows(named=True)]


def markdown(frame: pl.DataFrame, columns: Sequence[Column] = LEADERBOARD) -> str:
    """The frame as a table of Markdown, numbers to the right."""
    lines = [[column.heading for column in columns], [":--" if c.text else "--:" for c in columns]]
    body = [[cell.replace("|", "\\|") for cell in row] for row in cells(frame, columns)]
    return "\n".join("| " + " | ".join(line) + " |" for line in (*lines, *body)) + "\n"
