"""How often the verdict of `qpal compare` names the effect that is off nominal, on stand-ins that a seed draws.

python scripts/study.py verdicts --seeds 1000:1006 --nothing 20 --workers 2 [--docs]
"""

import argparse
from pathlib import Path

import numpy as np
from study import MISSING, Study, markdown

from twin.compare.effects import TABLE
from twin.compare.search import Trials
from twin.compare.standins import NOTHING, StandIn, stand_in
from twin.compare.verdict import explain
from twin.follow import Follower
from twin.parameters import Parameters

PAGE = Path(__file__).resolve().parents[2] / "docs" / "compare.md"
UNKNOWN, OTHER = "unknown", "other"


def score(case: tuple[str, int], options: argparse.Namespace) -> dict:
    """The verdict on one stand-in, beside what was drawn."""
    return judged(stand_in(*case))


def judged(example: StandIn) -> dict:
    """The verdict on a stand-in, beside what was drawn; `named` is "unknown" where no cause is."""
    verdict = explain(Trials(Follower(example.log, example.joint, threads=1), Parameters()))
    return {
        "effect": example.effect,
        "joint": example.joint,
        "excitation": example.excitation,
        "size": example.size,
        "named": verdict.first or (NOTHING if verdict.known else UNKNOWN),
        "alike": list(verdict.alike),
        "departure": float(np.degrees(verdict.rms)),
        "left": float(np.degrees(verdict.left.rms)),
        "uneven": list(verdict.left.uneven),
        "share": verdict.explained,
        "causes": [share.effect for share in verdict.named],
        "shares": {share.effect: round(share.share, 3) for share in verdict.alone},
    }


def put_into_page(text: str, study: str) -> None:
    """Put a table between the marks of its study in docs/compare.md."""
    marks = f"<!-- {study}: made by scripts/studies/{study}.py -->\n", f"<!-- end of {study} -->"
    head, _, rest = PAGE.read_text(encoding="utf-8").partition(marks[0])
    PAGE.write_text(head + marks[0] + text + marks[1] + rest.partition(marks[1])[2], encoding="utf-8")


def line(row: dict) -> str:
    """The whole row, and whether the effect was named."""
    mark = "hit " if row["named"] == row["effect"] else "MISS"
    return "; ".join((mark, *(f"{key} {value}" for key, value in row.items() if key != "case")))


def table(rows: list[dict]) -> str:
    """The table of hits, and which effect was named for which."""
    names = [*TABLE, OTHER, UNKNOWN, NOTHING]
    headings = ["off nominal", *(f"named {name}" for name in names[:-2]), UNKNOWN, NOTHING, "hits", "departure [deg]"]
    lines = []
    for effect in names:
        group = [row for row in rows if row["effect"] == effect]
        if group:
            named = [row["named"] if row["named"] in names else OTHER for row in group]
            counts = [named.count(name) for name in names]
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
        put_into_page(text, "verdicts")
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
