"""How often the verdict of `qpal compare` names the effect that is off nominal, on stand-ins that a seed draws.

.venv/bin/python scripts/verdicts.py --first 1000 --each 6 --nothing 20 --jobs 2 [--docs]
"""

import argparse
import json
from pathlib import Path

import numpy as np
from joblib import Parallel, delayed

from twin.compare.effects import TABLE
from twin.compare.search import Trials
from twin.compare.standins import NOTHING, stand_in
from twin.compare.verdict import explain
from twin.follow import Follower
from twin.parameters import Parameters

PAGE = Path(__file__).resolve().parent.parent / "docs" / "compare.md"
MARKS = ("<!-- verdicts: made by scripts/verdicts.py -->\n", "<!-- end of verdicts -->")


def judge(effect: str, seed: int) -> dict:
    """The verdict on one stand-in, beside what was drawn."""
    given = stand_in(effect, seed)
    verdict = explain(Trials(Follower(given.log, given.joint, threads=1), Parameters()))
    found = {
        "effect": effect,
        "seed": seed,
        "joint": given.joint,
        "excitation": given.excitation,
        "size": given.size,
        "named": verdict.first or NOTHING,
        "alike": list(verdict.alike),
        "departure": float(np.degrees(verdict.rms)),
        "left": float(np.degrees(verdict.alone[0].rms)),
        "share": verdict.named[0].share if verdict.named else 0.0,
        "others": [share.effect for share in verdict.named[1:]],
        "shares": {share.effect: round(share.share, 3) for share in verdict.alone},
    }
    mark = "hit " if found["named"] == effect else "MISS"
    print(mark, *(f"{key} {value}" for key, value in found.items()), sep="; ", flush=True)
    return found


def markdown(rows: list[dict]) -> str:
    """The table of hits, and which effect was named for which."""
    names = [*TABLE, NOTHING]
    lines = ["| off nominal | " + " | ".join(f"named {name}" for name in names) + " | hits | departure [deg] |"]
    lines.append("| :-- |" + " --: |" * (len(names) + 2))
    for effect in names:
        own = [row for row in rows if row["effect"] == effect]
        if not own:
            continue
        counts = [sum(row["named"] == name for row in own) for name in names]
        size = [row["departure"] for row in own]
        cells = " | ".join(str(n) if n else "–" for n in counts)
        hits = counts[names.index(effect)]
        lines.append(
            f"| {effect.replace('_', ' ')} | {cells} | {hits} of {len(own)} | {min(size):.2f} to {max(size):.2f} |"
        )
    return "\n".join(lines) + "\n"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--first", type=int, default=1000, help="first seed; seeds below 1000 were used for tuning")
    parser.add_argument("--each", type=int, default=6, help="stand-ins of each effect")
    parser.add_argument("--nothing", type=int, default=20, help="stand-ins with nothing off nominal")
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--json", help="file that gets every verdict")
    parser.add_argument("--docs", action="store_true", help="write the table into docs/compare.md")
    given = parser.parse_args()
    tasks = [(effect, given.first + k) for k in range(given.each) for effect in TABLE]
    tasks += [(NOTHING, given.first + k) for k in range(given.nothing)]
    rows = Parallel(given.jobs)(delayed(judge)(*task) for task in tasks)
    off = [row for row in rows if row["effect"] != NOTHING]
    hits = sum(row["named"] == row["effect"] for row in off)
    quiet = [row for row in rows if row["effect"] == NOTHING]
    right = sum(row["named"] == NOTHING for row in quiet)
    table = markdown(rows)
    print(table, f"{hits} of {len(off)} named first; {right} of {len(quiet)} without a departure", sep="\n")
    if given.json:
        Path(given.json).write_text(json.dumps(rows, indent=1), encoding="utf-8")
    if given.docs:
        before, _, rest = PAGE.read_text(encoding="utf-8").partition(MARKS[0])
        PAGE.write_text(before + MARKS[0] + table + MARKS[1] + rest.partition(MARKS[1])[2], encoding="utf-8")


if __name__ == "__main__":
    main()
