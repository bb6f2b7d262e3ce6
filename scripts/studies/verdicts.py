"""How often the verdict of `qpal compare` names the effect that is off nominal, on stand-ins that a seed draws.

python scripts/study.py verdicts --seeds 1000:1006 --nothing 20 --workers 2 [--docs]
"""

import argparse
from pathlib import Path

import numpy as np
from study import MISSING, Study, markdown

from twin.compare.effects import TABLE
from twin.compare.search import Trials
from twin.compare.standins import NOTHING, stand_in
from twin.compare.verdict import explain
from twin.follow import Follower
from twin.parameters import Parameters

PAGE = Path(__file__).resolve().parents[2] / "docs" / "compare.md"
MARKS = ("<!-- verdicts: made by scripts/studies/verdicts.py -->\n", "<!-- end of verdicts -->")


def score(case: tuple[str, int], options: argparse.Namespace) -> dict:
    """The verdict on one stand-in, beside what was drawn."""
    effect, seed = case
    example = stand_in(effect, seed)
    verdict = explain(Trials(Follower(example.log, example.joint, threads=1), Parameters()))
    return {
        "effect": effect,
        "seed": seed,
        "joint": example.joint,
        "excitation": example.excitation,
        "size": example.size,
        "named": verdict.first or NOTHING,
        "alike": list(verdict.alike),
        "departure": float(np.degrees(verdict.rms)),
        "left": float(np.degrees(verdict.alone[0].rms)),
        "share": verdict.named[0].share if verdict.named else 0.0,
        "others": [share.effect for share in verdict.named[1:]],
        "shares": {share.effect: round(share.share, 3) for share in verdict.alone},
    }


def line(row: dict) -> str:
    """The whole row, and whether the effect was named."""
    mark = "hit " if row["named"] == row["effect"] else "MISS"
    return "; ".join((mark, *(f"{key} {value}" for key, value in row.items() if key != "case")))


def table(rows: list[dict]) -> str:
    """The table of hits, and which effect was named for which."""
    names = [*TABLE, NOTHING]
    headings = ["off nominal", *(f"named {name}" for name in names), "hits", "departure [deg]"]
    lines = []
    for effect in names:
        group = [row for row in rows if row["effect"] == effect]
        if group:
            counts = [sum(row["named"] == name for row in group) for name in names]
            size = [row["departure"] for row in group]
            hits = f"{counts[names.index(effect)]} of {len(group)}"
            departure = f"{min(size):.2f} to {max(size):.2f}"
            lines.append([effect.replace("_", " "), *(n or MISSING for n in counts), hits, departure])
    return markdown(headings, lines) + "\n"


def summary(rows: list[dict], options: argparse.Namespace) -> str:
    """The table and the number of hits; with --docs the table also goes into docs/compare.md."""
    effects = [row for row in rows if row["effect"] != NOTHING]
    hits = sum(row["named"] == row["effect"] for row in effects)
    quiet = [row["named"] == NOTHING for row in rows if row["effect"] == NOTHING]
    text = table(rows)
    if options.docs:
        head, _, rest = PAGE.read_text(encoding="utf-8").partition(MARKS[0])
        PAGE.write_text(head + MARKS[0] + text + MARKS[1] + rest.partition(MARKS[1])[2], encoding="utf-8")
    return f"{text}\n{hits} of {len(effects)} named first; {sum(quiet)} of {len(quiet)} without a departure"


def cases(options: argparse.Namespace) -> list[tuple[str, int]]:
    """Every effect with every seed, and nothing off nominal with as many as asked for."""
    first = options.seeds[0]
    with_effect = [(effect, seed) for seed in options.seeds for effect in TABLE]
    return with_effect + [(NOTHING, first + k) for k in range(options.nothing)]


STUDY = Study(
    cases,
    score,
    summary,
    seeds="1000:1006",  # seeds below 1000 were used for tuning
    options={
        "--nothing": {"type": int, "default": 20, "help": "stand-ins with nothing off nominal"},
        "--docs": {"action": "store_true", "help": "write the table into docs/compare.md"},
    },
    line=line,
)
