"""Calls the public names of `sysid` and `twin` with odd values, and counts what is not a sentence.

    python scripts/attack_calls.py --every 1 > counts.json     # all values; --every 10 takes each tenth call
    python scripts/attack_calls.py --only sysid.fit --show      # the calls that are flagged, of one name

Each argument in turn gets every odd value of `ODD`; the others are valid. A call runs in a child process with limits of
time and memory. What counts as bad: an exception that is not the project's own ("untyped"), a number that is not finite
where the valid call has finite ones ("nan"), a call that does not return ("hang"), and a process that dies ("died").
"""

import argparse
import json
import multiprocessing
import os
import sys
import tempfile
import time
import warnings
from collections import Counter
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests"))

from fuzz.outcomes import attacked
from fuzz.public import SEARCHED, calls
from fuzz.supply import Supply


def share(part: int, parts: int, every: int, part_of_name: str) -> list[tuple[str, str, str, str, str]]:
    """Of one process: name, parameter, value, outcome and what was said, for its part of the targets."""
    rows = []
    with tempfile.TemporaryDirectory() as folder:
        os.chdir(folder)
        warnings.simplefilter("ignore")
        supply = Supply()
        for k, (name, valid, attempts) in enumerate(calls(supply)):
            if k % parts != part or part_of_name not in name:
                continue
            attempts = attempts[hash_of(name) % every :: every]
            outcomes = attacked([valid, *(call for _, _, call in attempts)])
            rows.append((name, "", "", *outcomes[0]))
            if outcomes[0][0] == "valid":
                rows += [(name, p, v, *_judged(name, d)) for (p, v, _), d in zip(attempts, outcomes[1:], strict=True)]
        os.chdir("/")
    return rows


def _judged(name: str, outcome: tuple[str, str]) -> tuple[str, str]:
    """What is not finite is fine from calls that a search makes with any values."""
    return ("fine", "") if outcome[0] == "nan" and name.startswith(SEARCHED) else outcome


def hash_of(name: str) -> int:
    """The same in every process."""
    return sum(map(ord, name))


def main() -> None:
    """Print the counts of all calls."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--every", type=int, default=1, help="only each so many-th call")
    parser.add_argument("--only", default="", help="only names that contain this")
    parser.add_argument("--jobs", type=int, default=1, help="processes")
    parser.add_argument("--show", action="store_true", help="list the flagged calls on standard error")
    options = parser.parse_args()
    start = time.monotonic()
    with multiprocessing.get_context("fork").Pool(options.jobs) as pool:
        parts = [(k, options.jobs, options.every, options.only) for k in range(options.jobs)]
        rows = [row for rows_of_process in pool.starmap(share, parts) for row in rows_of_process]
    attacks = [r for r in rows if r[1]]
    bad = [r for r in attacks if r[3] not in ("fine", "sentence")]
    if options.show:
        for row in bad + [r for r in rows if r[3] == "invalid"]:
            print(*row, sep=" | ", file=sys.stderr)
    counts = {
        "names": len({r[0] for r in attacks}),
        "calls": len(attacks),
        "flagged": len(bad),
        **dict(sorted(Counter(r[3] for r in attacks).items())),
        "no valid call known": sorted(r[0] for r in rows if r[3] in ("invalid", "hang", "died") and not r[1]),
        "worst": dict(Counter(r[0] for r in bad).most_common(15)),
        "seconds": round(time.monotonic() - start, 1),
    }
    print(json.dumps(counts, indent=1))


if __name__ == "__main__":
    main()
