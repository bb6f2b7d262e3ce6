"""How many small faults the tests notice: mutants of modules, each run against the tests that execute what it changed.

    python scripts/mutants.py --modules 'sysid/**/*.py' --per-module 10 --minutes 60

First, once for a state of the sources, all tests run under coverage with a context for each (of the dev extra).
Then each mutant runs in a copy of the tree; results are kept line by line under --store, so that a run that was stopped
goes on with the mutants that are missing; let one run at a time use a store. Coverage does not see compiled functions:
these, and what a module does when it is imported, count as executed where a line that names them is.
"""

import argparse
import ast
import hashlib
import itertools
import json
import os
import random
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter, defaultdict
from functools import cache
from pathlib import Path

from executed import PACKAGES, ROOT, Map, record, tree
from mutations import sites, splice, variants

COMPILED = re.compile(r"^\s*@(njit|jit|cfunc|kernel|callback|vectorize|guvectorize|intrinsic)\b", re.MULTILINE)


def mutants(path: Path, rng: random.Random, count: int) -> list[dict]:
    """`count` mutants of a module, drawn among all."""
    text, candidates = path.read_text(encoding="utf-8"), []
    for node, statement in sites(tree(path)):
        body = getattr(statement, "body", None)
        last = statement.end_lineno if not isinstance(body, list) else max(statement.lineno, body[0].lineno - 1)
        for new in variants(node):
            candidates.append((node, new, statement.lineno, last))
    rows, version = [], hashlib.sha256(text.encode()).hexdigest()[:12]
    for node, new, first, last in rng.sample(candidates, min(count, len(candidates))):
        row = {"file": os.path.relpath(path, ROOT), "line": node.lineno, "version": version}
        row |= {"old": " ".join(ast.unparse(node).split()), "new": " ".join(ast.unparse(new).split())}
        row["key"] = json.dumps([row["file"], row["version"], node.lineno, node.col_offset, row["new"]])
        rows.append(row | {"text": splice(text, node, new), "first": first, "last": last})
    return rows


@cache
def feeds_a_kernel(file: str) -> bool:
    """Whether compiled code holds something of this module: a cached kernel does not know when that changes."""
    texts = [p.read_text(encoding="utf-8") for package in PACKAGES for p in (ROOT / package).rglob("*.py")]
    import_line = re.compile(rf"^(from|import) .*\b{Path(file).stem}\b", re.MULTILINE)
    own = bool(COMPILED.search((ROOT / file).read_text(encoding="utf-8")))
    return own or any(COMPILED.search(text) and import_line.search(text) for text in texts)


def judge(row: dict, tests: list[str], place: Path, limit: float) -> str:
    """killed, survived or timeout: one mutant in the copy at `place`."""
    path = place / row["file"]
    content, stat = path.read_bytes(), path.stat()
    (place / "tests.txt").write_text("\n".join(tests))
    command = [sys.executable, "-m", "pytest", "-x", "-q", "-n", "0", "-p", "no:cacheprovider", "@tests.txt"]
    with tempfile.TemporaryDirectory() as cold:
        kernels = cold if feeds_a_kernel(row["file"]) else str(place.parent / "kernels")
        variables = {"NUMBA_CACHE_DIR": kernels, "PYTHONPATH": str(place)}
        path.write_text(row["text"], encoding="utf-8")
        quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL, "start_new_session": True}
        child = subprocess.Popen(command, cwd=place, env=os.environ | variables, **quiet)
        try:
            return "survived" if child.wait(timeout=limit) == 0 else "killed"
        except subprocess.TimeoutExpired:
            return "timeout"
        finally:
            if child.poll() is None:
                os.killpg(child.pid, signal.SIGKILL)  # and what the tests started
                child.wait()
            path.write_bytes(content)
            os.utime(path, ns=(stat.st_atime_ns, stat.st_mtime_ns))


def changed(row: dict) -> str:
    return f"{row['old'][:70]}  ->  {row['new'][:70]}"


def report(rows: list[dict]) -> str:
    """The table by module, and what survived."""
    kinds, counts = ("killed", "survived", "timeout", "untested"), defaultdict(Counter)
    for row in rows:
        counts[row["file"]][row["result"]] += 1
        counts["all"][row["result"]] += 1
    lines = [f"{'module':44}{'mutants':>9}" + "".join(f"{kind:>10}" for kind in kinds)]
    for file, c in sorted(counts.items(), key=lambda pair: (pair[0] == "all", pair[0])):
        lines.append(f"{file:44}{c.total():9}" + "".join(f"{c[kind]:10}" for kind in kinds))
    for row in sorted(rows, key=lambda r: (r["file"], r["line"])):
        if row["result"] in ("survived", "untested"):
            note = f"   [{row['run']} of {row['known']} tests]" if row["run"] < row["known"] else ""
            lines.append(
                f"{row['result']:9} {row['file']}:{row['line']}  {row['old'][:70]}  ->  {row['new'][:70]}{note}"
            )
    return "\n".join(lines)


def main() -> None:
    """Judge the mutants that the store lacks and print the report."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--modules", nargs="+", default=["sysid/**/*.py"], metavar="GLOB", help="from the top folder")
    parser.add_argument("--per-module", type=int, default=5, help="mutants of a module, at most")
    parser.add_argument("--minutes", type=float, default=30.0, help="when to stop starting mutants")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--most", type=float, default=60.0, help="seconds of tests for a mutant, the shortest first")
    parser.add_argument("--store", type=Path, default=Path(tempfile.gettempdir()) / "mutants")
    parser.add_argument("--tests", default="tests", help="what pytest is given when tests are recorded, in one string")
    parser.add_argument("--again", action="store_true", help="run what survived or was untested once more")
    options = parser.parse_args()
    deadline, book = time.monotonic() + 60.0 * options.minutes, options.store / "results.jsonl"
    coverage = Map(record(options.store, options.tests))
    modules = sorted({path for glob in options.modules for path in ROOT.glob(glob) if path.suffix == ".py"})
    mutants_of_module = [
        mutants(p, random.Random(f"{options.seed} {p.relative_to(ROOT)}"), options.per_module) for p in modules
    ]
    plan = [row for rank in itertools.zip_longest(*mutants_of_module) for row in rank if row]  # every module early
    results = {row["key"]: row for row in map(json.loads, book.read_text().splitlines())} if book.exists() else {}
    results = {key: row for key, row in results.items() if not options.again or row["result"] in ("killed", "timeout")}
    place = options.store / "tree"
    shutil.rmtree(place, ignore_errors=True)
    shutil.copytree(ROOT, place, ignore=shutil.ignore_patterns(".git", "__pycache__", "runs", ".venv", ".*_cache"))
    for row in plan:
        if row["key"] in results or time.monotonic() > deadline:
            continue
        tests = sorted(coverage.tests(ROOT / row["file"], row.pop("first"), row.pop("last")), key=coverage.seconds.get)
        total_seconds = itertools.accumulate(coverage.seconds[name] for name in tests)
        selection = [
            name for name, total in zip(tests, total_seconds, strict=True) if total <= options.most or name == tests[0]
        ]
        limit = 120.0 + 5.0 * sum(coverage.seconds[name] for name in selection)
        row["result"] = judge(row, selection, place, limit) if selection else "untested"
        row |= {"run": len(selection), "known": len(tests)}
        results[row["key"]] = {name: value for name, value in row.items() if name != "text"}
        with book.open("a", encoding="utf-8") as file:
            file.write(json.dumps(results[row["key"]]) + "\n")
        print(f"{row['result']:9} {row['file']}:{row['line']}  {changed(row)}", flush=True)
    print(report([results[row["key"]] for row in plan if row["key"] in results]))


if __name__ == "__main__":
    main()
