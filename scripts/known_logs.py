"""How many logs with a known right answer are read right, by kind, here or by another version.

    python scripts/known_logs.py --out after.json
    python scripts/known_logs.py --checkout ../before --out before.json          # of a git worktree of another commit
    python scripts/known_logs.py --python ../venv/bin/python --out other.json    # of what is installed there

The logs are those of `tests/corpus` by file, and the cases of public reports in `tests/corpus/reports.py`. Counted are:
right; refused with a sentence whose way works when it is followed; a dead end, a sentence whose way does not; wrong,
which is other numbers, numbers for a file that says two things, or an error that is no sentence. Exit status 1 if a log
is wrong or a dead end.
"""

import argparse
import json
import os
import subprocess
import sys
import tempfile
from collections import Counter
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[1]


def judged(kinds: list[str]) -> dict[str, Any]:
    """Counts and what is not right, by kind, of the version that this interpreter imports."""
    sys.path.insert(0, str(ROOT / "tests"))
    from corpus import PARTS, reports
    from corpus.judged import WORDS, judge

    cases = {part.__name__.split(".")[-1]: {n: (judge, e) for n, e in part.LOGS.items()} for part in PARTS}
    cases["reports"] = {name: (reports.judge, report) for name, report in reports.REPORTS.items()}
    result = {}
    for kind, entries in cases.items():
        counts, told = Counter[str](), dict[str, str]()
        for name, (judge_of_kind, entry) in entries.items() if kind in kinds or not kinds else ():
            with tempfile.TemporaryDirectory() as folder:
                word, why = judge_of_kind(entry, Path(folder))
            counts[word] += 1
            if word in ("dead end", "wrong"):
                told[name] = f"{word}: {why}"[:600]
        if counts:
            result[kind] = {"n": sum(counts.values()), **{word: counts[word] for word in WORDS}, "told": told}
    return result


def elsewhere(options: argparse.Namespace) -> dict[str, Any]:
    """The counts of another interpreter, or of another checkout."""
    environment = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
    if options.checkout:
        environment["PYTHONPATH"] = str(options.checkout.resolve())
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / "counts.json"
        command = [options.python, Path(__file__).resolve(), "--out", out, "--kinds", ",".join(options.kinds)]
        done = subprocess.run(
            [str(word) for word in command], env=environment, cwd=folder, stdout=subprocess.DEVNULL, check=False
        )
        if not out.exists():
            raise SystemExit(f"{options.python} ended with {done.returncode} before it had counts; see above")
        return json.loads(out.read_text(encoding="utf-8"))["kinds"]


def main() -> int:
    """Print the table, write the counts."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, metavar="FILE.json")
    parser.add_argument("--kinds", type=lambda text: text.split(",") if text else [], default=[], help="with commas")
    parser.add_argument("--python", type=Path, help="interpreter of another environment")
    parser.add_argument("--checkout", type=Path, help="folder of another checkout")
    options = parser.parse_args()
    another = bool(options.python or options.checkout)
    options.python = options.python or Path(sys.executable)
    kinds = elsewhere(options) if another else judged(options.kinds)
    words = ("n", "right", "refused", "dead end", "wrong")
    total = {word: sum(counts[word] for counts in kinds.values()) for word in words}
    if options.out is not None:
        options.out.write_text(json.dumps({"total": total, "kinds": kinds}, indent=1) + "\n", encoding="utf-8")
    print(f"{'kind':12}", *(f"{word:>9}" for word in words))
    for kind, counts in {**kinds, "total": total}.items():
        print(f"{kind:12}", *(f"{counts[word]:>9}" for word in words))
    return int(total["dead end"] + total["wrong"] > 0)


if __name__ == "__main__":
    sys.exit(main())
