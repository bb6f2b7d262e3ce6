"""Command line: python -m sysid.bench run|report|speed."""

import argparse
import json
import sys
from pathlib import Path

from sysid.base.errors import InputError
from sysid.bench.report import table
from sysid.bench.runner import read, run
from sysid.bench.scenarios import cases
from sysid.bench.speed import speed


def main(arguments: list[str] | None = None) -> int:
    """Exit status: 0 done, 2 bad input."""
    parser = argparse.ArgumentParser(prog="python -m sysid.bench", description="Known-truth benchmark of sysid.")
    parser.add_argument("verb", choices=("run", "report", "speed"))
    parser.add_argument("--out", type=Path, default=Path("runs/bench.csv"), help="results file; a run resumes it")
    parser.add_argument("--seeds", type=int, default=100, help="how many")
    parser.add_argument("--first", type=int, default=0, help="the first seed")
    parser.add_argument("--long", type=int, default=1_000_000, help="samples of the long record of `speed`")
    given = parser.parse_args(arguments)
    try:
        if given.verb == "run":
            count = run(cases(range(given.first, given.first + given.seeds)), given.out, _progress)
            print(f"{count} cases run into {given.out}", file=sys.stderr)
        elif given.verb == "report":
            print(table(read(given.out)))
        else:
            print(json.dumps({k: float(f"{v:.4g}") for k, v in speed(given.long).items()}, indent=2))
    except InputError as error:
        print(error, file=sys.stderr)
        return 2
    return 0


def _progress(done: int, total: int) -> None:
    if sys.stderr.isatty():
        print(f"\r{done} of {total}", end="\n" if done == total else "", file=sys.stderr, flush=True)


if __name__ == "__main__":
    sys.exit(main())
