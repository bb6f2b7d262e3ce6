"""Run cases into a CSV, one row each. A run that was killed continues where it stopped."""

import csv
from collections.abc import Callable
from pathlib import Path

from sysid.base.errors import InputError
from sysid.base.files import Lines
from sysid.bench.scenarios import Case
from sysid.bench.score import FIELDS, score


def run(cases: list[Case], path: Path, progress: Callable[[int, int], None] | None = None) -> int:
    """Score every case that is not yet in `path`; returns how many were run. Each row is written at once."""
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
    """Complete rows of a results file; an incomplete last line of a killed run is left out."""
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
