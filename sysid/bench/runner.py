"""Run cases into a CSV, one row each. A run that was killed goes on where it stopped."""

import csv
from collections.abc import Callable
from pathlib import Path

from sysid.bench.scenarios import Case
from sysid.bench.score import FIELDS, score
from sysid.errors import InputError
from sysid.files import Lines


def run(cases: list[Case], path: Path, progress: Callable[[int, int], None] | None = None) -> int:
    """Score every case that `path` does not hold yet; returns how many were run. Rows reach the disk one by one."""
    done = {_key(row) for row in read(path)} if path.exists() else set()
    todo = [c for c in cases if (c.plant, c.structure, c.starts, c.seed) not in done]
    path.parent.mkdir(parents=True, exist_ok=True)
    lines = Lines(path)
    if not lines.read():
        lines.append(",".join(FIELDS))
    for k, case in enumerate(todo):
        row = score(case)
        lines.append(",".join(row[f] for f in FIELDS))
        if progress is not None:
            progress(k + 1, len(todo))
    return len(todo)


def read(path: Path) -> list[dict[str, str]]:
    """Whole rows of a results file; a last line that a kill tore off is left out."""
    if not path.exists():
        raise InputError(f"{path} does not exist; run the benchmark first: python -m sysid.bench run --out {path}")
    whole = Lines(path).read()
    if not whole:
        return []
    rows = list(csv.DictReader(whole))
    if whole[0].split(",") != list(FIELDS):
        raise InputError(f"{path} has other columns than this benchmark writes; choose another file")
    return rows


def _key(row: dict[str, str]) -> tuple[str, str, int, int]:
    return row["plant"], row["structure"], int(row["starts"]), int(row["seed"])
