"""The leaderboard in words: who is first in each family, where a peer wins, where a method of ours is slower."""

from collections.abc import Collection, Iterator
from typing import Any

import polars as pl

from sysid.bench.leaderboard import CAP, ENOUGH, NEAR, against, calibration, method_of, ranked, winners
from sysid.bench.statistics import Duel, wilson

FEW = 6  # tasks: with all of them won, chance still explains it once in 32 times
TENTH = 0.1  # of the seconds of the best peer with an equal fit: what ours should need


def sentences(rows: pl.DataFrame, board: pl.DataFrame, ours: Collection[str]) -> list[str]:
    """The verdict of the leaderboard, family by family; `rows` are `scored`, `board` is their `leaderboard`."""
    families = winners(board, ours).iter_rows(named=True)
    return [sentence for row in families for sentence in _family(row, rows, board, ours)]


def again(scenario: str, method: str, seed: int, budget: float | None = None) -> str:
    """The command that runs one cell by itself; a method that the library does not have is a file."""
    from sysid.bench.methods import TABLE

    name = method_of(scenario, method)
    file = "" if name in TABLE else ".py"
    where = " --records FOLDER" if scenario.startswith(("real/", "files/")) else ""
    time = "" if budget is None else f" --budget {budget:g}"
    return (
        f"qpal bench run --scenario {scenario} --method {name}{file} --first {seed} --seeds 1{time}{where} "
        "--out runs/again.parquet"
    )


def _family(row: dict[str, Any], rows: pl.DataFrame, board: pl.DataFrame, ours: Collection[str]) -> Iterator[str]:
    family, mine, peer = row["family"], row["ours"], row["peer"]
    if mine is None and peer is None:
        yield (
            f"{family}: no method tried {_percent(ENOUGH)} of the tasks, so none is ranked. Run more: qpal bench run "
            "--tag standard"
        )
        return
    losses = [row[f"{side}_lost"] for side in ("ours", "peer") if row[f"{side}_lost"] is not None]
    if min(losses) >= CAP:
        yield f"{family}: no method has a usable result; the table of failures says why."
        return
    side = "ours" if peer is None or (mine is not None and row["ours_lost"] <= row["peer_lost"]) else "peer"
    first = mine if side == "ours" else peer
    rate = wilson(row[f"{side}_near_0.1"], row[f"{side}_n"])
    yield (
        f"{family}: {first} is first{'' if side == 'ours' else ', which is not of this library'}. It loses "
        f"{row[f'{side}_lost']:.2f} points of fit to the bar on average over {_tasks(rate.n)}; "
        f"{_percent(rate.value)} of its fits ({_percent(rate.low)} to {_percent(rate.high)}) are within "
        f"{NEAR[0]:g} point of the bar."
    )
    if mine is None or peer is None:
        yield f"{family}: the table has no method {'of others' if peer is None else 'of this library'} that is ranked."
        return
    yield f"{family}: {_versus(mine, peer, against(rows, mine, peer, family))}"
    if side == "peer":
        yield f"{family}: {_worst_against(rows, family, mine, peer)}"
    yield from (f"{family}: {text}" for text in _cost(row, board, ours))


def _versus(mine: str, peer: str, found: Duel) -> str:
    """Win, tie and loss against the best peer, and whether the shares differ beyond chance."""
    counts = f"{mine} against {peer}: {found.wins} won, {found.ties} tied and {found.losses} lost of {_tasks(found.n)}"
    shares = (
        f"won {_percent(found.win[0])} to {_percent(found.win[1])}, lost {_percent(found.loss[0])} to "
        f"{_percent(found.loss[1])}"
    )
    if found.n < FEW:
        return f"{counts}: too few to tell who is ahead."
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
        f"Repeat it: {again(top['scenario'], mine, top['seed'], _budget(rows))}"
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
            f"no peer's mean gap is within {NEAR[0]:g} point of that of {mine}, which takes "
            f"{_seconds(row['ours_seconds'])}; {row['peer']} takes {_seconds(row['peer_seconds'])} (shifted geometric "
            "means)."
        )
        return
    peer = equal.sort("seconds").row(0, named=True)
    slower = row["ours_seconds"] / peer["seconds"]
    faster = "is faster than" if slower > TENTH else "needs a tenth or less of the time of"
    yield (
        f"{mine} {'is slower than' if slower > 1 else faster} {peer['method']}, whose mean gap is no larger: "
        f"{_seconds(row['ours_seconds'])} against {_seconds(peer['seconds'])} (shifted geometric means)."
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
                f"{family}: the bar is the best fit of any method on {_percent(1 - share)} of the rows, which "
                "have no truth or no fit from it."
            )
    return found


def _budget(rows: pl.DataFrame) -> float | None:
    found = rows["budget"].to_numpy()
    return float(found[0]) if len(found) and (found == found[0]).all() else None


def _tasks(n: int) -> str:
    return f"{n} task{'s' * (n != 1)}"


def _percent(share: float) -> str:
    return f"{100 * share:.0f} %"


def _seconds(value: float | None) -> str:
    return "an unknown time" if value is None else f"{value:.3g} s"
