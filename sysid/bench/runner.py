"""Run cases into a CSV, one row each. A run that was killed goes on where it stopped."""

import csv
import io
import os
from collections.abc import Callable
from pathlib import Path

from sysid.base.errors import InputError
from sysid.bench.scenarios import Case
from sysid.bench.score import FIELDS, score


def run(cases: list[Case], path: Path, progress: Callable[[int, int], None] | None = None) -> int:
    """Score every case that `path` does not hold yet; returns how many were run. Rows reach the disk one by one."""
    done = {_key(row) for row in read(path)} if path.exists() else set()
    todo = [c for c in cases if (c.plant, c.structure, c.starts, c.seed) not in done]
    path.parent.mkdir(parents=True, exist_ok=True)
    _cut_torn_line(path)
    with path.open("a", encoding="utf-8", newline="") as file:
        if path.stat().st_size == 0:
            file.write(_line(FIELDS))
        for k, case in enumerate(todo):
            row = score(case)
            file.write(_line([row[f] for f in FIELDS]))  # one write a row: a kill tears at most the last line
            file.flush()
            os.fsync(file.fileno())
            if progress is not None:
                progress(k + 1, len(todo))
    return len(todo)


def read(path: Path) -> list[dict[str, str]]:
    """Whole rows of a results file; a last line that a kill tore off is left out."""
    if not path.exists():
        raise InputError(f"{path} does not exist; run the benchmark first: python -m sysid.bench run --out {path}")
    text = path.read_text(encoding="utf-8")
    whole = text[: text.rfind("\n") + 1]
    if not whole:
        return []
    rows = list(csv.DictReader(io.StringIO(whole)))
    if whole.splitlines()[0].split(",") != list(FIELDS):
        raise InputError(f"{path} has other columns than this benchmark writes; choose another file")
    return rows


def _key(row: dict[str, str]) -> tuple[str, str, int, int]:
    return row["plant"], row["structure"], int(row["starts"]), int(row["seed"])


def _line(values: tuple[str, ...] | list[str]) -> str:
    return ",".join(values) + "\n"


def _cut_torn_line(path: Path) -> None:
    path.touch()
    data = path.read_bytes()
    whole = data[: data.rfind(b"\n") + 1]
    if len(whole) < len(data):
        with path.open("r+b") as file:
            file.truncate(len(whole))
