"""Damaged logs, saved models, journals, parameter files and sessions: right numbers or a sentence, and nothing else.

    python scripts/fuzz.py --what all --cases 100000 --seed 1 --keep runs/fuzz

The counts are printed as JSON: cases that gave the same numbers, valid other ones or a sentence, and failures by kind
with samples. A failure is an error that is no sentence, a signal, a hang of 2 s, nan or inf, a warning, a wrong number
where the right one is known, or a refusal of a file that must be read. `--case K` runs one case of a target again in
this process, with its traceback. Exit status 1 if a case failed.
"""

import argparse
import json
import sys
import tempfile
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests"))

from fuzz.runner import run
from fuzz.targets import SHARES, TARGETS


def main() -> int:
    """Run what is asked for and print the counts."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--what", default="all", choices=[*TARGETS, "all"])
    parser.add_argument("--cases", type=int, default=10_000, help="in all; targets take their shares of them")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--keep", type=Path, help="folder for samples of failures")
    parser.add_argument("--case", type=int, help="run this case alone, in this process")
    options = parser.parse_args()
    names = list(TARGETS) if options.what == "all" else [options.what]
    if options.case is not None:
        return again(names[0], options.case, options.seed)
    total = sum(SHARES[name] for name in names)
    result = {}
    for name in names:
        counts = run(TARGETS[name](), range(round(options.cases * SHARES[name] / total)), options.seed, options.keep)
        result[name] = counts.as_dict()
        print(name, json.dumps({"cases": counts.cases, "failed": counts.failed}), file=sys.stderr, flush=True)
    cases, failures = (sum(kind[name] for kind in result.values()) for name in ("cases", "failed"))
    print(json.dumps({"seed": options.seed, "cases": cases, "failed": failures, **result}, indent=2))
    return 1 if failures else 0


def again(name: str, k: int, seed: int) -> int:
    """One case with its traceback; its files stay."""
    import numpy as np

    folder = Path(tempfile.mkdtemp())
    print(folder, TARGETS[name]().case(np.random.default_rng([seed, k, *name.encode()]), folder))
    return 0


if __name__ == "__main__":
    sys.exit(main())
