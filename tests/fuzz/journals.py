"""Journals of the structure search and of the benchmark: a row is as it was written, or it is done again."""

import importlib
import json
import tempfile
from functools import cached_property
from pathlib import Path

import numpy as np

from fuzz.mutate import damaged, other_values
from fuzz.runner import WrongError
from sysid.base.errors import InputError
from sysid.bench.table import COLUMNS, KEY, Table
from sysid.data.record import IOData
from sysid.selection.journal import Journal

ROWS = 8
SETTINGS = ("space", "lm", 0)


def record() -> IOData:
    """A record that a search was run on."""
    t = np.arange(30.0)
    return IOData(np.sin(t), np.cos(0.3 * t), 0.1)


def searched(path: Path) -> list[tuple[int, dict, dict]]:
    """A journal of a search at `path`, and its rows: round, key, values."""
    rng, rows = np.random.default_rng(5), []
    book = Journal(path, record(), SETTINGS)
    for k in range(ROWS):
        key = {"structure": "hammerstein", "nb": k % 3 + 1, "nf": k // 3, "input": "saturation"}
        errors = rng.uniform(0.1, 1.0, 8).tolist()
        values = {"fit": 80 + k / 7, "d": k + 3, "errors": errors, "converged": True, "whole": k < 4, "why": ""}
        rows.append((k // 4, key, {**values, "thetas": [rng.uniform(-1, 1, 3).tolist()]}))
        book.add(*rows[-1])
    return rows


def measured(path: Path) -> list[dict]:
    """Rows of a benchmark in the journal beside `path`, as a killed run leaves them."""
    import polars as pl

    rows, table = [], Table(path)
    for k in range(ROWS):
        values = {pl.Float64: k + 0.125, pl.Int64: k}
        row = {name: values.get(kind, f"{name}{k}") for name, kind in COLUMNS.items()}
        rows.append({**row, "status": "ok"})
        table.add(rows[-1])
    return rows


class Journals:
    """No row with other numbers than those that were written is ever taken up."""

    name = "journals"
    seconds = 2.0

    @cached_property
    def _search(self) -> tuple[list, bytes]:
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "search.jsonl"
            return searched(path), path.read_bytes()

    @cached_property
    def _bench(self) -> tuple[list, bytes]:
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "bench.parquet"
            return measured(path), path.with_suffix(".journal").read_bytes()

    def ready(self) -> None:
        """The journal of a search; that of a benchmark is made behind the fork, as polars is."""
        importlib.import_module("polars")
        assert self._search

    def case(self, rng: np.random.Generator, folder: Path) -> str:
        """One journal."""
        bench = rng.random() < 0.5
        rows, content = self._bench if bench else self._search
        content = _row_changed(rng, content) if rng.random() < 0.4 else damaged(rng, content)
        if bench:
            (folder / "bench.journal").write_bytes(content)
            return benched(folder / "bench.parquet", rows)
        (folder / "search.jsonl").write_bytes(content)
        return resumed(folder / "search.jsonl", rows)


def _row_changed(rng: np.random.Generator, content: bytes) -> bytes:
    """Another value in a row, or the row a second time with another value."""
    lines = content.splitlines()
    k = int(rng.integers(len(lines)))
    changed = json.dumps(other_values(rng, json.loads(lines[k]))).encode()
    lines = [*lines[:k], *([lines[k]] if rng.random() < 0.5 else []), changed, *lines[k + 1 :]]
    return b"\n".join(lines) + b"\n"


def resumed(path: Path, rows: list[tuple[int, dict, dict]]) -> str:
    """How a search takes up a journal."""
    book = Journal(path, record(), SETTINGS)
    for number, key, values in rows:
        found = book.find(number, key)
        if found is not None and found != values:
            raise WrongError(f"wrong number: round {number}, {key}: {found}, not {values}"[:500])
    whole = all(book.find(number, key) is not None for number, key, _ in rows)
    book.add(9, {"structure": "new"}, rows[0][2])
    again = Journal(path, record(), SETTINGS)
    if again.find(9, {"structure": "new"}) != rows[0][2]:
        raise WrongError("lost: what was added behind the damage is not found again")
    return "same" if whole else "read"


def benched(path: Path, rows: list[dict]) -> str:
    """How a benchmark takes up its journal."""
    right = {tuple(row[name] for name in KEY): row for row in rows}
    try:
        found = Table(path).rows().to_dicts()
    except InputError as error:
        if "remove" not in str(error) and "run" not in str(error):
            raise WrongError(f"no sentence: {error}") from None
        raise
    for row in found:
        if right.get(tuple(row[name] for name in KEY)) != row:
            raise WrongError(f"wrong number: {row}"[:500])
    return "same" if len(found) == len(rows) else "read"
