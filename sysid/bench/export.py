"""A scenario's data as files that any program reads: CSV for signals, JSON for what is known of the plant."""

import csv
import io
import json
from pathlib import Path
from typing import Any

import numpy as np

from sysid.base.errors import InputError
from sysid.base.files import json_value, write_text
from sysid.bench.task import Task
from sysid.data.record import IOData


def export(task: Task, folder: str | Path) -> Path:
    """Write a task into a new or empty folder, which is returned; every number reads back as it was.

    train.csv and one CSV a test, with columns t [s], u, y, and y_true in tests of a known plant; an output that was
    not measured is empty. A record of several experiments becomes train-1.csv, train-2.csv and so on. scenario.json:
    Ts [s], drop, unit, orders, and the file and length of each record. truth.json, for a known plant: standard
    deviation of the noise, poles in z, structure, parameters by name. Raises InputError for a folder that is in use.
    """
    where = check_empty(folder)
    try:
        where.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"cannot make {where}: {error.strerror}; choose a folder that you may write to") from None
    tests = {}
    for k, (name, test) in enumerate(task.tests.items(), 1):
        clean = None if task.truth is None else task.truth.y.get(name)
        tests[name] = _record(where, "test" if len(task.tests) == 1 else f"test-{k}-{_plain(name)}", test, clean)
    files = {"train": _record(where, "train", task.train, None), "tests": tests}
    known = {"Ts": task.train.Ts, "drop": task.drop, "unit": task.unit, "orders": task.orders, "given": task.given}
    _json(where / "scenario.json", known | {"published": dict(task.published)} | files)
    if task.truth is not None:
        _json(where / "truth.json", _truth(task))
    return where


def check_empty(folder: str | Path) -> Path:
    """The folder, which is new or empty; raises InputError for one that is in use."""
    where = Path(folder)
    if where.exists() and (not where.is_dir() or any(where.iterdir())):
        raise InputError(f"{where} is not empty; give a new folder")
    return where


def _record(where: Path, name: str, record: IOData, clean: np.ndarray | None) -> list[dict[str, Any]]:
    """The CSV files of one record, and what scenario.json says of them."""
    parts, written, begin = record.experiments, [], 0
    for k, part in enumerate(parts, 1):
        file = f"{name}.csv" if len(parts) == 1 else f"{name}-{k}.csv"
        columns = [part.t, part.u[:, 0], np.where(part.observed[:, 0], part.y[:, 0], np.nan)]
        if clean is not None:
            columns.append(np.asarray(clean)[begin : begin + part.N])
        write_text(where / file, _csv(("t", "u", "y", "y_true")[: len(columns)], columns))
        written.append({"file": file, "length": part.N})
        begin += part.N
    return written


def _csv(names: tuple[str, ...], columns: list[np.ndarray]) -> str:
    """Rows of the shortest decimal numbers that read back to the same bits; nan is empty."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(names)
    for row in zip(*(column.tolist() for column in columns), strict=True):
        writer.writerow("" if value != value else repr(value) for value in row)
    return text.getvalue()


def _truth(task: Task) -> dict[str, Any]:
    truth = task.truth
    assert truth is not None
    found: dict[str, Any] = {"noise": truth.noise, "orders": task.orders, "poles": truth.poles}
    if truth.chain is not None and truth.theta is not None:
        found["structure"] = truth.chain.structure
        found["parameters"] = dict(zip(truth.chain.names, truth.theta, strict=True))
    return found


def _json(path: Path, value: Any) -> None:
    write_text(path, json.dumps(json_value(value), indent=2, allow_nan=False) + "\n")


def _plain(name: str) -> str:
    """A name as part of a file's name."""
    return "".join(c if c.isalnum() or c in "-_." else "_" for c in name)
