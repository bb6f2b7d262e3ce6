"""The leaderboard in words: who is first in each family, where a peer wins, where a method of ours is slower."""

from collections.abc import Collection, Iterator
from typing import Any

import polars as pl

from sysid.bench.leaderboard import CAP, ENOUGH, NEAR, against, calibration, method_of, ranked, winners
from sysid.bench.statistics import Duel, wilson

TENTH = 0.1  # of the seconds of the best peer with an equal fit: what ours should need


def sentences(rows: pl.DataFrame, board: pl.DataFrame, ours: Collection[str]) -> list[str]:
    """The verdict of the leaderboard, family by family; `rows` are `scored`, `board` is their `leaderboard`."""
    families = winners(board, ours).iter_rows(named=True)
    return [sentence for row in families for sentence in _family(row, rows, board, ours)]


def again(scenario: str, method: str, seed: int) -> str:
    """The command that runs one cell by itself."""
    name = method_of(scenario, method)
    return f"qpal bench run --scenario {scenario} --method {name} --first {seed} --seeds 1 --out runs/again.parquet"


def _family(row: dict[str, Any], rows: pl.DataFrame, board: pl.DataFrame, ours: Collection[str]) -> Iterator[str]:
    family, mine, peer = row["family"], row["ours"], row["peer"]
    if mine is None and peer is None:
        yield (
            f"{family}: no method tried {_percent(ENOUGH)} of the tasks, so none is ranked. Run more: qpal bench run "
            "--tag standard"
        )
        return
    side = "ours" if peer is None or (mine is not None and row["ours_lost"] <= row["peer_lost"]) else "peer"
    first = mine if side == "ours" else peer
    rate = wilson(row[f"{side}_near_0.1"], row[f"{side}_n"])
    yield (
        f"{family}: {first} is first{'' if side == 'ours' else ', a method of somebody else'}. It loses "
        f"{row[f'{side}_lost']:.2f} points of fit to the bar on average over {rate.n} tasks; {_percent(rate.value)} of "
        f"its fits ({_percent(rate.low)} to {_percent(rate.high)}) are within {NEAR[0]:g} point of the bar."
    )
    if mine is None or peer is None:
        yield f"{family}: nobody else's method is in the table." if peer is None else f"{family}: no method of ours is."
        return
    yield f"{family}: {_versus(mine, peer, against(rows, mine, peer, family))}"
    if side == "peer":
        yield f"{family}: {_worst_against(rows, family, mine, peer)}"
    yield from (f"{family}: {text}" for text in _cost(row, board, ours))


def _versus(mine: str, peer: str, found: Duel) -> str:
    """Win, tie and loss against the best peer, and whether the shares differ beyond chance."""
    counts = f"{mine} against {peer}: {found.wins} won, {found.ties} tied and {found.losses} lost of {found.n} tasks"
    shares = (
        f"won {_percent(found.win[0])} to {_percent(found.win[1])}, lost {_percent(found.loss[0])} to "
        f"{_percent(found.loss[1])}"
    )
    if found.win[0] > found.loss[1]:
        end = f"{mine} is ahead"
    elif found.loss[0] > found.win[1]:
        end = f"{peer} is ahead"
    else:
        end = "neither is ahead beyond chance"
    return f"{counts} (95 % intervals: {shares}); {end}."


def _worst_against(rows: pl.DataFrame, family: str, mine: str, peer: str) -> str:
    """The task on which a peer is farthest ahead, with the command that repeats it."""
    fit = pl.when("ok").then("fit").otherwise(-CAP).alias("fit")
    both = rows.filter((pl.col("family") == family) & pl.col("method").is_in([mine, peer])).with_columns(fit)
    wide = both.pivot("method", index=["scenario", "seed"], values="fit", aggregate_function="first").drop_nulls()
    top = wide.sort(pl.col(peer) - pl.col(mine), "scenario", "seed", descending=[True, False, False]).row(0, named=True)
    shown = {name: f"{top[name]:.2f} %" if top[name] > -CAP else "no result" for name in (mine, peer)}
    return (
        f"{peer} is farthest ahead on {top['scenario']}, seed {top['seed']}: {shown[peer]} against {shown[mine]}. "
        f"Repeat it: {again(top['scenario'], mine, top['seed'])}"
    )


def _cost(row: dict[str, Any], board: pl.DataFrame, ours: Collection[str]) -> Iterator[str]:
    """Seconds of our best method against the fastest peer that is as good."""
    mine, family = row["ours"], row["family"]
    equal = ranked(board).filter(
        (pl.col("family") == family)
        & ~pl.col("method").is_in(list(ours))
        & (pl.col("lost") <= row["ours_lost"] + NEAR[0])
        & pl.col("seconds").is_not_null()
    )
    if equal.is_empty():
        yield (
            f"no peer comes within {NEAR[0]:g} point of {mine}, which takes {_seconds(row['ours_seconds'])}; "
            f"{row['peer']} takes {_seconds(row['peer_seconds'])} (shifted geometric means)."
        )
        return
    peer = equal.sort("seconds").row(0, named=True)
    slower = row["ours_seconds"] / peer["seconds"]
    faster = "is faster than" if slower > TENTH else "needs a tenth or less of the time of"
    yield (
        f"{mine} {'is slower than' if slower > 1 else faster} {peer['method']}, which is at least as good: "
        f"{_seconds(row['ours_seconds'])} against {_seconds(peer['seconds'])} (shifted geometric means, {slower:.2g} "
        "times)."
    )


def of_intervals(rows: pl.DataFrame) -> list[str]:
    """A sentence for each method whose intervals hold less or more often than claimed; see `calibration`."""
    found = []
    for row in calibration(rows, ("method",)).iter_rows(named=True):
        if row["held_low"] <= 0.95 <= row["held_high"]:
            continue
        side = "too narrow" if row["held_high"] < 0.95 else "wider than need be"
        found.append(
            f"The pole intervals of {row['method']} are {side}: {row['held']} of {row['intervals']} hold the truth, "
            f"{_percent(row['held_rate'])} ({_percent(row['held_low'])} to {_percent(row['held_high'])}); "
            "95 % is claimed."
        )
    return found


def of_the_bar(board: pl.DataFrame) -> list[str]:
    """Which families have no bar from the truth, and where the bar itself failed."""
    found = []
    for family, share in board.group_by("family").agg(pl.col("bar_at_truth").mean()).sort("family").iter_rows():
        if share < 1:
            found.append(
                f"{family}: the bar is the best fit of any method on {_percent(1 - share)} of the rows, since "
                "their truth is not known."
            )
    return found


def _percent(share: float) -> str:
    return f"{100 * share:.0f} %"


def _seconds(value: float | None) -> str:
    return "an unknown time" if value is None else f"{value:.3g} s"
